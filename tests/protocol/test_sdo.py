"""The client's side of SDO transfers, against the bytes of CiA 301, 7.2.4."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import ABORT_TEXT, AbortCode, SdoAborted, Transfer, abort_request, download, upload
from canarm_protocol.errors import BusError
from canarm_protocol.transport.sdo_session import SdoSession


def converse(transfer: Transfer, *answers: str) -> tuple[list[str], bytes | None]:
    """Requests that the client makes while it gets `answers` (hex), and its result, None if it wants more."""
    requests = [next(transfer).hex()]
    for answer in answers:
        try:
            requests.append(transfer.send(bytes.fromhex(answer)).hex())
        except StopIteration as done:
            return requests, done.value
    return requests, None


def refusal(transfer: Transfer, *answers: str) -> SdoAborted:
    with pytest.raises(SdoAborted) as caught:
        converse(transfer, *answers)
    return caught.value


def test_expedited_upload_of_the_device_type() -> None:
    requests, value = converse(upload(0x1000, 0), "4300100091010800")
    assert requests == ["4000100000000000"]
    assert value == b"\x91\x01\x08\x00"


@pytest.mark.parametrize(
    ("answer", "value"),
    [
        ("4f01100011000000", "11"),
        ("4b17100014000000", "1400"),
        ("4717100001020300", "010203"),
        ("42001000aabbccdd", "aabbccdd"),
    ],
)
def test_expedited_upload_of_each_size(answer: str, value: str) -> None:
    index = int.from_bytes(bytes.fromhex(answer)[1:3], "little")
    assert converse(upload(index, 0), answer)[1] == bytes.fromhex(value)


def test_segmented_upload_toggles_and_ends_with_the_last_segment() -> None:
    requests, value = converse(upload(0x1008, 0), "410810000a000000", "0044414330383038", "1920636100000000")
    assert requests == ["4008100000000000", "6000000000000000", "7000000000000000"]
    assert value == b"DAC0808 ca"[:10]


def test_segmented_upload_of_a_size_that_is_not_announced() -> None:
    assert converse(upload(0x1008, 0), "4008100000000000", "0941424300000000")[1] == b"ABC"


@pytest.mark.parametrize(
    ("value", "request_"),
    [
        ("05", "2f17100005000000"),
        ("1400", "2b17100014000000"),
        ("010203", "2717100001020300"),
        ("64000100", "2317100064000100"),
    ],
)
def test_expedited_download_of_each_size(value: str, request_: str) -> None:
    requests, result = converse(download(0x1017, 0, bytes.fromhex(value)), "6017100000000000")
    assert requests == [request_]
    assert result == b""


def test_segmented_download_announces_its_size_and_toggles() -> None:
    requests, result = converse(
        download(0x2130, 1, b"alphabet soup!"), "6030210100000000", "2000000000000000", "3000000000000000"
    )
    assert requests == [
        "213021010e000000",
        "00" + b"alphabe".hex(),
        "11" + b"t soup!".hex(),
    ]
    assert result == b""


def test_an_empty_value_goes_as_one_empty_segment() -> None:
    requests, result = converse(download(0x2130, 1, b""), "6030210100000000", "2000000000000000")
    assert requests == ["2130210100000000", "0f00000000000000"]
    assert result == b""


def test_an_abort_of_the_server_is_told_with_object_code_and_words() -> None:
    error = refusal(download(0x1000, 0, b"\0\0\0\0"), "8000100002000106")
    assert error.by_server
    assert error.code == 0x0601_0002
    assert str(error) == "SDO 0x1000:00 aborted by the server: 0x06010002 attempt to write a read-only object"


def test_an_abort_code_that_nobody_knows_is_shown_as_it_is() -> None:
    assert str(refusal(upload(0x1000, 0), "8000100078563412")).endswith("0x12345678 unknown abort code")


@pytest.mark.parametrize(
    ("transfer", "answers", "code"),
    [
        (upload(0x1000, 0), ["43001000910108"], AbortCode.LENGTH),
        (upload(0x1000, 0), ["6000100000000000"], AbortCode.COMMAND),
        (upload(0x1000, 0), ["4301100091010800"], AbortCode.COMMAND),
        (upload(0x1000, 0), ["4300100191010800"], AbortCode.COMMAND),
        (upload(0x1008, 0), ["410810000a000000", "1044414330383038"], AbortCode.TOGGLE),
        (upload(0x1008, 0), ["410810000a000000", "0044414330383038", "0920636100000000"], AbortCode.TOGGLE),
        (upload(0x1008, 0), ["410810000a000000", "0144414330383038"], AbortCode.LENGTH),
        (upload(0x1008, 0), ["4108100005000000", "0044414330383038"], AbortCode.LENGTH),
        (download(0x1017, 0, b"\1\0"), ["4017100000000000"], AbortCode.COMMAND),
        (download(0x1017, 0, bytes(9)), ["6017100000000000", "3000000000000000"], AbortCode.TOGGLE),
        (download(0x1017, 0, bytes(9)), ["6017100000000000", "6017100000000000"], AbortCode.COMMAND),
    ],
)
def test_an_answer_that_breaks_the_protocol_is_aborted_by_us(transfer: Transfer, answers: list[str], code: int) -> None:
    error = refusal(transfer, *answers)
    assert error.code == code
    assert not error.by_server


@given(st.binary(max_size=12), st.binary(max_size=40))
def test_no_answer_makes_a_client_fail_otherwise_than_with_an_abort(answer: bytes, value: bytes) -> None:
    for transfer in (upload(0x1008, 0), download(0x2130, 1, value)):
        next(transfer)
        try:
            for _ in range(4):
                transfer.send(answer)
        except (SdoAborted, StopIteration):
            pass


def test_the_abort_that_a_client_sends() -> None:
    assert abort_request(0x1017, 0, AbortCode.TIMED_OUT).hex() == "8017100000000405"


def test_every_abort_code_has_words() -> None:
    assert set(ABORT_TEXT) == set(AbortCode)


class ScriptedPort:
    """A port that answers each request with the next list of frames."""

    description = "scripted"

    def __init__(self, *answers: list[Frame]) -> None:
        self.sent: list[Frame] = []
        self._answers = list(answers)

    def send(self, frames: list[Frame]) -> None:
        self.sent += frames

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        return [(0, frame) for frame in self._answers.pop(0)] if self._answers else []

    def fileno(self) -> None:
        return None


ANSWER = Frame(0x592, bytes.fromhex("4300100091010800"))


def test_a_session_leaves_other_frames_aside() -> None:
    others = [
        Frame(0x712, b"\x05"),
        Frame(0x592, ANSWER.data, is_extended=True),
        Frame(0x592, ANSWER.data, is_remote=True),
    ]
    port = ScriptedPort(others, [ANSWER])
    assert SdoSession(port, 0x612, 0x592).upload(0x1000) == b"\x91\x01\x08\x00"
    assert port.sent == [Frame(0x612, bytes.fromhex("4000100000000000"))]


def test_a_session_without_an_answer_says_what_it_waited_for_and_aborts() -> None:
    port = ScriptedPort()
    with pytest.raises(BusError) as caught:
        SdoSession(port, 0x612, 0x592, limit_s=0.001).upload(0x1000)
    assert str(caught.value) == "scripted: no SDO answer (0x592) within 0.001 s when asked for 0x1000:00"
    assert port.sent[-1] == Frame(0x612, abort_request(0x1000, 0, AbortCode.TIMED_OUT))


def test_a_session_tells_the_server_when_it_gives_up_but_does_not_answer_an_abort() -> None:
    port = ScriptedPort([Frame(0x592, bytes.fromhex("4301100091010800"))])
    with pytest.raises(SdoAborted):
        SdoSession(port, 0x612, 0x592).upload(0x1000)
    assert port.sent[-1] == Frame(0x612, abort_request(0x1000, 0, AbortCode.COMMAND))
    port = ScriptedPort([Frame(0x592, bytes.fromhex("8000100000000206"))])
    with pytest.raises(SdoAborted):
        SdoSession(port, 0x612, 0x592).download(0x1000, 0, b"\0")
    assert len(port.sent) == 1
