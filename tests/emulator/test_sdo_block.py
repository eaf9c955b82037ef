"""SDO block transfer, against python-canopen's client and the frames of CiA 301, 7.2.4.3.10 to 7.2.4.3.16."""

import random
import struct

import canopen
import pytest

from canarm_emulator.node.sdo_block import crc_of
from canarm_emulator.node.sdo_server import BLOCK_TIMEOUT_NS, SdoServer
from canarm_emulator.node.store import ObjectStore
from canarm_protocol.canopen.sdo import AbortCode

TEXT, NUMBER, EMPTY, READ_ONLY = 0x2000, 0x2001, 0x2002, 0x2003


class Client(canopen.Network):
    """python-canopen's client, whose frames are answered before `send_message` returns."""

    def __init__(self) -> None:
        super().__init__()
        dictionary = canopen.ObjectDictionary()
        for index, name, data_type, access in (
            (TEXT, "text", canopen.objectdictionary.datatypes.DOMAIN, "rw"),
            (NUMBER, "number", canopen.objectdictionary.datatypes.UNSIGNED32, "rw"),
            (EMPTY, "empty", canopen.objectdictionary.datatypes.VISIBLE_STRING, "rw"),
            (READ_ONLY, "constant", canopen.objectdictionary.datatypes.UNSIGNED32, "ro"),
        ):
            variable = canopen.objectdictionary.ODVariable(name, index)
            variable.data_type, variable.access_type = data_type, access
            variable.default = "" if index == EMPTY else None if index == TEXT else 7
            dictionary.add_object(variable)
        self.store = ObjectStore(dictionary, lambda index, subindex: None, lambda index, subindex, data: False)
        self.server, self.now_ns = SdoServer(self.store), 0
        self.lost: set[int] = set()
        """Which frames of the client, counted from 0, never arrive."""
        self.sent = 0
        self.node = self.add_node(1, dictionary)
        self.node.sdo.RESPONSE_TIMEOUT = 0.05

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        number, self.sent = self.sent, self.sent + 1
        if number not in self.lost:
            for answer in self.server.answer(bytes(data), self.now_ns):
                self.notify(0x581, bytearray(answer), 0.0)

    def put(self, data: bytes, **options: object) -> None:
        with self.node.sdo.open(TEXT, 0, "wb", size=len(data), block_transfer=True, **options) as file:
            file.write(data)

    def get(self, index: int = TEXT, **options: object) -> bytes:
        with self.node.sdo.open(index, 0, "rb", block_transfer=True, **options) as file:
            return bytes(file.read())


@pytest.fixture
def client() -> Client:
    return Client()


def talk(client: Client, *requests: str) -> list[str]:
    return [answer.hex() for request in requests for answer in client.server.answer(bytes.fromhex(request), 0)]


@pytest.mark.parametrize("with_crc", [True, False])
@pytest.mark.parametrize("size", [1, 6, 7, 8, 14, 127 * 7 - 1, 127 * 7, 127 * 7 + 1, 5000])
def test_python_canopen_writes_and_reads_in_blocks(client, size, with_crc):
    data = random.Random(size).randbytes(size)
    client.put(data, request_crc_support=with_crc)
    assert client.store.read(TEXT, 0) == data
    assert client.get(request_crc_support=with_crc) == data


def test_the_crc_is_that_of_the_standard():
    # CiA 301, 7.2.4.3.16, and Koopman's tables: x^16 + x^12 + x^5 + 1 from 0 over "123456789".
    assert crc_of(b"123456789") == 0x31C3


def test_a_segment_that_got_lost_is_asked_for_again(client):
    data = random.Random(1).randbytes(2000)
    client.lost = {5, 100}
    client.put(data)
    assert client.store.read(TEXT, 0) == data


def test_a_client_that_lost_segments_of_an_upload_gets_them_again(client):
    client.put(bytes(range(30)))
    start = talk(client, "a400200004000000", "a300000000000000")
    assert start[0] == "c6002000" + struct.pack("<I", 30).hex()
    assert [frame[:2] for frame in start[1:]] == ["01", "02", "03", "04"]  # four segments a sub-block, as asked
    again = talk(client, "a202040000000000")  # two of them came
    assert again == ["010e0f1011121314", "0215161718191a1b", "831c1d0000000000"]
    end = talk(client, "a203040000000000")
    assert end == ["d5" + struct.pack("<H", crc_of(bytes(range(30)))).hex() + "0000000000"]  # 5 bytes of 7 are empty
    assert talk(client, "a100000000000000") == []
    assert client.get() == bytes(range(30))


