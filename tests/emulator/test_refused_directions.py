"""Both direction bits of a joint at once: refused by SDO, told by EMCY where an RPDO has them, counted, no torque."""

import pytest

from canarm import Rig, State
from canarm_emulator.cards.device import LatchDevice
from canarm_emulator.cards.sc300 import Sc300Card
from canarm_emulator.node.slave import Slave
from canarm_protocol.canopen.dictionary import load_dictionary
from canarm_protocol.canopen.frames import Frame, NmtCommand
from canarm_protocol.canopen.sdo import SdoAborted, download, upload
from canarm_protocol.cell import bench_objects

NODE_ID = 0x13
REFUSED, WELL = Frame(0x80 + NODE_ID, bytes.fromhex("00ff810000000000")), Frame(0x80 + NODE_ID, bytes(8))
MS = 1_000_000


class PowerOn:
    time_ns = 0


class Latch:
    """The latch card with joints at its first two channels."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, Frame]] = []
        self.bits = [0] * 4
        self.card = Sc300Card(self.bits.__setitem__)
        device = LatchDevice(self.card, (0, 1), PowerOn())
        dictionary = load_dictionary("sc300", NODE_ID)
        self.slave = Slave("latch", NODE_ID, dictionary, device, lambda now_ns, f: self.sent.append((now_ns, f)), 1)
        self.slave.boot(0)
        self.slave.on_nmt(NmtCommand.START, 0)
        self.take()

    def take(self) -> list[tuple[int, Frame]]:
        sent, self.sent = self.sent, []
        return sent

    def sdo(self, transfer) -> bytes:
        request = next(transfer)
        while True:
            self.slave.on_sdo(0x600 + NODE_ID, request, 0)
            ((_, answer),) = self.take()
            try:
                request = transfer.send(answer.data)
            except StopIteration as done:
                return done.value

    def cycle(self, bits: int, now_ns: int) -> list[tuple[int, Frame]]:
        """An RPDO, and the SYNC at which it acts."""
        (layout,) = self.slave.pdos.rpdos
        self.slave.on_rpdo(layout, bytes((bits,)), now_ns)
        self.slave.on_sync(b"", now_ns + 1)
        return self.take()


@pytest.mark.parametrize("index", [0x6200, 0x6207])
def test_by_sdo_it_is_an_invalid_value_and_nothing_changes(index: int) -> None:
    latch = Latch()
    latch.sdo(download(index, 1, b"\x06"))
    with pytest.raises(SdoAborted) as caught:
        latch.sdo(download(index, 1, b"\x0e"))
    assert caught.value.code == 0x0609_0030  # invalid value for parameter (CiA 301)
    assert latch.sdo(upload(index, 1)) == b"\x06"


def test_bits_without_a_joint_may_be_anything() -> None:
    latch = Latch()
    latch.sdo(download(0x6200, 1, b"\xf6"))
    assert latch.bits == [2, 1, 3, 3]
    assert latch.cycle(0xF9, 1) == []


def test_bits_that_the_mask_leaves_alone_are_part_of_the_value() -> None:
    latch = Latch()
    latch.sdo(download(0x6200, 1, b"\x02"))
    latch.sdo(download(0x6208, 1, b"\x01"))
    with pytest.raises(SdoAborted):
        latch.sdo(download(0x6200, 1, b"\x01"))


def test_in_an_rpdo_it_is_one_emcy_until_a_right_one_acts() -> None:
    latch = Latch()
    assert latch.cycle(0b0110, 10) == []
    assert latch.cycle(0b0111, 20) == [(21, REFUSED)]
    assert latch.cycle(0b1110, 30) == []
    assert latch.sdo(upload(0x1001, 0)) == b"\x81"  # generic and manufacturer-specific
    assert latch.cycle(0b0110, 40) == [(41, WELL)]
    assert latch.sdo(upload(0x1003, 1)) == b"\x00\xff\x00\x00"


def test_a_master_that_turns_a_joint_both_ways_drives_nothing_is_told_so_and_counted() -> None:
    with Rig("konkuk1", seed=0) as rig:
        rig.run(seconds=1.0)
        bench = rig._bench
        count = bench.device.getter(bench_objects.REFUSED_DIRECTIONS, 1)
        assert count is not None
        assert count() == 0
        outbox = rig.controller.outbox
        outbox.insert(len(outbox) - 1, Frame(0x213, b"\x03"))  # just before SYNC, so that it acts
        rig.run(seconds=0.1)
        assert rig.detected("card-emergency", "latch")
        assert rig.state is not State.RUNNING
        assert "both ways at once" in str(rig.reason)
        assert rig.joints["joint2"].span("command_a").value[-1] == 0.0
        assert count() == 1
