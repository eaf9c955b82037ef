"""A run as its detectors see it: detections are logged and reported, and may stop the robot.

Frames and the order of cycles never enter.
"""

from collections.abc import Callable, Collection

from canarm_protocol.cell.model import Cell

from ..errors import ControllerError
from ..supervision.arm_watch import ArmWatch
from ..supervision.detection import DETECTORS, OF_A_DRIVE, OF_ALL_JOINTS, Detection, Reaction
from ..supervision.supervisor import Verdict, law_verdict
from .detection_log import DetectionLog
from .loop import ControlLoop
from .safe_stop import SafeStop
from .state import State


class SupervisedRun:
    """State, detections and verdict of one run."""

    def __init__(self, cell: Cell, loop: ControlLoop) -> None:
        self.cell = cell
        self.state = State.IDLE
        self.tick = -1
        """The cycle that the last SYNC began; -1 before the first."""
        self.verdict: Verdict | None = None
        self.on_detection: Callable[[Detection], None] | None = None
        """Called with every detection; may raise as `on_tick` may."""
        self.without: Collection[str] = ()
        """Names of detectors that are switched off."""
        self.starved_by: Callable[[str, str], str | None] = lambda detector, detail: None
        """Returns the lack of computing time that explains a detection; set by the owner of the clock."""
        self.interruption: KeyboardInterrupt | None = None
        """Ctrl-C that landed in the law's code, for an owner who passes it on once the robot is safe."""
        self._log = DetectionLog()
        self._joints_of = _joints_by_place(cell)
        self._supervise(cell, loop)

    def _supervise(self, cell: Cell, loop: ControlLoop) -> None:
        """Watch the arms of `cell` under `loop` from here on."""
        self.loop = loop
        bears_weight = not loop.law.takes_feedforward or loop.feedforward_kind != "none"
        self._watch = ArmWatch(
            cell, loop.arm, loop.law.following_error_lsb, self._detect_at_joint, bears_weight=bears_weight
        )
        keeps = [robot.holds for robot in cell.robot for _ in robot.joint]
        self._stop = SafeStop(loop, self._watch.safe_hold, self._watch.standing_rad_s, keeps)

    @property
    def detections(self) -> list[Detection]:
        """All detections, oldest first, including the one that stopped the robot."""
        return self._log.entries

    @property
    def degraded(self) -> list[Detection]:
        """Detections after which the run went on with reduced ability; empty while all is well."""
        return [each for each in self.detections if each.reaction in (Reaction.DEGRADED, Reaction.SUBSTITUTE)]

    def guard(self, tell: Callable[[], None]) -> None:
        """Call a function that records or reports the run; its failure stops the robot safely, as with `on_tick`."""
        try:
            tell()
        except ControllerError as error:
            self._judge_law(error)
        except OSError as error:
            self._judge(Verdict("recording-failed", str(error)))

    def _judge_law(self, error: ControllerError) -> None:
        self._keep_interruption(error)
        self._judge(law_verdict(error))

    def _keep_interruption(self, error: ControllerError) -> None:
        if isinstance(error.__cause__, KeyboardInterrupt):
            self.interruption = error.__cause__

    def _judge(self, verdict: Verdict | None) -> None:
        if verdict is None:
            return
        if self.state in (State.RUNNING, State.STOPPING):
            reaction = verdict.reaction or DETECTORS[verdict.detector].reaction
            reaction = reaction if reaction.stops else Reaction.OFF
            self._detect(verdict.detector, verdict.where, verdict.detail, reaction)

    def _detect_at_joint(self, detector: str, joint: int, detail: str, reaction: Reaction | None) -> bool:
        name = self.cell.joint_names[joint]
        return self._detect(detector, name, f"{name}: {detail}", reaction)

    def _detect_at_node(self, detector: str, node_id: int, detail: str, reaction: Reaction | None) -> bool:
        return self._detect(detector, f"0x{node_id:02X}", detail, reaction)

    def _detect(self, detector: str, where: str | None, detail: str, reaction: Reaction | None = None) -> bool:
        """Log a detection and react to it. False if the detector is switched off."""
        if detector in self.without:
            return False
        reaction = reaction or DETECTORS[detector].reaction
        if reaction is Reaction.OFF and self._stop.keeps_all:
            reaction = Reaction.HOLD
        if (cause := self.starved_by(detector, detail)) is not None:
            if not reaction.stops:
                return False
            detail = f"{cause}; {detector} followed from it"
            detector, where = "deadline-missed", None
        is_noted, is_end = self.state in (State.RUNNING, State.STOPPING), reaction.stops and self.state is State.RUNNING
        if is_end:
            self.verdict = Verdict(detector, detail, where)
            self.state = State.STOPPING
            self._stop.begin(reaction is Reaction.HOLD)
        elif reaction is Reaction.OFF:
            self._stop.fail()
        if reaction.stops and is_noted:
            everywhere = range(len(self.cell.joints)) if detector in OF_ALL_JOINTS else ()
            self._stop.doubt(self._joints_of.get(where or "", everywhere), detector in OF_A_DRIVE)
        if is_noted:  # after the stop: what cannot be told is a reason to stop, and must not be one again and again
            detection = self._log.note(Detection(detector, where, max(self.tick, 0), detail, reaction), is_end)
            tell = self.on_detection
            if detection is not None and tell is not None:
                self.guard(lambda: tell(detection))
        return True


def _joints_by_place(cell: Cell) -> dict[str, tuple[int, ...]]:
    """The joints that a detection speaks of, by what it names: a joint, or a card, to which several are wired."""
    places: dict[str, tuple[int, ...]] = {name: (joint,) for joint, name in enumerate(cell.joint_names)}
    for card in cell.card:
        places[card.name] = tuple(sorted({cell.far_joint(card, channel) for channel in card.channel}))
    return places
