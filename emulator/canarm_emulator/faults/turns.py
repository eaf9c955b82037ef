"""The sets of an accepted fault script: the state of each, and when its trigger or its duration ends that state.

The engine begins and ends sets; what their faults do never enters.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

from canarm_protocol.faults.conditions import Condition
from canarm_protocol.faults.script import FaultSet, trigger_text

from .catalogue import PlannedFault
from .declaration import Fault, Tap

Values = Callable[[], Mapping[str, float]]
"""Gives the present true signals by name."""


class SetState(Enum):
    """Where a set stands."""

    WAITING = "waiting"
    ACTIVE = "active"
    ENDED = "ended"


class SetStatus(NamedTuple):
    """A set that was accepted: its state, and how often it has been active so far."""

    name: str
    state: SetState
    activations: int


@dataclass(slots=True, eq=False)
class Turn:
    """One set of a configuration at work."""

    declared: FaultSet
    condition: Condition | None
    planned: tuple[PlannedFault, ...]
    """Its faults, found and checked."""
    state: SetState = SetState.WAITING
    activations: int = 0
    begun_ns: int = 0
    is_pulled: bool = False
    """Triggered by hand."""
    was_true: bool = False
    faults: list[tuple[Tap, Fault]] = field(default_factory=list)
    failure: tuple[Fault, str] | None = None
    """Its first fault that has failed, and how."""

    def as_plain(self) -> dict[str, Any]:
        """For JSON: `set`, `state`, `activations`, and where there is one `duration_s`, `repeat`, and the `trigger`
        that it waits for.
        """
        declared = self.declared
        plain: dict[str, Any] = {"set": declared.name, "state": self.state.value, "activations": self.activations}
        if declared.duration_s is not None:
            plain["duration_s"] = declared.duration_s
        if declared.repeat > 1:
            plain["repeat"] = declared.repeat
        trigger = trigger_text(declared.trigger)
        return {**plain, "trigger": trigger} if trigger and self.state is SetState.WAITING else plain

    def may_begin(self, now_ns: int, begin_ns: int | None, cycle: int, values: Values) -> bool:
        """Whether its trigger holds. A condition must have been false before it triggers again."""
        if self.is_pulled:
            return True
        if self.activations and self.declared.period_s is not None:
            return now_ns - self.begun_ns >= round(self.declared.period_s * 1e9)
        trigger = self.declared.trigger
        if trigger.is_manual:
            return False
        if trigger.at_s is not None:
            return begin_ns is not None and now_ns - begin_ns >= round(trigger.at_s * 1e9)
        if trigger.cycle is not None:
            return begin_ns is not None and cycle >= trigger.cycle
        if self.condition is not None:
            if begin_ns is None:
                self.was_true = False
                return False
            was_true, self.was_true = self.was_true, self.condition.holds(values())
            return self.was_true and (not self.activations or not was_true)
        return True

    def is_over(self, now_ns: int) -> bool:
        """Whether its duration has passed."""
        duration_s = self.declared.duration_s
        return duration_s is not None and now_ns - self.begun_ns >= round(duration_s * 1e9)


@dataclass(slots=True, eq=False)
class Configuration:
    """The sets of one text."""

    turns: list[Turn]
    is_parallel: bool
    next_turn: int = 0
    """Index of the set whose turn it is in a sequence."""

    @property
    def is_done(self) -> bool:
        """Whether all of them have ended."""
        return all(turn.state is SetState.ENDED for turn in self.turns)

    def keep(self, turns: list[Turn]) -> None:
        """Forget all but these."""
        self.turns, self.next_turn = turns, 0