def test_an_object_without_any_byte_is_read_in_blocks_and_in_segments(client):
    assert talk(client, "a402200004000000", "a300000000000000", "a201040000000000", "a100000000000000") == [
        "c602200000000000",
        "8100000000000000",
        "dd00000000000000",
    ]
    assert client.node.sdo[EMPTY].raw == ""


def test_a_wrong_crc_writes_nothing(client):
    requests = ["c600200003000000", "8161626300000000", "d1ffff0000000000"]
    answers = talk(client, *requests)
    assert answers[:2] == ["a40020007f000000", "a2017f0000000000"]
    assert answers[2] == "80002000" + struct.pack("<I", AbortCode.CRC).hex()
    assert client.store._values == {}


@pytest.mark.parametrize(
    ("requests", "code"),
    [
        (["c603200004000000"], AbortCode.READ_ONLY),
        (["c601200005000000"], AbortCode.TOO_LONG),
        (["c6002000ffffff7f"], AbortCode.OUT_OF_MEMORY),
        (["c600200002000000", "8161626300000000", "d1" + struct.pack("<H", crc_of(b"abc")).hex() + "0000000000"],
         AbortCode.TOO_LONG),
        (["a40020000000000000"[:16]], AbortCode.BLOCK_SIZE),
        (["a400200080000000"], AbortCode.BLOCK_SIZE),
        (["a409200004000000"], AbortCode.NO_OBJECT),
        (["a401200004000000", "a100000000000000"], AbortCode.COMMAND),
        (["a401200004000000", "a300000000000000", "a205040000000000"], AbortCode.SEQUENCE),
    ],
)  # fmt: skip
def test_what_cannot_be_is_aborted_and_the_channel_goes_on(client, requests, code):
    assert talk(client, *requests)[-1][8:] == struct.pack("<I", code).hex()
    assert client.node.sdo[NUMBER].raw == 7


def test_a_client_that_vanished_in_a_block_holds_up_nobody(client):
    talk(client, "c200200000000000", "0161626364656667")
    client.now_ns = BLOCK_TIMEOUT_NS + 1
    assert client.node.sdo[NUMBER].raw == 7


ZEROS = 14 * "0"
ABANDONED = {
    "before the first segment": ["c000200000000000"],
    "after a segment": ["c000200000000000", "0161626364656667"],
    "within the second sub-block": ["c000200000000000", *(f"{n:02x}{ZEROS}" for n in range(1, 128)), "01" + ZEROS],
    "after the last segment": ["c000200000000000", "8161626364656667"],
    "segmented": ["2100200064000000", "0061626364656667"],
    "an upload in segments": ["4000200000000000"],
}


@pytest.mark.parametrize("abandoned", ABANDONED.values(), ids=ABANDONED)
def test_a_client_that_gave_up_holds_up_nobody_also_where_time_stands_still(client, abandoned):
    for use in (
        lambda: client.node.sdo[NUMBER].raw,
        lambda: setattr(client.node.sdo[NUMBER], "raw", 7),
        lambda: client.put(b"a text of some length"),
        lambda: client.get(),
    ):
        client.put(b"before")
        talk(client, *abandoned)
        use()
    assert client.node.sdo[NUMBER].raw == 7
    assert client.now_ns == 0


def test_a_request_with_the_number_of_the_awaited_segment_is_answered_when_it_comes_again(client):
    talk(client, "c000200000000000", *(f"{number:02x}{ZEROS}" for number in range(1, 0x40)))
    assert talk(client, "4001200000000000") == []  # segment 0x40
    assert talk(client, "4001200000000000") == ["4301200007000000"]


def test_a_client_that_takes_its_time_between_two_segments_is_not_cut_off(client):
    """In lockstep three virtual seconds pass in an instant."""
    with client.node.sdo.open(TEXT, 0, "wb", size=30, block_transfer=True) as file:
        for start in range(0, 30, 5):
            file.write(bytes(range(start, start + 5)))
            client.now_ns += 2 * BLOCK_TIMEOUT_NS
    assert client.store.read(TEXT, 0) == bytes(range(30))


def test_another_request_ends_an_upload_in_blocks(client):
    client.put(bytes(1000))
    talk(client, "a400200004000000", "a300000000000000")
    assert client.node.sdo[NUMBER].raw == 7


def test_a_client_that_takes_its_time_between_two_blocks_gets_the_rest(client):
    """A master in a debugger, or on a slow machine: what continues an upload cannot be anything else."""
    client.put(bytes(range(200)))
    talk(client, "a400200004000000", "a300000000000000")
    client.now_ns = 10 * BLOCK_TIMEOUT_NS
    assert talk(client, "a204040000000000")[0].startswith("01")
