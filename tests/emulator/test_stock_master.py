"""python-canopen's stock master drives the emulated cards, from nothing but their EDS files, in virtual time."""

import io
from typing import Any

import canopen
import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.dictionary import eds_text
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import bench_dictionary
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
DAC, LATCH, ADC = 0x12, 0x13, 0x14
SILENT = {f"{joint}.noise_lsb": "0" for joint in CELL.joint_names}
MILLISECOND = 1_000_000


class Link(canopen.Network):
    """A network without a bus: what the master sends is answered before `send_message` returns."""

    def __init__(self, bench: FaultBench) -> None:
        super().__init__()
        self.bench = bench
        self.deliver()

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        self.bench.receive(Frame(can_id, bytes(data), is_remote=remote), self)
        self.deliver()

    def deliver(self) -> None:
        """Hand over what the nodes sent, but for remote frames, which the library would take for data."""
        records, self.bench.records = self.bench.records, []
        for time_ns, frame, origin in records:
            if origin is None and not frame.is_remote:
                self.notify(frame.can_id, bytearray(frame.data), time_ns * 1e-9)

    def card(self, node_id: int) -> canopen.RemoteNode:
        model = next(card.model for card in CELL.card if card.node_id == node_id)
        eds = io.StringIO(eds_text(model))
        eds.name = f"{model}.eds"
        return self.add_node(node_id, eds)

    def let_pass(self, time_ns: int) -> None:
        self.bench.advance(self.bench.time_ns + time_ns)
        self.deliver()


@pytest.fixture
def link() -> Link:
    bench = FaultBench(CELL, Truth.from_settings(CELL, SILENT), Clock.SYNC, seed=0)
    bench.start()
    return Link(bench)


def test_nodes_boot_up_answer_sdo_and_show_who_they_are(link: Link) -> None:
    for node_id, name, product in (
        (DAC, "DAC0808 card", 0x808),
        (LATCH, "SC300 direction latch", 0x300),
        (ADC, "ADC0809 card", 0x809),
    ):
        node = link.card(node_id)
        assert node.sdo["Manufacturer device name"].raw == name
        assert node.sdo["Identity object"]["Product code"].raw == product
        assert node.sdo[0x2000].raw == Clock.SYNC.value
        boot_ups: list[int] = []
        node.nmt.add_heartbeat_callback(boot_ups.append)
        node.nmt.state = "RESET"
        assert boot_ups == [0]
        assert node.nmt.state == "PRE-OPERATIONAL"


def test_every_object_of_every_eds_can_be_read(link: Link) -> None:
    for node_id in (DAC, LATCH, ADC):
        node = link.card(node_id)
        for entry in node.object_dictionary.values():
            if isinstance(entry, canopen.objectdictionary.ODVariable):
                node.sdo[entry.index].raw  # noqa: B018
            else:
                # The error history has only as many entries as there were errors (CiA 301, 7.5.2.4).
                for subindex in [0] if entry.index == 0x1003 else entry.subindices:
                    node.sdo[entry.index][subindex].raw  # noqa: B018


def test_the_library_gets_abort_codes(link: Link) -> None:
    dac = link.card(DAC)
    for index, subindex, data, code in (
        (0x1000, 0, b"\0\0\0\0", 0x0601_0002),
        (0x5000, 0, b"\0", 0x0602_0000),
        (0x1018, 9, b"\0", 0x0609_0011),
        (0x6411, 1, b"\xff\xff", 0x0609_0032),
    ):
        with pytest.raises(canopen.SdoAbortedError) as caught:
            dac.sdo.download(index, subindex, data)
        assert caught.value.code == code


def test_the_library_reads_in_blocks_and_the_channel_stays_usable(link: Link) -> None:
    dac = link.card(DAC)
    with dac.sdo.open(0x1008, 0, "rb", block_transfer=True) as file:
        assert file.read() == b"DAC0808 card"
    assert dac.sdo[0x1008].raw == "DAC0808 card"


def test_a_node_is_added_with_the_eds_that_the_card_holds(link: Link) -> None:
    """As python-canopen documents it: `network.add_node(6, upload_eds=True)`."""
    for card in CELL.card:
        node = link.add_node(card.node_id, upload_eds=True)
        assert node.sdo["Manufacturer device name"].raw == link.card(card.node_id).sdo[0x1008].raw
        assert sorted(node.object_dictionary) == sorted(link.card(card.node_id).object_dictionary)


