"""Homing by the encoders' index: what the cards say of the pulses, and the zeros that follow.

Owns the questions to the cards while the loop runs, one a cycle. How the joints move meanwhile is for the reference;
what zeros do to measurements, law and trajectory is for the loop.
"""

import math
from collections.abc import Sequence

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cards.encoder_counter import INDEX_PULSES, INDEX_VALUES
from canarm_protocol.cell.homing import IndexMark
from canarm_protocol.cell.wiring import CardNode

from ..bus.master import Ask, Conversation, Silence, read_number
from ..errors import ControllerError
from ..supervision.supervisor import Verdict

HOMING_FAILED = "homing-failed"
ANSWER_CYCLES = 40
"""A card that has not answered after so many cycles is not asked again."""


class Homing:
    """The search of one run, from `over_at`, the cycle at which its move is over.

    `pulses` is how often each index of `marks` had come before; no joint is parked further than `within_rad` from home.
    """

    def __init__(
        self,
        nodes: Sequence[CardNode],
        joint_names: Sequence[str],
        marks: Sequence[IndexMark],
        pulses: Sequence[int],
        over_at: int,
        within_rad: float,
    ) -> None:
        self.zeros: list[float] | None = None
        """The zeros of the scales of `marks`, in counts, once all are known."""
        self.failure: Verdict | None = None
        """Why there are none."""
        self._marks, self._pulses, self._names, self._over_at = marks, pulses, joint_names, over_at
        self._within_rad = within_rad
        self._conversation = self._talk({node.card.node_id: node for node in nodes})
        self._ask: Ask | None = None
        self._answer: Frame | None = None
        self._asked_at = 0

    @property
    def is_over(self) -> bool:
        """Whether it has succeeded or failed."""
        return self.zeros is not None or self.failure is not None

    def opening(self, tick: int) -> tuple[Frame, ...]:
        """What to ask before the SYNC of cycle `tick`."""
        if tick < self._over_at or self.is_over:
            return ()
        if self._ask is not None and self._answer is None and tick - self._asked_at < ANSWER_CYCLES:
            return ()
        try:
            if self._ask is None:
                self._ask = next(self._conversation)
            elif self._answer is None:
                self._ask = self._conversation.throw(Silence())
            else:
                self._ask = self._conversation.send(self._answer)
        except StopIteration:
            return ()
        except ControllerError as error:
            self.failure = Verdict(HOMING_FAILED, str(error))
            return ()
        self._answer, self._asked_at = None, tick
        return self._ask.frames

    def take(self, frame: Frame) -> bool:
        """Take a frame if it is the answer that is awaited."""
        if self._ask is None or self._answer is not None or self.is_over or not self._ask.is_answer(frame):
            return False
        self._answer = frame
        return True

    def _talk(self, nodes: dict[int, CardNode]) -> Conversation:
        zeros = []
        for mark, before in zip(self._marks, self._pulses, strict=True):
            node, name = nodes[mark.card.node_id], self._names[mark.joint]
            pulses = yield from read_number(node, INDEX_PULSES, mark.channel)
            if pulses == before:
                self._fail(
                    name,
                    f"no pulse of its encoder's index on the way; was it parked {self._bound} of home_deg, and does "
                    "the law follow?",
                )
                return
            count = yield from read_number(node, INDEX_VALUES, mark.channel)
            zero = mark.zero(count)
            off_rad = (mark.scale.zero - zero) * mark.scale.step
            if abs(off_rad) > self._within_rad + mark.scale.lsb:
                off_deg = math.degrees(off_rad)
                self._fail(name, f"by its index it was parked {off_deg:+.3g} deg from home_deg, not {self._bound}")
                return
            zeros.append(zero)
        self.zeros = zeros

    def _fail(self, name: str, finding: str) -> None:
        self.failure = Verdict(HOMING_FAILED, f"{name}: {finding}", name)

    @property
    def _bound(self) -> str:
        return f"within control.homing.parked_within_deg = {math.degrees(self._within_rad):g}"


def index_pulses(nodes: Sequence[CardNode], marks: Sequence[IndexMark], into: list[int]) -> Conversation:
    """How often the index of each mark has come so far, appended to `into`. Raises `BringUpError`."""
    by_id = {node.card.node_id: node for node in nodes}
    for mark in marks:
        pulses = yield from read_number(by_id[mark.card.node_id], INDEX_PULSES, mark.channel)
        into.append(pulses)
