"""A CAN bus as its nodes see it: arbitration by identifier, exact frame times, acknowledgement, error confinement.

Frames go in with the time at which a node's CAN controller has them, and come out with the time of their last bit. The
meaning of frames, clocks, bit timing, resynchronisation and propagation delay never enter.
"""

from collections.abc import Hashable, Iterable, Mapping

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.bits import (
    ACK_DELIMITER_BITS,
    END_OF_FRAME_BITS,
    INTERMISSION_BITS,
    arbitration_key,
    frame_bits,
    identifier,
)

from ..timing import NEVER
from .confinement import SUSPEND_BITS, ErrorKind, ErrorState
from .wire_errors import Attempt, Disturbance, Disturbances, Identifier, foresee
from .wire_events import Delivery, ErrorFrame, StateChange
from .wire_load import BusLoad
from .wire_node import LONGEST_QUEUE, Queueing, Waiting, WireNode

SECOND_NS = 10**9


class Wire:
    """A bus of `bitrate` bit/s with its `nodes`; every node acknowledges what it receives.

    `advance` decides nothing that begins at its own time or later, so frames may still be offered from that time on.
    `events` collects error frames and changes of error state in order; the caller empties it. Loads look back
    `history_ns` at most.

    Raises `ValueError` for a bit rate whose bit is not a whole number of ns.
    """

    def __init__(
        self, bitrate: int, nodes: Iterable[Hashable] = (), start_ns: int = 0, history_ns: int = SECOND_NS
    ) -> None:
        self.bit_ns, rest = divmod(SECOND_NS, bitrate)
        if rest:
            raise ValueError(f"bitrate {bitrate} bit/s: a bit must last a whole number of ns, as at 125000 or 1000000")
        self.time_ns = start_ns
        self.events: list[ErrorFrame | StateChange] = []
        self._nodes: dict[Hashable, WireNode] = {}
        self._waiting: list[WireNode] = []
        self._attempt: Attempt | None = None
        """The transmission on the wire."""
        self._plan: Attempt | None = None
        """The next one, if nothing more is offered; None if it has to be planned again."""
        self._idle_ns = self._recessive_from_ns = start_ns
        self._worst_ns: dict[int, int] = {}
        self._load = BusLoad(start_ns, history_ns)
        self._disturbances = Disturbances()
        self._recovering: list[WireNode] = []
        self._on_bus = 0
        self._is_troubled = False
        for name in nodes:
            self.attach(name)

    @property
    def nodes(self) -> Mapping[Hashable, WireNode]:
        """Every attached node's controller."""
        return self._nodes

    @property
    def worst_response_ns(self) -> dict[Identifier, int]:
        """Longest time so far from offer to the last bit of the frame, by identifier."""
        worst: dict[Identifier, int] = {}
        for key, response_ns in self._worst_ns.items():
            name = identifier(key)
            worst[name] = max(response_ns, worst.get(name, 0))
        return worst

    @property
    def next_due_ns(self) -> int:
        """When `advance` has something to report, as things stand; `NEVER` while nothing waits."""
        if self._attempt is not None:
            return self._attempt.end_ns
        due_ns = (self._plan or self._make_plan()).end_ns if self._waiting else NEVER
        if self._recovering:
            back_ns = [node.recovered_ns(self._recessive_from_ns, self.bit_ns) for node in self._recovering]
            due_ns = min(due_ns, *back_ns)
        return due_ns

    def attach(self, name: Hashable, queueing: Queueing = Queueing.FIFO) -> WireNode:
        """A node joins the bus, error-active. Raises `ValueError` when it is there already."""
        if name in self._nodes:
            raise ValueError(f"node {name!r} is on the bus already; detach it first")
        node = self._nodes[name] = WireNode(name, queueing)
        self._count_on_bus()
        return node

    def detach(self, name: Hashable) -> None:
        """A node leaves the bus with all that it had to send; a frame on the wire is finished. Raises `ValueError`."""
        node = self._node(name)
        del self._nodes[name]
        self._count_on_bus()
        for group in (self._waiting, self._recovering):
            if node in group:
                group.remove(node)
        node.queue.clear()
        self._plan = None

    def disconnect(self, name: Hashable) -> None:
        """A node's line is cut: it hears, sends and acknowledges nothing, and what it had to send is lost.

        A frame on the wire is finished; the error counters stay as they are. Raises `ValueError`.
        """
        node = self._node(name)
        node.is_connected = False
        self._drop_queue(node)

    def connect(self, name: Hashable) -> None:
        """A node's line is mended. Raises `ValueError`."""
        self._node(name).is_connected = True
        self._count_on_bus()

    def reset(self, name: Hashable) -> None:
        """A node's CAN controller starts again: error-active, with nothing to send. Raises `ValueError`."""
        node = self._node(name)
        node.reset()
        node.recovering_from_ns, node.ready_ns = None, 0
        if node in self._recovering:
            self._recovering.remove(node)
        self._drop_queue(node)

    def _drop_queue(self, node: WireNode) -> None:
        node.discarded += len(node.queue)
        node.queue.clear()
        if node in self._waiting:
            self._waiting.remove(node)
        self._count_on_bus()

    def _count_on_bus(self) -> None:
        self._on_bus = sum(node.is_on_bus for node in self._nodes.values())
        self._plan = None

    def offer(self, time_ns: int, frame: Frame, sender: Hashable) -> bool:
        """`sender` has `frame` to send from `time_ns` on. False if the frame is lost: it is off the bus, or its queue
        is full.

        Raises `ValueError` for a time in the past or an unknown sender, `FrameError` for what is no classical frame.
        """
        node = self._nodes.get(sender) or self._node(sender)
        if time_ns < self.time_ns:
            raise ValueError(
                f"frame 0x{frame.can_id:X} offered at {time_ns} ns; the wire is at {self.time_ns} ns already"
            )
        waiting = Waiting(time_ns, arbitration_key(frame), frame, frame_bits(frame))
        if not node.is_connected or node.state is ErrorState.BUS_OFF or len(node.queue) >= LONGEST_QUEUE:
            node.discarded += 1
            return False
        if not node.queue:
            self._waiting.append(node)
        node.put(waiting)
        self._plan = None
        return True

    def advance(self, until_ns: int) -> list[Delivery]:
        """Let time pass up to `until_ns`; returns the frames whose last bit is not after that time, in order."""
        deliveries: list[Delivery] = []
        while True:
            attempt = self._attempt
            if attempt is None:
                if self._recovering and self._recover_until(min(self._next_start_ns(), until_ns)):
                    continue
                if not self._waiting:
                    break
                attempt = self._plan or self._make_plan()
                if attempt.start_ns >= until_ns:
                    break
                self._begin(attempt)
            if attempt.end_ns > until_ns:
                break
            self._attempt = None
            if attempt.kind is None:
                deliveries.append(self._succeed(attempt))
            else:
                self._fail(attempt)
        if until_ns > self.time_ns:
            self.time_ns = until_ns
        return deliveries

    def corrupt(
        self,
        can_id: int,
        is_extended: bool = False,
        nth: int = 1,
        times: int = 1,
        receivers: Iterable[Hashable] | None = None,
        bit: int | None = None,
        is_unacknowledged: bool = False,
    ) -> Disturbance:
        """Let `times` transmissions of an identifier, from the `nth` on (1: the next), end in an error.

        It is a CRC error at the `receivers` (None: at all, so that nobody acknowledges), or with `bit` a bit error of
        the transmitter, this many bits after the arbitration field, or with `is_unacknowledged` an ACK error.
        Retransmissions count; bus-off ends the row. Returns what `withdraw` takes.

        Raises `ValueError` for impossible numbers.
        """
        if nth < 1 or times < 1 or (bit is not None and bit < 0):
            raise ValueError(f"nth = {nth} and times = {times} must be at least 1, bit = {bit} at least 0")
        chosen = None if receivers is None else frozenset(receivers)
        disturbance = Disturbance(nth - 1, times, chosen, bit, is_unacknowledged)
        self._disturbances.add((can_id, is_extended), disturbance)
        self._plan = None
        return disturbance

    def withdraw(self, disturbance: Disturbance) -> None:
        """Cancel the rest of a disturbance; a transmission that it has hit already still fails."""
        self._disturbances.withdraw(disturbance)
        self._plan = None

    def recover(self, name: Hashable) -> None:
        """A node in bus-off begins to wait for 128 x 11 recessive bits, then takes part again. Raises `ValueError`."""
        node = self._node(name)
        if node.state is ErrorState.BUS_OFF and node.recovering_from_ns is None:
            node.recovering_from_ns, node.recessive_sequences = self.time_ns, 0
            self._recovering.append(node)

    def load(self, window_ns: int | None = None) -> float:
        """Share of time, 0 to 1, of frames and error frames with intermission, since start or in the last window.

        Raises `ValueError` for a window longer than the history.
        """
        return self._load.share(self.time_ns, window_ns, None if self._attempt is None else self._attempt.start_ns)

    @property
    def peak_load(self) -> float:
        """Load of the busiest `history_ns` so far, or of all the time if that is shorter."""
        return self._load.peak(self.time_ns)

    def _node(self, name: Hashable) -> WireNode:
        try:
            return self._nodes[name]
        except KeyError:
            known = ", ".join(map(repr, self._nodes)) or "nobody"
            raise ValueError(f"node {name!r} is not on the bus; attached: {known}") from None

    def _make_plan(self) -> Attempt:
        """Plan the next transmission, if nothing more is offered: time, sender and outcome. Some frame must wait."""
        node = self._waiting[0]
        if len(self._waiting) == 1 and node.queueing is Queueing.FIFO:
            waiting = node.queue[0]
            start_ns = max(waiting.offered_ns, node.ready_ns, self._idle_ns)
            plan = Attempt(start_ns, start_ns + waiting.bits * self.bit_ns, [(node, waiting)])
        else:
            plan = self._arbitrate(self._next_start_ns())
        if len(plan.transmitters) > 1 or self._disturbances or self._on_bus < 2:
            plan.disturbance = self._disturbances.next(plan.transmitters[0][1].frame)
            foresee(plan, self._nodes.values(), plan.disturbance, self.bit_ns)
        self._plan = plan
        return plan

    def _next_start_ns(self) -> int:
        start_ns = NEVER
        for node in self._waiting:
            ready_ns = node.queue[0].offered_ns
            if ready_ns < node.ready_ns:
                ready_ns = node.ready_ns
            if ready_ns < start_ns:
                start_ns = ready_ns
        return start_ns if start_ns > self._idle_ns else self._idle_ns

    def _arbitrate(self, start_ns: int) -> Attempt:
        """Every node with a frame at `start_ns` sends; the lowest arbitration field wins."""
        candidates = [(node, node.candidate(start_ns)) for node in self._waiting]
        contenders = [(node, waiting) for node, waiting in candidates if waiting is not None]
        least = min([waiting.key for _, waiting in contenders])
        transmitters = [each for each in contenders if each[1].key == least]
        losers = [node for node, waiting in contenders if waiting.key != least]
        return Attempt(start_ns, start_ns + transmitters[0][1].bits * self.bit_ns, transmitters, losers)

    def _begin(self, attempt: Attempt) -> None:
        """SOF: frames leave their queues, disturbances count, a run of recessive bits ends."""
        self._attempt, self._plan = attempt, None
        for node, waiting in attempt.senders if attempt.beaten else attempt.transmitters:
            node.queue.remove(waiting)
            if not node.queue:
                self._waiting.remove(node)
        for node in attempt.losers:
            node.lost_arbitrations += 1
        for node in self._recovering:
            node.count_sequences(self._recessive_from_ns, attempt.start_ns, self.bit_ns)
        if self._disturbances:
            self._disturbances.count(attempt.transmitters[0][1].frame)

    def _succeed(self, attempt: Attempt) -> Delivery:
        start_ns, end_ns = attempt.start_ns, attempt.end_ns
        worst = self._worst_ns
        for node, waiting in attempt.transmitters:
            node.sent += 1
            response_ns = end_ns - waiting.offered_ns
            if response_ns > worst.get(waiting.key, 0):
                worst[waiting.key] = response_ns
        self._recessive_from_ns = end_ns - (END_OF_FRAME_BITS + ACK_DELIMITER_BITS) * self.bit_ns
        self._idle_ns = end_ns + INTERMISSION_BITS * self.bit_ns
        self._load.add(start_ns, self._idle_ns)
        node, waiting = attempt.transmitters[0]
        if not (self._is_troubled or attempt.faulty or attempt.beaten):
            return Delivery(end_ns, waiting.frame, node.name, start_ns)
        self._count_success(attempt)
        return Delivery(end_ns, waiting.frame, node.name, start_ns, frozenset(node.name for node in attempt.faulty))

    def _count_success(self, attempt: Attempt) -> None:
        before = self._states()
        for node, _ in attempt.transmitters:
            node.transmitted()
        for node, waiting in attempt.beaten:
            node.errors += 1
            node.transmit_error()
            self._send_again(node, waiting)
        for node in self._receivers(attempt):
            if node in attempt.faulty:
                node.receive_error(False)
            else:
                node.received()
        self._conclude(attempt, before)

    def _fail(self, attempt: Attempt) -> None:
        """An error frame: it takes time, changes counters, and the frame is sent again."""
        signal, kind = attempt.signal, attempt.kind
        assert signal is not None
        assert kind is not None
        self._recessive_from_ns = attempt.start_ns + signal.flag_to * self.bit_ns
        self._idle_ns = attempt.end_ns + INTERMISSION_BITS * self.bit_ns
        self._load.add(attempt.start_ns, self._idle_ns)
        before = self._states()
        first, waiting = attempt.transmitters[0]
        self.events.append(ErrorFrame(attempt.end_ns, kind, waiting.frame, first.name))
        for node, waiting in attempt.senders:
            node.errors += 1
            if signal.counts_for_transmitter:
                node.transmit_error()
            self._send_again(node, waiting)
        if attempt.disturbance is not None and any(node.state is ErrorState.BUS_OFF for node, _ in attempt.senders):
            self._disturbances.withdraw(attempt.disturbance)
        is_seen = kind is not ErrorKind.ACK or signal.counts_for_transmitter
        for node in self._receivers(attempt) if is_seen else ():
            node.receive_error(signal.first_to_see_suffer and node in attempt.faulty)
        self._conclude(attempt, before)

    def _states(self) -> dict[WireNode, ErrorState]:
        return {node: node.state for node in self._nodes.values()}

    def _receivers(self, attempt: Attempt) -> list[WireNode]:
        senders = {node for node, _ in attempt.senders}
        return [node for node in self._nodes.values() if node not in senders and node.is_on_bus]

    def _send_again(self, node: WireNode, waiting: Waiting) -> None:
        """A frame goes back in front of what came later; in bus-off, or off the bus, all that waits is lost."""
        if not node.is_on_bus or self._nodes.get(node.name) is not node:
            node.discarded += 1 + len(node.queue)
            if node.queue:
                self._waiting.remove(node)
                node.queue.clear()
            return
        if not node.queue:
            self._waiting.append(node)
        node.put_back(waiting)

    def _conclude(self, attempt: Attempt, before: Mapping[WireNode, ErrorState]) -> None:
        """Report changed states, and suspend the transmission of error-passive senders."""
        for node, state in before.items():
            if node.state is not state:
                self.events.append(StateChange(attempt.end_ns, node.name, node.state))
                self._count_on_bus()
        for node, _ in attempt.senders:
            if node.state is ErrorState.PASSIVE:
                node.ready_ns = self._idle_ns + SUSPEND_BITS * self.bit_ns
        self._is_troubled = any(node.tec or node.rec for node in self._nodes.values())
        self._plan = None

    def _recover_until(self, until_ns: int) -> bool:
        """Let nodes that have seen enough recessive bits by `until_ns` recover; returns whether there was one."""
        due = {node: node.recovered_ns(self._recessive_from_ns, self.bit_ns) for node in self._recovering}
        back = sorted((node for node in due if due[node] <= until_ns), key=lambda node: due[node])
        for node in back:
            self._recovering.remove(node)
            node.recovering_from_ns = None
            node.reset()
            self._count_on_bus()
            self.events.append(StateChange(due[node], node.name, ErrorState.ACTIVE))
        return bool(back)