def test_the_library_configures_pdos_and_runs_a_synchronous_cycle(link: Link) -> None:
    dac, latch, adc = link.card(DAC), link.card(LATCH), link.card(ADC)
    adc.tpdo.read()
    adc.tpdo[2].clear()
    adc.tpdo[2].add_variable("Read analogue input 16-bit", "Analogue input 2")
    adc.tpdo[2].add_variable("Error register")
    adc.tpdo[2].trans_type = 2
    adc.tpdo[3].enabled = False
    adc.tpdo.save()
    for node in (dac, latch):
        node.rpdo.read()
    heard: list[tuple[float, int]] = []
    adc.tpdo[2].add_callback(lambda pdo: heard.append((pdo.timestamp, pdo[0].raw)))
    link.nmt.state = "OPERATIONAL"
    dac.rpdo[2]["Write analogue output 16-bit.Analogue output 2"].raw = 0x40 << 7
    dac.rpdo[2].transmit()
    latch.rpdo[1]["Write digital outputs 8-bit.Digital outputs 1 to 8"].raw = 0b1000
    latch.rpdo[1].transmit()
    assert link.bench.world.state()[1].command_a == 0.0
    for counter in range(1, 5):
        link.sync.transmit(counter)
    # 0x40 of 255 steps of 1.5 A, counter-clockwise; every second SYNC one channel of 100 µs; 128 is 0 degrees
    assert link.bench.world.state()[1].command_a == pytest.approx(1.5 * 0x40 / 255)
    assert [time_s for time_s, _ in heard] == pytest.approx([0.0025 + 0.0001, 0.0075 + 0.0001])
    assert heard[0][1] >> 7 == 128


def test_the_library_sees_a_lost_heartbeat_and_its_return(link: Link) -> None:
    dac = link.card(DAC)
    dac.sdo[0x1016][1].raw = 1 << 16 | 100
    dac.sdo[0x6444][1].raw = 0x2000_0000
    link.nmt.state = "OPERATIONAL"
    link.send_message(0x701, b"\x05")
    link.let_pass(99_999_999)
    assert dac.emcy.log == []
    link.let_pass(1)
    (lost,) = dac.emcy.active
    assert (lost.code, lost.register, lost.timestamp) == (0x8130, 0x11, pytest.approx(0.1))
    assert dac.sdo[0x6411][1].raw == 0x2000
    dac.sdo[0x1017].raw = 10
    states: list[int] = []
    dac.nmt.add_heartbeat_callback(states.append)
    link.let_pass(10 * MILLISECOND)
    assert states == [127]
    link.send_message(0x701, b"\x05")
    assert dac.emcy.active == []
    assert dac.sdo[0x1001].raw == 0


def test_remote_frames_are_not_taken_for_data(link: Link) -> None:
    """The services that they name are not asked for so; the frames do nothing."""
    dac = link.card(DAC)
    link.nmt.state = "OPERATIONAL"
    for can_id in (0x300 + DAC, 0x284, 0x000, 0x080):
        link.send_message(can_id, b"", remote=True)
    assert link.bench.ignored_frames == 4
    assert dac.emcy.log == []


def test_the_library_reads_the_bench_node_too() -> None:
    bench = FaultBench(CELL, Truth.from_settings(CELL, SILENT), Clock.SYNC, seed=0)
    bench.start()

    class BenchLink(canopen.Network):
        def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
            bench.receive_bench(Frame(can_id, bytes(data)), self)
            for time_ns, frame, origin in bench.bench_records:
                if origin is None:
                    self.notify(frame.can_id, bytearray(frame.data), time_ns * 1e-9)
            bench.bench_records.clear()

    node = BenchLink().add_node(0x70, bench_dictionary(CELL))
    assert node.sdo[0x2100][1].raw == pytest.approx(0.349066)  # 20 degrees, in single precision
    node.sdo[0x2130][2].raw = "alpha, in A"
    assert node.sdo[0x2130][2].raw == "alpha, in A"
    assert bench.records[3:] == []  # the boot-up messages of the cards and nothing else
