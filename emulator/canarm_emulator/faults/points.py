"""The points of the bench that stand behind taps: a fault changes a call there, installed only while it acts.

Faults at one point act in the order in which they began, each on the result of the one before.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from math import floor
from typing import TYPE_CHECKING

from canarm_protocol.cell.model import SENSOR_KINDS

from ..robot.truth import JointTruth, Truth
from ..signals import Distortion
from .declaration import Context, Fault, JointFault, SignalFault, Tap, TapKind

if TYPE_CHECKING:
    from ..bench.bench import Bench


class Point(ABC):
    """The faults that act at one place of the bench."""

    def add(self, fault: Fault, context: Context) -> None:
        """A fault begins."""
        fault.begin(context)
        self._add(fault, context)

    @abstractmethod
    def _add(self, fault: Fault, context: Context) -> None: ...

    @abstractmethod
    def remove(self, fault: Fault, now_ns: int) -> None:
        """A fault ends."""

    def drop(self, set_name: str | None = None) -> None:  # noqa: B027
        """Faults of this set, or all, were cleared: drop what they have held back."""

    def refresh(self, now_ns: int) -> None:  # noqa: B027
        """Update what varies with time; called once per cycle while any fault is here."""


class SignalPoint(Point):
    """A scalar tap. `install` puts a distortion into the signal path, or takes it out (None); `pass_on` sends an output
    through it again.
    """

    def __init__(
        self,
        tap: Tap,
        now: Callable[[], int],
        install: Callable[[Distortion | None], None],
        pass_on: Callable[[], None] | None = None,
    ) -> None:
        self._low, self._high = tap.low, tap.high
        self._is_whole = tap.kind in (TapKind.DAC_CODE, TapKind.ADC_CODE, TapKind.LATCH)
        self._now, self._install, self._pass_on = now, install, pass_on
        self._faults: list[SignalFault] = []

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, SignalFault)
        self._faults.append(fault)
        self._install(self._distort)
        self.refresh(context.now_ns)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """The signal path is as it was once the last fault has gone."""
        assert isinstance(fault, SignalFault)
        self._faults = [each for each in self._faults if each is not fault]  # equal ones are not the same
        if not self._faults:
            self._install(None)
        self.refresh(now_ns)

    def refresh(self, now_ns: int) -> None:
        """Pass outputs on again: faults change them between commands."""
        if self._pass_on is not None:
            self._pass_on()

    def _distort(self, value: float) -> float:
        now_ns, low, high = self._now(), self._low, self._high
        for fault in self._faults:
            value = fault.apply(value, now_ns)
            value = low if value < low else high if value > high else value
        return floor(value + 0.5) if self._is_whole else value


class TruthPoint(Point):
    """Changes the truth of joints; there is one for all arms, because they are one model."""

    def __init__(self, bench: "Bench") -> None:
        self._world = bench.world
        self._base: Truth | None = None
        self._faults: list[tuple[int, JointFault]] = []

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, JointFault)
        if not self._faults:
            self._base = self._world.truth
        self._faults.append((context.tap.joint, fault))
        self._change(context.now_ns)
        fault.strike(self._world, context.tap.joint)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """The truth is what the others leave."""
        self._faults = [each for each in self._faults if each[1] is not fault]
        self._change(now_ns)

    def refresh(self, now_ns: int) -> None:
        """The world changes where a fault varies with time."""
        if any(fault.varies for _, fault in self._faults):
            self._change(now_ns)

    def change_base(self, truth: Truth, now_ns: int) -> None:
        """Change the truth on which the faults act."""
        if self._faults:
            self._base = truth
            self._change(now_ns)
        else:
            self._world.change(truth)

    def _change(self, now_ns: int) -> None:
        base = self._base
        assert base is not None
        joints: list[JointTruth] = list(base.joints)
        for joint, fault in self._faults:
            joints[joint] = fault.change(joints[joint], now_ns)
        truth = replace(base, joints=tuple(joints))
        if truth != self._world.truth:
            self._world.change(truth)


def signal_point(bench: "Bench", tap: Tap) -> SignalPoint:
    """The point of a scalar tap or of a latch."""
    rack, world, joint = bench.rack, bench.world, tap.joint

    def now() -> int:
        return bench.time_ns

    if tap.kind is TapKind.SENSOR:
        quantity = SENSOR_KINDS[tap.name.rsplit(".", 1)[1]].quantity
        return SignalPoint(tap, now, lambda distort: rack.distort_input(joint, quantity, distort))
    if tap.node_id:
        card, channel = rack.cards[tap.node_id], tap.channel - 1
        refresh = card.refresh
        return SignalPoint(
            tap,
            now,
            lambda distort: card.distort(channel, distort),
            None if refresh is None else lambda: refresh(channel),
        )
    stage = tap.name.removeprefix(f"{bench.cell.joint_names[joint]}.")
    return SignalPoint(
        tap, now, lambda distort: world.distort_drive(joint, stage, distort), lambda: world.refresh_command(joint)
    )
