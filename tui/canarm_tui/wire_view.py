"""The view of the wire: load, errors, lost frames, error counters of the cards, clients, as the bench says."""

from collections import deque
from collections.abc import Sequence
from functools import cached_property

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Static

from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.wire_figures import WireFigures
from canarm_protocol.shown import printable

from .fault_desk import FaultDesk, Refusal
from .styles import STYLES
from .texts import ABSENT, Tone, Word
from .views import Context, Pane, Scene, View
from .wire_room import LEAST_ROWS, MOST_ROWS, fitted, load_lines, traffic_lines

ASK_NS = 1_000_000_000
"""The bench is asked so often while the view is looked at, and never else."""
RETRY_NS = 5_000_000_000
MOST_LOADS = 600
BUSY = 0.8
STATES = {
    0: Word("● error-active", Tone.GOOD),
    1: Word("▲ error-passive", Tone.WARNING),
    2: Word("✖ bus-off", Tone.BAD),
}
_NO_WIRE = "no wire model runs: canarm emulator --wire and canarm demo --wire have one"

Line = Sequence[Word]


def wire_lines(figures: WireFigures) -> list[Line]:
    """The figures in words: the robot's bus, its cards, the clients of both buses."""
    lines: list[Line] = []
    if figures.load is None:
        lines.append([Word(_NO_WIRE, Tone.WARNING)])
    else:
        tone = Tone.WARNING if figures.load >= BUSY else Tone.PLAIN
        total = ABSENT if figures.total_load is None else f"{100 * figures.total_load:.1f} %"
        sign = "▲ " if tone is Tone.WARNING else ""
        lines.append([Word(f"{sign}load {100 * figures.load:.1f} % of the last second, {total} since start", tone)])
        worst_us = figures.worst_response_us
        worst = (
            ABSENT
            if worst_us is None
            else f"{worst_us:.0f} µs from offer to last bit, frame 0x{figures.worst_cob_id:03X}"
        )
        lines.append([Word(f"slowest frame {worst}")])
    lines.append(
        [_count("error frames", figures.error_frames), Word("   "), _count("lost frames", figures.lost_frames)]
    )
    width = max(map(len, ("card", *figures.cards)))
    if figures.load is not None:  # without a wire nobody counts
        lines += [[], [Word(f"{'card':<{width}} {'TEC':>5} {'REC':>5}  state", Tone.DIM)]]
    for name, card in figures.cards.items() if figures.load is not None else ():
        counts = f"{printable(name):<{width}} {card.transmit:>5} {card.receive:>5}  "
        lines.append([Word(counts), STATES.get(card.state, Word(f"state {card.state}", Tone.BAD))])
    lines += [[], [Word(f"{'bus':<{width}} {'clients':>11}  dropped for slow clients", Tone.DIM)]]
    for bus, clients in figures.clients.items():
        lines.append([Word(f"{bus:<{width}} {clients:>11}  "), _count("", figures.dropped.get(bus, 0))])
    return lines


def _count(name: str, count: int) -> Word:
    return Word(f"{'▲ ' if count else ''}{name} {count}".strip(), Tone.WARNING if count else Tone.DIM)


class WirePane(Pane):
    """Asks the bench from time to time while it is looked at."""

    DEFAULT_CSS = """
    WirePane { padding: 0 0 0 1; }
    WirePane VerticalScroll { scrollbar-size-vertical: 1; }
    WirePane Static { height: auto; padding: 0 1 0 0; }
    """

    def __init__(self, cell: Cell, desk: FaultDesk | None) -> None:
        super().__init__()
        self._cell = cell
        self._loads: deque[float] = deque(maxlen=MOST_LOADS)
        self._desk = desk
        self._is_asking = False
        self._due_ns = 0
        self.lines: list[Line] = [[Word("asking the bench …", Tone.DIM)]]

    @cached_property
    def _traffic(self) -> list[Line]:
        return traffic_lines(self._cell)

    def compose(self) -> ComposeResult:
        """One text, to be scrolled where it is longer than the screen."""
        with VerticalScroll():
            yield Static(id="wire")

    def show(self, scene: Scene) -> None:
        """Show what the bench has said last, and ask again when it is time."""
        if (
            self._desk is not None
            and scene.snapshot.age_ns is not None
            and not self._is_asking
            and scene.now_ns >= self._due_ns
        ):
            self._is_asking, self._due_ns = True, scene.now_ns + ASK_NS
            self._desk.load_wire(lambda answer: self._take(answer, scene.now_ns))
        lines = self._filled(self.size.width - 2, self.size.height)
        parts = (Content("").join(Content.styled(word.text, STYLES[word.tone]) for word in line) for line in lines)
        self.query_one(Static).update(Content("\n").join(parts))

    def _filled(self, width: int, rows: int) -> list[Line]:
        """The figures and the cyclic frames, and past loads if there is room for them."""
        shown = [*self.lines, [], *self._traffic]
        room = min(rows - len(shown) - 2, MOST_ROWS)
        if self._loads and room >= LEAST_ROWS and width > 0:
            shown = fitted(shown, [load_lines(self._loads, width, room)], rows)
        return shown

    def _take(self, answer: WireFigures | Refusal, asked_ns: int) -> None:
        self._is_asking = False
        if isinstance(answer, Refusal):
            self.lines, self._due_ns = [[Word(printable(answer.reason), Tone.BAD)]], asked_ns + RETRY_NS
        else:
            self.lines = wire_lines(answer)
            if answer.load is not None:
                self._loads.append(answer.load)


VIEW: View[Context] = View(
    name="wire",
    title="Wire",
    key="6",
    what="Load, errors and clients of the buses, as the bench says",
    make=lambda context: WirePane(context.cell, context.desk),
    help="""\
What the bench works out of the robot's bus with its wire model (--wire): load with stuff bits, the slowest frame, error
frames, frames lost in bus-off; each card's transmit and receive error counters and its state. Below, who is attached.
Then the worst cases of the cell's cyclic frames by analysis, as canarm check has them (↑ ↓ scroll to what does not
fit) and, where there is room, past loads.
The bench is asked once a second while this is looked at.""",
)
