"""The detectors' times as whole cycles of a cell.

Owns the genuine times: how long an arm swings, a payload is unknown, a drive takes. Numbers of
readings over which noise is averaged stay where they are counted.
"""

from dataclasses import dataclass

REFRESH_S = 0.01
"""How often gravity, Coriolis, friction and inertia are evaluated: at 2.5 rad/s the arm turns 1.4° meanwhile, and
gravity changes by 2.5 %."""
ASSESSED_S = 0.01
"""Time over which an unexpected acceleration is measured."""
CALM_S = 0.25
"""How long the payload is unknown after the start or a change of the arm: speed limits are wider."""
BLURRED_S = 0.1
"""How long limits are wide after a measurement of uncertain time."""
TURNING_S = 0.15
"""How long friction is unknown after a joint has turned; the observer of 30 rad/s has then learned it to 6 %."""
DOUBT_S = 1.0
"""How long a doubtful speed is remembered."""
EARLY_S = 2.0
"""Time in which base and offset of the tachometer are learned, and a wire takes up the load."""
SWINGING_S = 0.5
"""How long an arm that has left its support swings on elastic wires: reversals of its speed are no noise."""
UNSETTLED_S = 0.2
"""If motor and joint diverge within this time of an unexpected acceleration, their connection has broken."""
LASTING_S = 0.025
"""An acceleration beyond any payload that lasts longer is no blow, but a jam or a braking drive."""
STUCK_S, STUCK_CYCLES = 0.02, (3, 8)
"""A code unchanged for this time (within these bounds of readings) may be stuck: noise changes it sooner."""
STUCK_SURE_S, STUCK_SURE_CYCLES = 0.06, (8, 24)
"""A code unchanged for this time agrees with nothing; on an elastic wire, where a motor's speed stands at either end of
a swing, not sooner than that, however many readings it takes."""
STEP_S, SHORTEST_STEP_CYCLES = 0.0225, 4
"""Longest time to decide on a step of the speed, and the least number of readings."""
ABRUPT_S, SHORTEST_ABRUPT_CYCLES = 0.06, 12
"""Time in which the speed caused by a missing torque tells amplifier and sense apart."""
WINDOW_S, SHORTEST_WINDOW_CYCLES = 0.06, 12
"""Window of a vote, short enough that other model errors (a turning payload) are a straight line in it."""
JAMMED_S, SATURATED_S, BEGINNING_S, RECOVERY_S = 0.05, 0.1, 0.5, 2.0
"""How long a joint stands before it is jammed; how long an amplifier is at its limit before that excuses an error; how
long a law learns the payload at first; and how long the arm has to come back after an excuse."""
SPIKE_S, TURN_S, AGREE_S, AGREE_AGAIN_S = 0.2, 0.1, 0.25, 1.0
"""Spikes and reversals within these times belong together; after this much agreement a noisy potentiometer, or a
tachometer, is trusted again."""


@dataclass(frozen=True, slots=True)
class Timing:
    """The times in cycles; the field `step` is `STEP_S`, and so on."""

    period_s: float
    refresh: int
    assessed: int
    calm: int
    blurred: int
    turning: int
    doubt: int
    early: int
    swinging: int
    unsettled: int
    lasting: int
    stuck: int
    stuck_sure: int
    stuck_swinging: int
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
        """The times for a cycle of `period_s`."""

        def cycles(seconds: float, least: int = 1) -> int:
            return max(round(seconds / period_s), least)

        return cls(
            period_s=period_s,
            refresh=cycles(REFRESH_S),
            assessed=cycles(ASSESSED_S, 2),
            calm=cycles(CALM_S),
            blurred=cycles(BLURRED_S),
            turning=cycles(TURNING_S),
            doubt=cycles(DOUBT_S),
            early=cycles(EARLY_S),
            swinging=cycles(SWINGING_S),
            unsettled=cycles(UNSETTLED_S),
            lasting=cycles(LASTING_S, 2),
            stuck=min(cycles(STUCK_S, STUCK_CYCLES[0]), STUCK_CYCLES[1]),
            stuck_swinging=cycles(STUCK_SURE_S, STUCK_SURE_CYCLES[0]),
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
