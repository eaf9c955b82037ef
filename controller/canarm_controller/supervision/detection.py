"""The table of detectors: names, reactions, descriptions of thresholds, and debounce."""

from dataclasses import dataclass
from enum import StrEnum


class Reaction(StrEnum):
    """The reaction to a detection, from mildest to strictest."""

    CONTINUE = "continue"
    """It is only reported."""
    DEGRADED = "degraded"
    """The law goes on; the run is shown as degraded."""
    SUBSTITUTE = "substitute"
    """A sensor is replaced by the others and the model; the run is shown as degraded."""
    HOLD = "safe-stop-hold"
    """The arm is brought to a standstill and held, then its torque is switched off."""
    OFF = "safe-stop-off"
    """Torque off at once."""

    @property
    def stops(self) -> bool:
        """Whether the run ends."""
        return self in (Reaction.HOLD, Reaction.OFF)


@dataclass(frozen=True, slots=True)
class Detection:
    """A detection: detector, joint or node (None: the run as a whole), cycle, detail and reaction."""

    detector: str
    where: str | None
    tick: int
    detail: str
    reaction: Reaction

    def __str__(self) -> str:
        return f"{self.detector}: {self.detail}"


@dataclass(frozen=True, slots=True)
class Detector:
    """A row of the table. `debounce_cycles` is how long the condition must hold before the reaction."""

    name: str
    reaction: Reaction
    debounce_cycles: int
    condition: str


def _row(name: str, reaction: Reaction, debounce_cycles: int, condition: str) -> tuple[str, Detector]:
    return name, Detector(name, reaction, debounce_cycles, condition)


DETECTORS: dict[str, Detector] = dict(
    (
        _row("foreign-master", Reaction.OFF, 1, "SYNC, heartbeat or TIME that another node sent in our name"),
        _row("card-state", Reaction.OFF, 1, "a card that ran is not in OPERATIONAL"),
        _row("card-emergency", Reaction.OFF, 1, "EMCY with an error code"),
        _row("heartbeat-lost", Reaction.OFF, 1, "a card silent for bus.heartbeat_timeout_ms"),
        _row("inputs-missing", Reaction.DEGRADED, 4, "cycles in a row without all inputs; missing_cycles: stop"),
        _row("inputs-late", Reaction.CONTINUE, 1, "a TPDO comes in the cycle after its own"),
        _row("inputs-repeated", Reaction.DEGRADED, 1, "a TPDO comes twice in a cycle"),
        _row("deadline-missed", Reaction.CONTINUE, 1, "a SYNC left out or late; missing_cycles late in a row: stop"),
        _row("impossible-position", Reaction.HOLD, 1, "beyond the stops by more than range_margin_deg"),
        _row("impossible-motion", Reaction.HOLD, 1, "more than max_position_step_deg a cycle"),
        _row("homing-failed", Reaction.HOLD, 1, "no index, or none where it can be; no way from there"),
        _row("start-pose", Reaction.OFF, 1, "the model lacks a load from the start on, and encoders are not homed"),
        _row("law-output", Reaction.OFF, 1, "not one finite torque per joint"),
        _row("law-failed", Reaction.OFF, 1, "the law raised an exception"),
        _row("interrupted", Reaction.OFF, 1, "the user stops the run"),
        _row("recording-failed", Reaction.OFF, 1, "a record cannot be written"),
        _row("potentiometer-range", Reaction.HOLD, 4, "the last code at either end of the ADC"),
        _row("potentiometer-jump", Reaction.HOLD, 4, "position_jump_lsb from the integrated tachometer"),
        _row("potentiometer-spike", Reaction.SUBSTITUTE, 1, "as a jump, for fewer than four cycles"),
        _row("potentiometer-stuck", Reaction.HOLD, 1, "as a mismatch, and the code has not changed meanwhile"),
        _row("potentiometer-mismatch", Reaction.HOLD, 1, "filtered, position_drift_lsb from the tachometer"),
        _row("encoder-jump", Reaction.HOLD, 4, "as potentiometer-jump; a counter's codes have no end"),
        _row("encoder-spike", Reaction.SUBSTITUTE, 1, "as potentiometer-spike"),
        _row("encoder-stuck", Reaction.HOLD, 1, "as potentiometer-stuck"),
        _row("encoder-mismatch", Reaction.HOLD, 1, "as potentiometer-mismatch"),
        _row("tachometer-range", Reaction.SUBSTITUTE, 2, "the last code at either end of the ADC"),
        _row("tachometer-jump", Reaction.SUBSTITUTE, 3, "speed_jump_lsb from the model; the angle did not follow"),
        _row("tachometer-spike", Reaction.SUBSTITUTE, 1, "as a jump, and gone before that is decided"),
        _row("tachometer-stuck", Reaction.SUBSTITUTE, 8, "the code does not change while the model's speed does"),
        _row("tachometer-mismatch", Reaction.SUBSTITUTE, 1, "as the potentiometer's, after a doubtful speed"),
        _row("sensor-noise", Reaction.SUBSTITUTE, 2, "three spikes in 80 cycles, or a speed that goes to and fro"),
        _row("current-mismatch", Reaction.OFF, 2, "current_mismatch_a off or fluttering, not blamed on the sense"),
        _row("current-sense-mismatch", Reaction.CONTINUE, 3, "current_mismatch_a off, and the arm does not care"),
        _row("current-sense-range", Reaction.CONTINUE, 3, "as before, with the last code at either end"),
        _row("acceleration-mismatch", Reaction.DEGRADED, 4, "acceleration_mismatch_rad_s2 unexpected; lasting: stop"),
        _row("wrong-direction", Reaction.OFF, 4, "1.5 to 2.6 times the commanded torque is missing"),
        _row(
            "following-error",
            Reaction.HOLD,
            4,
            "twice what is normal for the law, and growing; no excuse by saturation",
        ),
        _row("saturation", Reaction.DEGRADED, 40, "amplifier at its limit and the following error abnormal"),
        _row("drive-broken", Reaction.OFF, 1, "as a mismatch, within 80 cycles of an acceleration mismatch"),
        _row("overspeed", Reaction.OFF, 2, "tachometer at its end after an unexpected acceleration"),
        _row("object-lost", Reaction.HOLD, 2, "the hands move against each other by more than encoders may be off"),
        _row("both-sensors", Reaction.OFF, 4, "one is lost, and the other astray by twice its limit"),
    )
)
"""Every detector by name. The names are an API: users' tests refer to them."""


OF_A_DRIVE = frozenset(("current-mismatch", "wrong-direction", "drive-broken", "overspeed"))
"""Detectors of a drive that does not do what it is told, so that it cannot hold its joint."""

OF_ALL_JOINTS = frozenset(("object-lost",))
"""Detectors after which no sensor of position is followed: one of them may be what is wrong."""

POSITION = "potentiometer"
"""The sensor of position by whose name its detectors go among themselves."""


def named_for(sensor: str, text: str) -> str:
    """A detector's name, or what it says, with the joint's own sensor of position instead of a potentiometer."""
    return text if sensor == POSITION else text.replace(POSITION, sensor)
