"""The law of a running controller, with something else done in its `update`: compiled laws cannot be patched."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from canarm_controller.laws.base import ControlLaw, Cycle
from canarm_controller.run.loop import ControlLoop


class HookedLaw(ControlLaw):
    """All that `law` does but its `update`; under a name of its own, and with a feed-forward to be added."""

    name = "hooked"

    def __init__(self, law: ControlLaw, update: Callable[[Cycle], Any]) -> None:
        self.law, self._update = law, update

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        self.law.start(position_rad, velocity_rad_s, amplitude_rad)

    def update(self, cycle: Cycle) -> Any:
        return self._update(cycle)

    def shift(self, shift_rad: Sequence[float]) -> None:
        self.law.shift(shift_rad)

    def internals(self) -> Mapping[str, Sequence[float]]:
        return self.law.internals()


def hook_law(loop: ControlLoop, update: Callable[[Cycle], Any]) -> None:
    """From now on the loop's law computes its torques so."""
    loop.law = HookedLaw(loop.law, update)
