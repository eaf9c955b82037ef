"""A bench in lockstep whose faults' beginnings and ends are noted."""

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.faults.turns import SetState
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock
from canarm_protocol.faults.script import parse_faults

CELL = load_cell("konkuk1")
OUTPUTS = OutputFrames(CELL, card_nodes(CELL))
COUNTER_CLOCKWISE = 0b10
DAC_COB_ID = 0x312  # its PDO maps four channels, of which two are wired
WAITING, ACTIVE, ENDED = SetState.WAITING, SetState.ACTIVE, SetState.ENDED
Happening = tuple[int, str, bool]


class Run:
    """A bench in lockstep whose faults' beginnings and ends are noted: (cycle, set, whether it begins)."""

    def __init__(self, seed: int = 0, is_started: bool = True) -> None:
        self.bench = FaultBench(CELL, Truth.from_settings(CELL), Clock.SYNC, seed)
        self.bench.start()
        self.happened: list[Happening] = []
        self.codes: list[tuple[float, ...]] = []
        """The currents commanded to the joints, cycle by cycle."""
        self.bench.faults.on_event = lambda event: self.happened.append((event.cycle, event.set_name, event.is_begin))
        if is_started:
            self.bench.receive(nmt_frame(NmtCommand.START))

    def inject(self, text: str) -> str:
        return self.bench.inject(parse_faults(text))

    def cycles(self, count: int, codes: tuple[int, int] = (120, 60)) -> None:
        for _ in range(count):
            for cob_id, data, *_ in OUTPUTS.frames(codes, (COUNTER_CLOCKWISE, COUNTER_CLOCKWISE)):
                self.bench.receive(Frame(cob_id, data.ljust(8, b"\0") if cob_id == DAC_COB_ID else data))
            self.bench.receive(sync_frame(None))
            self.codes.append(tuple(joint.command_a for joint in self.bench.world.state()))
            self.bench.records.clear()

    def begun(self, name: str = "a") -> list[int]:
        return [cycle for cycle, set_name, is_begin in self.happened if set_name == name and is_begin]

    def ended(self, name: str = "a") -> list[int]:
        return [cycle for cycle, set_name, is_begin in self.happened if set_name == name and not is_begin]

    def states(self) -> dict[str, SetState]:
        return {each.name: each.state for each in self.bench.faults.status()}


def fault_set(name: str, lines: str = "", tap: str = "joint2.latch", fault: str = "dropout") -> str:
    return f'[[set]]\nname = "{name}"\n{lines}\n[[set.fault]]\ntap = "{tap}"\nfault = "{fault}"\n'
