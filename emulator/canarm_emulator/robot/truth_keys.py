"""What a key of `--truth` is, and how its value is read. Kinds of sensor and `truth.py` define the keys."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from canarm_protocol.cell.cell_messages import meant
from canarm_protocol.shown import printable, quoted

from ..errors import TruthError

SWITCH = {"false": 0.0, "true": 1.0}
"""Words for a switch, besides 0 and 1."""


@dataclass(frozen=True, slots=True)
class TruthKey:
    """One key of `--truth`. `minimum` and `maximum` are inclusive; a switch takes 0 or 1."""

    name: str
    unit: str
    nominal: float
    description: str
    minimum: float
    maximum: float
    is_switch: bool = False


@dataclass(frozen=True, slots=True)
class Parameter:
    """A true value that the command line can set: a key's last part, and its name where the truth is kept.

    Bounds keep the integrator stable and catch a wrong unit; they are not limits of any part.
    """

    leaf: str
    field: str
    unit: str
    description: str
    minimum: float
    maximum: float
    is_switch: bool = False

    def key(self, owner: str, nominal: float, limits: tuple[float, float] | None = None) -> TruthKey:
        """The key of one owner, with its own bounds if `limits` are given."""
        low, high = limits or (self.minimum, self.maximum)
        return TruthKey(f"{owner}.{self.leaf}", self.unit, nominal, self.description, low, high, self.is_switch)


def parse_value(keys: Mapping[str, TruthKey], name: str, text: str, option: str = "--truth") -> float:
    """The value of one setting, given in `option`. Raises `TruthError`: key, value, and what would be right."""
    key, given = keys.get(name), printable(f"{name}={text}")
    if key is None:
        found = meant(name, keys)
        hint = f"did you mean {' or '.join(map(quoted, found))}?" if found else "see `canarm check --keys`"
        raise TruthError(f"{option} {given}: no such key; {hint}")
    try:
        value = SWITCH[text.lower()] if key.is_switch and text.lower() in SWITCH else float(text)
    except ValueError:
        value = math.nan
    if key.is_switch and value not in (0.0, 1.0):
        raise TruthError(f"{option} {given}: must be 0 or 1, false or true ({key.description})")
    if not key.minimum <= value <= key.maximum:
        unit = f" {key.unit}" if key.unit else ""
        raise TruthError(
            f"{option} {given}: must be a number from {key.minimum:g} to {key.maximum:g}{unit} "
            f"({key.description}; nominal {key.nominal:g})"
        )
    return value
