"""What the matrix runs: its cells, one per fault at a tap, and the scenario of a run. Nothing runs here."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from canarm_emulator.faults.catalogue import catalogue_of
from canarm_emulator.faults.declaration import TapKind
from canarm_protocol.cell.model import Cell

from ..open_cell import open_cell
from ..usage import DEFAULT_CELL, DEFAULT_LAW, DEFAULT_TRAJECTORY

INJECTED_S = 2.8
"""When a fault begins unless it is said or drawn. The motion has blended in and the laws have adapted; on konkuk1's
sine both joints move then, at 83 and 60 % of their highest speeds, and accelerate at 56 and 80 % of their highest
accelerations."""
OBSERVED_S = 2.2
"""How long it acts: nearly a period of either joint, so that every part of the motion meets it."""


OF_THE_ARM = frozenset(
    (
        TapKind.DAC_CODE,
        TapKind.OPAMP,
        TapKind.CURRENT,
        TapKind.LATCH,
        TapKind.SUPPLY,
        TapKind.MOTOR,
        TapKind.BRAKE,
        TapKind.DRIVE_WIRE,
        TapKind.LINK,
        TapKind.GRIP,
    )
)
"""Taps behind the cards' outputs: faults there mislead nobody. Those that drive the arm are declared dangerous."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """What a run and its twin have in common: cell and settings, law and motion, seed, true robot, and the onset.

    `truth` is what `--truth` takes; `at_s` is when the fault begins, from the first SYNC.
    """

    cell: str = DEFAULT_CELL
    settings: tuple[tuple[str, str], ...] = ()
    law: str = DEFAULT_LAW
    trajectory: str = DEFAULT_TRAJECTORY
    seed: int = 0
    truth: tuple[tuple[str, str], ...] = ()
    at_s: float = INJECTED_S

    def load(self) -> Cell:
        """The cell. Raises `CellError`."""
        return open_cell(self.cell, dict(self.settings))


@dataclass(frozen=True, slots=True)
class MatrixCell:
    """One cell of the matrix: a fault at a tap, with its default parameters."""

    tap: str
    fault: str
    family: str
    needs_wire: bool
    is_dangerous: bool
    """Whether it is declared able to drive the arm."""
    may_mislead: bool = True
    """Whether it gives controller or cards wrong information."""
    lets_go: bool = False
    """Whether it makes a hand lose the object that two robots carry."""

    @property
    def name(self) -> str:
        """Tap and fault."""
        return f"{self.tap} {self.fault}"


def cells_of(cell: Cell, only: Sequence[str] = ()) -> list[MatrixCell]:
    """The matrix of `cell` in the order of the signal path.

    With `only`, just the cells that match one of its patterns (`*`, `?`) by tap, fault, family or "TAP FAULT".
    """
    everything = [
        MatrixCell(
            tap.name,
            fault.name,
            fault.family.value,
            fault.needs_wire,
            fault.is_dangerous,
            tap.kind not in OF_THE_ARM,
            tap.is_of_a_hand,
        )
        for tap, fault, _ in catalogue_of(cell)
    ]
    return [each for each in everything if not only or any(_fits(each, pattern) for pattern in only)]


def _fits(cell: MatrixCell, pattern: str) -> bool:
    return any(fnmatchcase(text, pattern) for text in (cell.tap, cell.fault, cell.family, cell.name))
