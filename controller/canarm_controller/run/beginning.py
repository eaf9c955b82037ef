"""The beginning of a run: joints are homed, empty hands close at an object on its stand, the trajectory is entered.

Frames, and the order of cycles, never enter.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import CardNode, InputSlot
from canarm_protocol.clock import Clock

from ..errors import ControllerError, TrajectoryError
from ..supervision.supervisor import Verdict
from .cycle_frames import CycleFrames
from .grasping import Grasping
from .homing import HOMING_FAILED, Homing
from .loop import ControlLoop
from .measuring import Measuring
from .state import State
from .supervised_run import SupervisedRun


class Beginning(SupervisedRun):
    """A run with what comes before its trajectory; `loop` is the one that follows it."""

    def __init__(
        self,
        cell: Cell,
        nodes: tuple[CardNode, ...],
        slots: tuple[InputSlot, ...],
        loop: ControlLoop,
        clock: Clock,
        ticks: int | None,
    ) -> None:
        waits = cell.object is not None and cell.object.on_stand
        grasping = self._grasping = Grasping(cell, slots, loop) if waits else None
        super().__init__(cell, loop)
        self._laden = self._watch, self._stop
        """Made before the run: there is no time for it within a cycle."""
        if grasping is not None:
            self._supervise(grasping.cell, grasping.loop)
        self._nodes, self._ticks = nodes, ticks
        self._measuring = Measuring(cell, clock, self.loop, self._watch)
        self._frames = CycleFrames(cell, nodes)
        self._homing: Homing | None = None
        self._is_rezeroed = False
        """Whether the next angles differ from the last ones because joints have been homed."""

    @property
    def is_empty(self) -> bool:
        """Whether its hands are still to close at an object on its stand."""
        return self._grasping is not None and self._grasping.is_empty

    @property
    def _is_beginning(self) -> bool:
        return self._homing is not None or self.is_empty

    @property
    def is_homing(self) -> bool:
        """Whether it is looking for its index marks."""
        return self._homing is not None and self.state is State.RUNNING

    def _weight_nm(self, pose_rad: Sequence[float]) -> Sequence[float]:
        """Torques that bear the arms at a pose, with what they hold now."""
        return self.loop.arm.gravity(pose_rad)

    def _begin_loop(self, codes: Sequence[int], pulses: Sequence[int]) -> None:
        loop = self.loop
        loop.begin(codes)
        if loop.search is None:
            self._enter()
        else:
            search = loop.search
            self._homing = Homing(
                self._nodes, self.cell.joint_names, search.marks, pulses, loop.search_ticks, search.within_rad
            )
        self._watch.start(loop.cycle.position_rad)

    def _enter(self) -> None:
        """The trajectory is entered: what comes before its beginning is not counted among the ticks of the run."""
        if self._ticks is not None and not self.is_empty:
            self._ticks += round(self.loop.trajectory.approach_s / self.loop.period_s)

    def _home(self, homing: Homing) -> None:
        """Look how far the homing is, before the measurements of a cycle are taken."""
        if homing.failure is not None:
            self._judge(homing.failure)
        elif homing.zeros is not None:
            self._homing, self._is_rezeroed = None, True
            try:
                self.loop.home(homing.zeros, self.tick)
            except TrajectoryError as error:
                self._judge(Verdict(HOMING_FAILED, str(error)))
            except ControllerError as error:
                self._judge_law(error)
            self._enter()

    def _grasp(self, grasping: Grasping) -> None:
        """The hands close once they rest at the object; then the loop that knows of it goes on."""
        tick = self.tick
        self._frames.move_hands(self.cell.hands, grasping.bits(tick))
        if not grasping.is_empty:
            self._grasping = grasping if grasping.borne(tick) else None
        elif grasping.is_due(tick):
            try:
                loop = grasping.hand_over(tick)
            except ControllerError as error:
                self._judge_law(error)
                return
            self.loop, (self._watch, self._stop) = loop, self._laden
            self._measuring.follow(loop, self._watch)
            self._watch.start(loop.cycle.position_rad)
            self._enter()
