"""The numbers of a URDF file, looked at one by one before anybody reads it: what is none is named with its place.

What the numbers mean must not enter.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Protocol


class Element(Protocol):
    """What is asked of an XML element."""

    tag: str

    def get(self, key: str) -> str | None:
        """The text of an attribute; None without it."""

    def iter(self) -> Iterator["Element"]:
        """The element and all that it contains."""


NUMBERS = {
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": dict.fromkeys(("damping", "friction"), 1),
    "mimic": dict.fromkeys(("multiplier", "offset"), 1),
}
"""How many numbers an attribute has, by element."""
MUST_STAND = {
    "mass": ("value",),
    "inertia": tuple(NUMBERS["inertia"]),
    "axis": ("xyz",),
    "limit": ("effort", "velocity"),
}
"""What URDF asks for in any such element."""


def number_problem(parts: Iterable[Element]) -> str | None:
    """The first attribute of links and joints that is not the numbers it should be: where, what, and what is right."""
    for part in parts:
        for element in part.iter():
            where = f"{part.tag} {part.get('name')!r}: <{element.tag}>"
            for key in MUST_STAND.get(element.tag, ()):
                if element.get(key) is None:
                    return f"{where} has no {key}; give it"
            for key, count in NUMBERS.get(element.tag, {}).items():
                text = element.get(key)
                if text is not None and not _is_numbers(text, count):
                    right = "a finite number" if count == 1 else f"{count} finite numbers with blanks between them"
                    return f"{where} {key} = {text!r}; must be {right}"
    return None


def _is_numbers(text: str, count: int) -> bool:
    words = text.split()
    try:
        return len(words) == count and all(map(math.isfinite, map(float, words)))
    except ValueError:
        return False
