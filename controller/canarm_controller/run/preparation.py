"""The way into a run: the cards are found, checked and configured, and the loop begins with their first codes.

Owns the questions and their time-outs. What happens to the run afterwards never enters.
"""

from collections.abc import Callable, Sequence

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.homing import IndexMark
from canarm_protocol.cell.model import SENSOR_KINDS, Cell, Quantity
from canarm_protocol.cell.wiring import CardNode
from canarm_protocol.clock import Clock

from ..bus.master import Ask, Conversation, Silence, bring_up, read_input
from ..errors import ControllerError
from .homing import index_pulses


class Preparation:
    """The conversation with the cards before a run. At its end `begin_loop` gets the position code of every joint.

    And, for the joints in `marks`, how often the index of its encoder has come so far.
    """

    def __init__(
        self,
        cell: Cell,
        nodes: tuple[CardNode, ...],
        clock: Clock,
        listen_ns: int,
        begin_loop: Callable[[Sequence[int], Sequence[int]], None],
        marks: Sequence[IndexMark] = (),
    ) -> None:
        self.is_on = True
        """Whether there is still something to ask."""
        self.deadline_ns: int | None = None
        """When the wait for an answer is over; None while none is awaited."""
        self._cell, self._nodes, self._begin_loop, self._marks = cell, nodes, begin_loop, marks
        self._conversation = self._talk(clock, listen_ns)
        self._ask: Ask | None = None

    def is_answer(self, frame: Frame) -> bool:
        """Whether `frame` is what is awaited."""
        return self._ask is not None and self._ask.is_answer(frame)

    def go_on(self, answer: Frame | None, now_ns: int, is_silent: bool = False) -> tuple[Frame, ...] | None:
        """The next frames to send; None when the run can begin.

        `answer` is None at the beginning, and with `is_silent` where none has come. Raises `ControllerError` where
        there can be no run.
        """
        try:
            if is_silent:
                self._ask = self._conversation.throw(Silence())
            else:
                self._ask = self._conversation.send(answer) if answer is not None else next(self._conversation)
        except StopIteration:
            self.end()
            return None
        except ControllerError:
            self.end()
            raise
        self.deadline_ns = now_ns + self._ask.limit_ns
        return self._ask.frames

    def end(self) -> None:
        """Nothing more is asked or awaited."""
        self.is_on, self.deadline_ns, self._ask = False, None, None

    def _talk(self, clock: Clock, listen_ns: int) -> Conversation:
        yield from bring_up(self._nodes, self._cell.bus, clock.value, listen_ns)
        codes = [0] * len(self._cell.joints)
        for node in self._nodes:
            for channel in node.card.channel:
                kind = SENSOR_KINDS.get(channel.leaf)
                if kind is not None and kind.quantity is Quantity.POSITION:
                    code = yield from read_input(node, channel.number)
                    codes[self._cell.far_joint(node.card, channel)] = code
        pulses: list[int] = []
        yield from index_pulses(self._nodes, self._marks, pulses)
        self._begin_loop(codes, pulses)
