"""Faults that no controller can detect with these sensors, or make safe, each with the reason. Kept by hand.

A declaration covers a cell of the matrix only if it is neither tolerated nor detected in time; one that covers no
cell any more is out of date, and the summary says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from .plan import MatrixCell


@dataclass(frozen=True, slots=True)
class Declared:
    """Patterns of tap and fault, and why they are undetectable."""

    tap: str
    fault: str
    reason: str

    def covers(self, tap: str, fault: str) -> bool:
        """Whether it covers the fault at the tap."""
        return fnmatchcase(tap, self.tap) and fnmatchcase(fault, self.fault)


DECLARED_UNDETECTABLE: tuple[Declared, ...] = (
    Declared(
        "adc.channel3",
        "drift",
        "the model cannot tell a slow drift of the tachometer from a payload, so that only its integral shows it, "
        "against the potentiometer: 25 ms after the floor it is 0.8 LSB, of which the filter shows less than the "
        "limit, 0.65 LSB; a sound robot reaches 0.48. It is found after 40 ms",
    ),
)

BEYOND_CONTROL: tuple[Declared, ...] = (
    Declared(
        "joint*.wire",
        "wire-broken",
        "without its wire the link falls as gravity has it, 3 g / 2 a = 82 rad/s2 for joint3 held out level: past "
        "3 rad/s in 37 ms; its motor stands still by then, and so would a brake on its shaft",
    ),
    Declared(
        "joint*.wire",
        "wire-slack",
        "with brakes alone: the link falls through the slack before the wire is taut, at up to 82 rad/s2 over twice 5 "
        "degrees, to sqrt(2 * 82 * 0.17) = 5 rad/s, while its brake holds the motor",
    ),
    Declared(
        "joint*.link",
        "collision",
        "with brakes alone: a hit of 0.05 N m s makes a link of 0.0065 kg m2 on an elastic wire 7.7 rad/s fast at once",
    ),
    Declared(
        "joint*.link",
        "joint-jam",
        "with brakes alone: the link that is stopped dead passes its momentum on, at once",
    ),
)
"""Dangerous faults after which no controller can bring the arm to a safe state in time."""

HIGHEST_SHARE = 0.1
"""At most this share of the cells may be undetectable."""


def declared(cell: MatrixCell, table: Sequence[Declared] = DECLARED_UNDETECTABLE) -> Declared | None:
    """The declaration that covers `cell`, if there is one."""
    return next((each for each in table if each.covers(cell.tap, cell.fault)), None)
