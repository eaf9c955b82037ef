"""What the rules of a CANopen slave cost: SYNC to the last TPDO, against a node of the `canopen` library without any.

Both sides run in this process, without a bus or a world: the ADC's conversions are left out on our side, and
the library's node, which knows no SYNC, is told to send its two TPDOs. Blocks alternate.
"""

import io
import statistics
import time
from collections.abc import Callable

import can
import canopen
from measure import Ratio, Row

from canarm_emulator.cards.adc0809 import Adc0809Card
from canarm_emulator.cards.device import AdcDevice
from canarm_emulator.node.slave import Slave
from canarm_protocol.canopen.dictionary import eds_text, load_dictionary
from canarm_protocol.canopen.frames import Frame, NmtCommand

NODE_ID = 0x14
CYCLES = 5000
BLOCKS = 21


class _PowerOn:
    """A clock that stays at power-on."""

    time_ns = 0


class _Nowhere:
    """A bus that discards messages."""

    def send(self, message: can.Message) -> None:
        """Discard `message`."""


def _ours() -> Callable[[int], None]:
    sent: list[Frame] = []
    device = AdcDevice(Adc0809Card(lambda channel: 1.0, 5.0, 100_000), lambda channel: 1.0, 8, 8, _PowerOn())
    dictionary = load_dictionary("adc0809", NODE_ID)
    slave = Slave("adc", NODE_ID, dictionary, device, lambda _, frame: sent.append(frame), 1)
    slave.boot(0)
    slave.on_nmt(NmtCommand.START, 0)

    def cycle(number: int) -> None:
        for layout in slave.on_sync(bytes((number % 240 + 1,)), number):
            slave.pdos.send(layout, number)
        if len(sent) > 1000:
            sent.clear()

    return cycle


def _theirs(sets_values: bool) -> Callable[[int], None]:
    eds = io.StringIO(eds_text("adc0809"))
    eds.name = "adc0809.eds"
    node = canopen.LocalNode(NODE_ID, eds)
    network = canopen.Network(bus=_Nowhere())
    network.add_node(node)
    node.tpdo.read(from_od=True)
    node.nmt.state = "OPERATIONAL"
    pdos = [node.tpdo[2], node.tpdo[3]]

    def cycle(number: int) -> None:
        for pdo in pdos:
            if sets_values:
                for variable in pdo:
                    variable.raw = 6528
            pdo.transmit()

    return cycle


def _cycle_s(cycle: Callable[[int], None]) -> float:
    started = time.process_time()
    for number in range(CYCLES):
        cycle(number)
    return (time.process_time() - started) / CYCLES


def rows() -> list[Row]:
    """The rows of the table."""
    our_cycle, setting_cycle, sending_cycle = _ours(), _theirs(sets_values=True), _theirs(sets_values=False)
    ours, setting, sending = [], [], []
    for _ in range(BLOCKS):
        ours.append(_cycle_s(our_cycle))
        setting.append(_cycle_s(setting_cycle))
        sending.append(_cycle_s(sending_cycle))
    what = "SYNC to the last TPDO, one node"
    return [
        Row(what, "LocalNode sets and sends the same", Ratio.of(ours, setting), "<= 5",
            f"{statistics.median(ours) * 1e6:.1f} us, {statistics.median(setting) * 1e6:.1f} us"),
        Row(what, "LocalNode sends the same, set before", Ratio.of(ours, sending), "<= 5",
            f"{statistics.median(ours) * 1e6:.1f} us, {statistics.median(sending) * 1e6:.1f} us"),
    ]  # fmt: skip
