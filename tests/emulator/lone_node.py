"""A card's node alone, in virtual time and by raw frames, for tests of what CiA 301 says of it."""

import functools
import struct

import pytest

from canarm_emulator.cards.adc0809 import Adc0809Card
from canarm_emulator.cards.dac0808 import Dac0808Card
from canarm_emulator.cards.device import AdcDevice, DacDevice
from canarm_emulator.node.slave import Slave
from canarm_protocol.canopen.dictionary import Dictionary, load_dictionary
from canarm_protocol.canopen.frames import Frame, NmtCommand
from canarm_protocol.canopen.sdo import SdoAborted, download, upload

NODE_ID = 0x12
MASTER = 1
MILLISECOND = 1_000_000
START, STOP = NmtCommand.START, NmtCommand.STOP
READ_ONLY, NO_OBJECT, NO_SUBINDEX, LENGTH = 0x0601_0002, 0x0602_0000, 0x0609_0011, 0x0607_0010
INVALID, TOO_HIGH, TOO_LOW, STATE, NO_DATA = 0x0609_0030, 0x0609_0031, 0x0609_0032, 0x0800_0022, 0x0800_0024
UNSUPPORTED, NOT_MAPPABLE, PDO_TOO_LONG, TOO_LONG = 0x0601_0000, 0x0604_0041, 0x0604_0042, 0x0607_0012


@functools.cache
def dictionary_of(model: str) -> Dictionary:
    return load_dictionary(model, NODE_ID)


class PowerOn:
    """A clock that stands at power-on."""

    time_ns = 0


class Node:
    """A slave with its card, and what it sent, stamped."""

    def __init__(self, model: str = "dac0808") -> None:
        self.sent: list[tuple[int, Frame]] = []
        self.card = Dac0808Card(lambda channel, fraction: None)
        self.volts = [0.0] * 8
        adc_card = Adc0809Card(self.volts.__getitem__, 5.0, 100_000)
        dac = DacDevice(self.card, 8, 4, PowerOn())
        adc = AdcDevice(adc_card, self.volts.__getitem__, 8, 8, PowerOn())
        self.device = dac if model == "dac0808" else adc
        dictionary = dictionary_of(model)
        self.slave = Slave("card", NODE_ID, dictionary, self.device, lambda t, f: self.sent.append((t, f)), 1)
        self.slave.boot(0)

    def take(self) -> list[tuple[int, Frame]]:
        sent, self.sent = self.sent, []
        return sent

    def sdo(self, transfer, now_ns: int = 0) -> bytes:
        """Runs a client's transfer to its end. Raises `SdoAborted`."""
        request = next(transfer)
        while True:
            self.take()
            self.slave.on_sdo(0x600 + NODE_ID, request, now_ns)
            ((stamp, answer),) = self.take()
            assert (stamp, answer.can_id) == (now_ns, 0x580 + NODE_ID)
            try:
                request = transfer.send(answer.data)
            except StopIteration as done:
                return done.value

    def read(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self.sdo(upload(index, subindex)), "little")

    def write(self, index: int, subindex: int, value: int, size: int, now_ns: int = 0) -> None:
        self.sdo(download(index, subindex, value.to_bytes(size, "little", signed=value < 0)), now_ns)

    def refused(self, index: int, subindex: int, data: bytes) -> int:
        with pytest.raises(SdoAborted) as caught:
            self.sdo(download(index, subindex, data))
        assert caught.value.by_server
        return caught.value.code

    def outputs(self) -> list[int]:
        return [self.card.code(channel) for channel in range(4)]

    def rpdo(self, data: bytes, now_ns: int = 0) -> None:
        (layout,) = self.slave.pdos.rpdos
        self.slave.on_rpdo(layout, data, now_ns)

    def run_until(self, until_ns: int) -> None:
        while self.slave.next_due_ns <= until_ns:
            self.slave.run_timers(self.slave.next_due_ns)


def outputs_frame(*codes: int) -> bytes:
    return struct.pack(f"<{len(codes)}h", *[code << 7 for code in codes])
