"""The view of nodes: who is on the bus, in which state, with which errors; below, the EMCY messages as they came."""

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.events import Resize

from canarm_protocol.canopen.dictionary import IDENTITY
from canarm_protocol.decoding import services

from ..grid import Column, Grid
from ..link import LinkState
from ..texts import Tone, Word
from ..views import Context, Pane, Scene, View
from ..widgets import WordLine
from .bus_texts import load_word, node_cells, state_words
from .nodes import HeardEmergency, NodeNow
from .sdo_desk import Answer
from .sdo_screen import SdoScreen
from .watch import BusWatch

EMERGENCIES_FROM_LINES = 14
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


class NodesPane(Pane):
    """Nodes of one bus. It opens its bus when it is first chosen."""

    DEFAULT_CSS = """
    NodesPane #nodes-state { height: auto; max-height: 3; text-wrap: wrap; }
    NodesPane #nodes { height: 2fr; }
    NodesPane #emergencies { display: none; height: 1fr; border-top: hkey $foreground 30%; }
    NodesPane.-high #emergencies { display: block; }
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

    def on_resize(self, event: Resize) -> None:
        """The emergencies go where they would leave too little."""
        self.set_class(event.size.height >= EMERGENCIES_FROM_LINES, "-high")

    def chosen(self) -> None:
        """Somebody looks: the bus is opened."""
        self.bus.wake()
        self.query_one("#nodes").focus()

    def show(self, scene: Scene) -> None:
        """Show the bus as it is now."""
        now, self._wall_ns = self.bus.now(scene.now_ns), scene.now_ns
        words = list(state_words(self.bus.link, now, scene.now_ns))
        if self.bus.link.state is not LinkState.LOST:
            words += [Word(f"{len(now.nodes)} nodes" if now.nodes else "no node heard yet"), load_word(now.load)]
        if self._said is not None:
            words.append(self._said)
        self.query_one("#nodes-state", WordLine).show(tuple(words))
        self.query_one("#nodes", Grid).show(now.nodes)
        self.query_one("#emergencies", Grid).show(now.emergencies)

    def _node(self, node: NodeNow) -> Sequence[Sequence[Word]]:
        return node_cells(node, self._wall_ns)

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
reg.           error register 0x1001 as the last EMCY carried it
vendor:product what was read of 0x1018; EDS: what the data sheet says
enter opens a node's objects; there enter reads, w writes (by type and limits of the data sheet), a reads all shown.
i reads the identity. A node that another client talks to just then is left alone."""

VIEW: View[Context] = View(
    name="nodes",
    title="Nodes",
    key="4",
    what="Nodes of the robot's bus, and their objects",
    make=lambda context: NodesPane(context.bus),
    help=HELP,
)
