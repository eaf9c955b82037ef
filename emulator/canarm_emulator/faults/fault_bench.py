"""A bench on which faults can be injected: a bench with a fault engine.

The faults are many modules, and most runs need none: they are loaded when they are first used.
"""

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.faults.script import FaultScript, clearing

from ..bench.bench import Bench
from ..robot.truth import Truth

if TYPE_CHECKING:
    from .engine import FaultEngine


class FaultBench(Bench):
    """A `Bench` with a fault engine, which serves the fault objects of its node as well."""

    def __init__(self, cell: Cell, truth: Truth, clock: Clock, seed: int, with_wire: bool = False) -> None:
        super().__init__(cell, truth, clock, seed, with_wire)
        self._seed = seed
        self._engine: FaultEngine | None = None
        self.on_script: Callable[[FaultScript], None] | None = None
        """Called with every fault script that has been accepted."""
        self.device.faults.attach(self)

    @property
    def faults(self) -> "FaultEngine":
        """The fault engine."""
        if self._engine is None:
            from .engine import FaultEngine

            self._engine = FaultEngine(self, self._seed)
            self._engine.on_event = self.device.faults.note
            self.attach_faults(self._engine)
        return self._engine

    def inject(self, script: FaultScript) -> str:
        """Carry out a fault script; returns what was done. Raises `FaultError` with the reason of a refusal."""
        done = self.faults.accept(script)
        if self.on_script is not None:
            self.on_script(script)
        if not self.bus.is_cycling:
            self.catch_up()
            self.faults.update(self.time_ns, self.cycle)
        return done

    def change_truth(self, truth: Truth) -> None:
        """Change the true robot from now on; active faults act on the new one."""
        if self._engine is None:
            super().change_truth(truth)
        else:
            self._engine.truth_point.change_base(truth, self.time_ns)

    def power_cycle(self) -> None:
        """End and forget all faults, then switch everything off and on again."""
        if self._engine is not None:
            self.inject(clearing())
        super().power_cycle()

    def plain_sets(self) -> list[dict[str, Any]]:
        """Every set that was accepted and not cleared, for JSON: `set`, `state`, `activations`, and when it acts."""
        return [] if self._engine is None else self._engine.plain_sets()

    def plain_catalogue(self) -> list[dict[str, Any]]:
        """What can be injected where, for JSON: one object per tap."""
        from .catalogue import as_plain, catalogue_of

        return as_plain(catalogue_of(self.cell))

    def load(self) -> None:
        """Load now what the first fault would need, which takes several cycles of the wall clock."""
        importlib.import_module(".engine", __package__)
