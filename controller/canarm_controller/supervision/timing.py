"""Times of the detectors as whole cycles of a cell.

Owns what is a time by its nature: how long an arm swings, a payload is unknown, a drive takes. What is a number of
readings, because noise is averaged over so many, stays where it is counted.
"""

from dataclasses import dataclass

REFRESH_S = 0.01
"""Gravity, Coriolis, friction and inertia are evaluated so often: at 2.5 rad/s the arm turns 1.4° meanwhile, and
gravity changes by 2.5 %."""
ASSESSED_S = 0.01
"""Over which an unexpected acceleration is measured."""
CALM_S = 0.25
"""After the start, or after the arm has changed, the payload's weight is not known: wider limits of the speed."""
BLURRED_S = 0.1
"""After a measurement whose time is known badly, limits are the wide ones."""
DOUBT_S = 1.0
"""For so long a doubtful speed is remembered."""
EARLY_S = 2.0
"""In which base and offset of the tachometer are learned, and a wire takes up what the arm carries."""
SWINGING_S = 0.5
"""In which an arm that has left its support swings on elastic wires: turns of its speed are no noise."""
UNSETTLED_S = 0.2
"""If motor and joint part company so soon after an unexpected acceleration, it is what joins them that has broken."""
LASTING_S = 0.025
"""What is beyond any payload and has not gone by then, as a blow has, is a jam or a drive that brakes."""
STUCK_S, STUCK_CYCLES = 0.02, (3, 8)
"""A code that has not changed for so long may stick, between so few and so many readings: noise changes it sooner."""
STUCK_SURE_S, STUCK_SURE_CYCLES = 0.06, (8, 24)
"""A code that has not changed for so long agrees with nothing."""
STEP_S, SHORTEST_STEP_CYCLES = 0.0225, 4
"""After a step of the speed, so long at most until it is decided; over four readings at least."""
ABRUPT_S, SHORTEST_ABRUPT_CYCLES = 0.06, 12
"""In which the speed that a missing torque makes tells amplifier and sense apart."""
WINDOW_S, SHORTEST_WINDOW_CYCLES = 0.06, 12
"""Of a vote: short enough that what the model lacks otherwise (a payload that turns) is a straight line in it."""
JAMMED_S, SATURATED_S, BEGINNING_S, RECOVERY_S = 0.05, 0.1, 0.5, 2.0
"""A jammed joint stands for so long; an amplifier is at its limit for so long before that excuses an error; a law
learns what the arm carries in the beginning; and after an excuse the arm has so long to come back."""
SPIKE_S, TURN_S, AGREE_S, AGREE_AGAIN_S = 0.2, 0.1, 0.25, 1.0
"""Spikes and turns within these belong together; after so much agreement a noisy potentiometer, or a tachometer, is
believed again."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Cycles; the field `step` is `STEP_S`, and so on."""

    period_s: float
    refresh: int
    assessed: int
    calm: int
    blurred: int
    doubt: int
    early: int
    swinging: int
    unsettled: int
    lasting: int
    stuck: int
    stuck_sure: int
    step: int
    abrupt: int
    window: int
    jammed: int
    saturated: int
    beginning: int
    recovery: int
    spike: int
    turn: int
    agree: int
    agree_again: int

    @classmethod
    def of(cls, period_s: float) -> "Timing":
        """For a cycle of `period_s`."""

        def cycles(seconds: float, least: int = 1) -> int:
            return max(round(seconds / period_s), least)

        return cls(
            period_s=period_s,
            refresh=cycles(REFRESH_S),
            assessed=cycles(ASSESSED_S, 2),
            calm=cycles(CALM_S),
            blurred=cycles(BLURRED_S),
            doubt=cycles(DOUBT_S),
            early=cycles(EARLY_S),
            swinging=cycles(SWINGING_S),
            unsettled=cycles(UNSETTLED_S),
            lasting=cycles(LASTING_S, 2),
            stuck=min(cycles(STUCK_S, STUCK_CYCLES[0]), STUCK_CYCLES[1]),
            stuck_sure=min(cycles(STUCK_SURE_S, STUCK_SURE_CYCLES[0]), STUCK_SURE_CYCLES[1]),
            step=cycles(STEP_S, SHORTEST_STEP_CYCLES),
            abrupt=cycles(ABRUPT_S, SHORTEST_ABRUPT_CYCLES),
            window=cycles(WINDOW_S, SHORTEST_WINDOW_CYCLES),
            jammed=cycles(JAMMED_S, 4),
            saturated=cycles(SATURATED_S, 4),
            beginning=cycles(BEGINNING_S),
            recovery=cycles(RECOVERY_S),
            spike=cycles(SPIKE_S, 8),
            turn=cycles(TURN_S, 4),
            agree=cycles(AGREE_S),
            agree_again=cycles(AGREE_AGAIN_S),
        )

    @property
    def assessed_s(self) -> float:
        """The time over which an acceleration is measured."""
        return self.assessed * self.period_s
