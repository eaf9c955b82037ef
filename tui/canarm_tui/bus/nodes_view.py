"""The view of nodes: who is on the bus, in which state, with which errors; below, the EMCY messages as they came."""

from collections.abc import Iterable, Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType

from canarm_protocol.canopen.dictionary import IDENTITY
from canarm_protocol.canopen.frames import HIGHEST_NODE_ID
from canarm_protocol.decoding import services

from ..grid import Column, Grid
from ..link import LinkState
from ..texts import Tone, Word
from ..views import Context, Pane, Scene, View
from ..widgets import WordLine
from .bus_texts import load_word, node_cells, row_cells, state_words
from .frames_view import COLUMNS as FRAME_COLUMNS
from .nodes import HeardEmergency, NodeNow
from .rows import RowNow
from .sdo_desk import Answer
from .sdo_screen import SdoScreen
from .watch import BusWatch

EMERGENCIES_FROM_LINES, FRAMES_FROM_LINES = 14, 24
COLUMNS = (
    Column("node", 4),
    Column("name", 14),
    Column("state", 17),
    Column("heartbeat", 9, is_right=True),
    Column("reg.", 4),
    Column("last EMCY", 0),
    Column("boots", 5, is_right=True, from_width=90),
    Column("vendor:product", 17, from_width=100),
)
EMERGENCY_COLUMNS = (Column("ago", 9, is_right=True), Column("node", 14), Column("EMCY", 0))


def frames_of(rows: Iterable[RowNow], node_id: int) -> list[RowNow]:
    """The frames that carry the node's number where CANopen's predefined connection set has it, by identifier."""
    of_it = (
        row
        for row in rows
        if not row.frame.is_extended and not row.frame.is_error
        if row.frame.can_id > HIGHEST_NODE_ID and row.frame.can_id & HIGHEST_NODE_ID == node_id
    )
    return sorted(of_it, key=lambda row: row.frame.can_id)


class NodesPane(Pane):
    """Nodes of one bus. It opens its bus when it is first chosen."""

    DEFAULT_CSS = """
    NodesPane #nodes-state { height: auto; max-height: 3; text-wrap: wrap; }
    NodesPane #emergencies, NodesPane #node-frames { border-top: hkey $foreground 30%; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("i", "identify", "Identity", id="bus.identity", tooltip="Read vendor-ID and product code by SDO"),
    ]

    def __init__(self, watch: BusWatch) -> None:
        super().__init__()
        self.bus = watch
        self._wall_ns = 0
        self._said: Word | None = None

    def compose(self) -> ComposeResult:
        """Figures, nodes, emergencies."""
        yield WordLine(id="nodes-state", may_wrap=True)
        yield Grid[NodeNow](
            COLUMNS,
            self._node,
            lambda node: node.node_id,
            id="nodes",
            empty="no heartbeat, EMCY or answer was heard yet",
        )
        yield Grid[HeardEmergency](EMERGENCY_COLUMNS, self._emergency, id, id="emergencies", empty="no EMCY yet")
        yield Grid[RowNow](
            FRAME_COLUMNS, self._frame, lambda row: row.key, id="node-frames", empty="no frame of this node yet"
        )

    def _lay_out(self, nodes: int, emergencies: int) -> None:
        """Nodes have the lines of their rows, EMCY the next, and the frames of the chosen node what is left."""
        room = self.size.height - self.query_one("#nodes-state").size.height
        grids = [self.query_one(f"#{name}", Grid) for name in ("nodes", "emergencies", "node-frames")]
        is_high, is_highest = room >= EMERGENCIES_FROM_LINES - 1, room >= FRAMES_FROM_LINES - 1
        first = min(max(nodes, 1) + 1, room // 2)
        second = min(max(emergencies, 1) + 2, (room - first) // (2 if is_highest else 1))
        grids[1].display, grids[2].display = is_high, is_highest
        for grid, lines, is_last in zip(grids, (first, second, 0), (not is_high, not is_highest, True), strict=True):
            grid.styles.height = "1fr" if is_last else lines

    def chosen(self) -> None:
        """Somebody looks: the bus is opened."""
        self.bus.wake()
        self.query_one("#nodes").focus()

    def show(self, scene: Scene) -> None:
        """Show the bus as it is now."""
        now, self._wall_ns = self.bus.now(scene.now_ns), scene.now_ns
        words = list(state_words(self.bus.link, now, scene.now_ns, self.bus.is_behind))
        if self.bus.link.state is not LinkState.LOST:
            words += [Word(f"{len(now.nodes)} nodes" if now.nodes else "no node heard yet"), load_word(now.load)]
        if self._said is not None:
            words.append(self._said)
        self.query_one("#nodes-state", WordLine).show(tuple(words))
        self._lay_out(len(now.nodes), len(now.emergencies))
        nodes = self.query_one("#nodes", Grid)
        nodes.show(now.nodes)
        self.query_one("#emergencies", Grid).show(now.emergencies)
        frames = self.query_one("#node-frames", Grid)
        if frames.display:
            node: NodeNow | None = nodes.chosen
            frames.show([] if node is None else frames_of(now.rows, node.node_id))

    def _node(self, node: NodeNow) -> Sequence[Sequence[Word]]:
        return node_cells(node, self._wall_ns)

    def _frame(self, row: RowNow) -> Sequence[Sequence[Word]]:
        return row_cells(row, self.bus.decoder.meaning(row.frame, row.about), self._wall_ns)

    def _emergency(self, heard: HeardEmergency) -> Sequence[Sequence[Word]]:
        name = self.bus.book.name(heard.node_id)
        meaning = services.emergency(heard.data, name)
        tone = Tone.BAD if meaning.is_wrong else Tone.PLAIN
        ago_s = (self._wall_ns - heard.wall_ns) * 1e-9
        sign = "▲ " if meaning.is_wrong else ""
        return (Word(f"{ago_s:.1f} s", Tone.DIM),), (Word(name),), (Word(f"{sign}{meaning.text}", tone),)

    def on_grid_chosen(self, event: Grid.Chosen) -> None:
        """Open the objects of a node."""
        event.stop()
        if event.grid.id == "nodes":
            self.app.push_screen(SdoScreen(self.bus, event.row.node_id))

    def action_identify(self) -> None:
        """Ask the node at the cursor who it is; the answer is heard like any other."""
        node: NodeNow | None = self.query_one("#nodes", Grid).chosen
        if node is None:
            return

        def tell(answer: Answer) -> None:
            self._said = None if answer.failure is None else Word(f"{node.name}: {answer.failure}", Tone.BAD)

        for subindex in (1, 2):
            self.bus.desk.read(node.node_id, IDENTITY, subindex, tell)


HELP = """\
Who was heard: by heartbeat, EMCY, or an answer to SDO. Nobody is asked unless you do.
heartbeat      how long ago the last one was; ▲ when three are missing
state          of the last heartbeat; » what an NMT command has told it since; was: its heartbeats are missing
reg.           error register 0x1001 as the last EMCY carried it
vendor:product what was read of 0x1018; EDS: what the data sheet says
enter opens a node's objects; there enter reads, w writes (by type and limits of the data sheet), a reads all shown.
Below, where there is room: the EMCY as they came, and the frames that carry the chosen node's number.
i reads the identity. A node that another client talks to just then is left alone."""

VIEW: View[Context] = View(
    name="nodes",
    title="Nodes",
    key="4",
    what="Nodes of the robot's bus, and their objects",
    make=lambda context: NodesPane(context.bus),
    help=HELP,
)
