"""The view of the cards: slots and registers as the Apple II has them, its memory, and the cards driven by hand."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input, Static

from canarm_protocol.cell.model import Cell, Command
from canarm_protocol.shown import printable

from ..dialog import Dialog
from ..fault_screens import QuestionScreen
from ..grid import Column, Grid
from ..link import LinkState
from ..player import Player
from ..styles import STYLES
from ..texts import Tone, Word
from ..views import Context, Pane, Scene, View
from ..widgets import WordLine
from .bus_texts import CHANGED_NS, state_words
from .card_texts import CardChannel, card_channels, channel_cells
from .hand import Hand, HandState
from .memory_mirror import MemoryMirror
from .memory_texts import memory_lines, position_word
from .watch import BusWatch

LINES_SHOWN = 6
"""Of what the hand says."""
REGISTERS_FROM_COLUMNS = 100
"""In a narrower table the registers of the chosen row stand below it."""
LEAST_TABLE = 6
LONGEST_CARD = 16
HOW = "commands of canarm jog, such as current joint2 0.3; step 10; read; help shows all"
DIRECTIONS = ("off", "ccw", "cw")
COLUMNS = (
    Column("slot", 8),
    Column("card", 8, from_width=100),
    Column("ch", 2, is_right=True),
    Column("signal", 0),
    Column("code", 14),
    Column("bits", 19, from_width=120),
    Column("registers", 22, from_width=REGISTERS_FROM_COLUMNS),
    Column("volts", 9, is_right=True, from_width=76),
    Column("value", 18, is_right=True),
)
_NO_HAND = "the cards cannot be driven from here: the robot's bus was not named; start with -i and -c of it"
_NOT_TAKEN = "the cards are not in hand; t takes them"


class TakeScreen(QuestionScreen):
    """Whether the cards are to be taken in hand."""

    def __init__(self) -> None:
        text = (
            "Take the cards in hand?\nThey are reset, configured and started, outputs off. Where a controller runs, "
            "nothing is done."
        )
        super().__init__("By hand", text, "t")


class HandHelpScreen(Dialog[None]):
    """What can be typed, to be scrolled."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,q", "dismiss", "Close")]
    DEFAULT_CSS = "HandHelpScreen .dialog { width: 100; }"

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text

    def compose(self) -> ComposeResult:
        """The lines, wrapped."""
        with VerticalScroll(classes="dialog") as box:
            box.border_title, box.border_subtitle = "Commands by hand", "↑ ↓ scroll │ escape closes"
            yield Static(Content(self._text))


class CardsPane(Pane):
    """Channels of the cards of `cell`, from what their PDOs carry. Only a hand that was handed in ever sends."""

    DEFAULT_CSS = """
    CardsPane #cards-state { height: auto; max-height: 3; text-wrap: wrap; }
    CardsPane #memory { height: 1fr; padding: 0 1; overflow: hidden; }
    CardsPane #memory.-apart { border-top: hkey $foreground 30%; }
    CardsPane #cards-chosen { background: $surface; }
    CardsPane #hand { display: none; height: auto; max-height: 8; padding: 0 1; background: $surface; }
    CardsPane #hand.-shown { display: block; }
    CardsPane Input { display: none; height: 1; border: none; padding: 0 1; }
    CardsPane Input.-shown { display: block; }
    CardsPane Static { height: auto; text-wrap: nowrap; text-overflow: ellipsis; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("t", "take", "By hand", id="hand.take", tooltip="Take the cards in hand, where no controller runs"),
        Binding("plus,equals_sign", "nudge(1)", "Code +1", show=False, id="hand.up"),
        Binding("minus", "nudge(-1)", "Code -1", show=False, id="hand.down"),
        Binding("right_square_bracket", "nudge(16)", "Code +16", show=False, id="hand.up16"),
        Binding("left_square_bracket", "nudge(-16)", "Code -16", show=False, id="hand.down16"),
        Binding("d", "turn", "Direction", show=False, id="hand.direction"),
        Binding("s", "step(1)", "Step", show=False, id="hand.step"),
        Binding("S", "step(10)", "10 steps", show=False, id="hand.steps"),
        Binding("0", "off", "All off", show=False, id="hand.off"),
        Binding("j", "command", "Command", show=False, id="hand.command", tooltip=HOW),
        Binding("escape", "leave", "Back", show=False),
    ]

    def __init__(
        self, cell: Cell, watch: BusWatch, hand: Hand | None, memory: bytes | None = None, is_recorded: bool = False
    ) -> None:
        super().__init__()
        self._is_recorded = is_recorded
        self.cell, self.bus, self.hand = cell, watch, hand
        self.mirror = MemoryMirror(cell, memory)
        watch.listeners.append(self.mirror)
        self._channels = card_channels(cell)
        self._data: Mapping[int, bytes] = {}
        self._fresh: frozenset[int] = frozenset()
        self._said: Word | None = None

    def compose(self) -> ComposeResult:
        """Figures, channels, memory, what the hand says."""
        yield WordLine(id="cards-state", may_wrap=True)
        grid = Grid[CardChannel](COLUMNS, self._cells, lambda each: (each.card.name, each.channel.number), id="cards")
        grid.widths = {"card": min(LONGEST_CARD, max(len(each.card.name) for each in self._channels))}
        yield grid
        yield WordLine(id="cards-chosen")
        with VerticalScroll(id="memory", can_focus=False):
            yield Static(id="memory-text")
        yield Static(id="hand")
        yield Input(placeholder=HOW, id="hand-command", compact=True)

    def chosen(self) -> None:
        """Somebody looks: the bus is opened."""
        self.bus.wake()
        self.query_one("#cards").focus()

    def show(self, scene: Scene) -> None:
        """Show the cards as their PDOs have them now."""
        now = self.bus.now(scene.now_ns)
        rows = {row.frame.can_id: row for row in now.rows if not row.frame.is_extended and not row.frame.is_remote}
        self._data = {can_id: row.frame.data for can_id, row in rows.items()}
        self._fresh = frozenset(
            can_id for can_id, row in rows.items() if scene.now_ns - row.changed_wall_ns < CHANGED_NS
        )
        self.mirror.anchor(scene.snapshot.cycle)
        words = [*state_words(self.bus.link, now, scene.now_ns, self.bus.is_behind), self._hand_word()]
        if self.bus.link.state is not LinkState.LOST:
            words.append(position_word(self.mirror))
        self.query_one("#cards-state", WordLine).show(tuple(words))
        self.query_one("#cards", Grid).show(self._channels)
        self._show_hand()
        is_narrow = self._show_chosen()
        self._show_memory(self.size.height - self.query_one("#cards-state").size.height - is_narrow)

    def _show_chosen(self) -> bool:
        """The registers of the chosen row, where the table has no room for them."""
        line = self.query_one("#cards-chosen", WordLine)
        line.display = self.size.width - 1 < REGISTERS_FROM_COLUMNS
        each: CardChannel | None = self.query_one("#cards", Grid).chosen
        if each is not None and line.display:
            _, card, _, _, _, (bits,), (registers,), *_ = self._cells(each)
            line.show((Word(each.signal), *card, Word(f"bits {bits.text}"), registers))
        return line.display

    def _show_memory(self, room: int) -> None:
        """The table has the lines of its rows if every page keeps one; what the table leaves is the memory's."""
        pages, rows, panel = len(self.mirror.pages), len(self._channels) + 1, self.query_one("#hand")
        room -= panel.size.height if panel.has_class("-shown") else 0
        table = min(rows, max(LEAST_TABLE, room - pages))
        left = room - table
        memory = self.query_one("#memory")
        memory.display = left > 0
        self.query_one("#cards").styles.height = table if left > 0 else "1fr"
        is_apart = left > pages
        memory.set_class(is_apart, "-apart")
        if left > 0:
            per_page = max(1, (left - is_apart) // max(1, pages))
            lines = memory_lines(self.mirror, self.cell.joint_names, self.size.width - 4, per_page)
            self.query_one("#memory-text", Static).update(_content(lines))

    def _cells(self, each: CardChannel) -> Sequence[Sequence[Word]]:
        code = each.code(self._data)
        pending = None
        if self.hand is not None and self.hand.codes and each.channel.leaf == Command.CURRENT:
            pending = self.hand.codes[each.joint]
        layout = each.layout
        return channel_cells(self.cell, each, code, pending, layout is not None and layout.cob_id in self._fresh)

    def _hand_word(self) -> Word:
        if self.hand is None or self.hand.state is HandState.OFF:
            return Word("watched only", Tone.DIM)
        return Word(f"✋ by hand, {self.hand.state.value}", Tone.WARNING)

    def _show_hand(self) -> None:
        panel = self.query_one("#hand", Static)
        lines = [] if self.hand is None else list(self.hand.lines)[-LINES_SHOWN:]
        shown = [
            [Word(f"{'✖ ' if is_wrong else ''}{text}", Tone.BAD if is_wrong else Tone.PLAIN)]
            for is_wrong, text in lines
        ]
        if self._said is not None:
            shown.append([self._said])
        if self.hand is not None and self.hand.state is not HandState.OFF:
            keys = (
                "+ − [ ] code of the chosen output │ d direction │ s step, S ten │ 0 all off │ j a command │ t lets go"
            )
            shown.append([Word(keys, Tone.DIM)])
        panel.set_class(bool(shown), "-shown")
        panel.update(_content(shown))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Without a hand its keys are others', such as those that play a record."""
        if self.hand is None and action in ("nudge", "turn", "step", "off", "command"):
            return False
        if self._is_recorded and action == "take":
            return False
        return super().check_action(action, parameters)

    def _ready(self) -> Hand | None:
        """The hand, if it can be told something; else says why not."""
        hand = self.hand
        if hand is None:
            self._said = Word(_NO_HAND, Tone.WARNING)
        elif hand.state is HandState.OFF:
            self._said, hand = Word(_NOT_TAKEN, Tone.WARNING), None
        else:
            self._said = None
        return hand

    def action_take(self) -> None:
        """Take the cards in hand, after asking, or let them go."""
        hand = self.hand
        if hand is None:
            self._ready()
        elif hand.state is HandState.OFF:
            self.app.push_screen(TakeScreen(), lambda is_wanted: hand.take() if is_wanted else None)
            self._said = None
        else:
            hand.release()

    def _joint(self) -> tuple[int, str] | None:
        """The joint of the chosen output."""
        each: CardChannel | None = self.query_one("#cards", Grid).chosen
        if each is None or not each.is_output:
            self._said = Word("choose a row with →, an output, first", Tone.WARNING)
            return None
        return each.joint, self.cell.joint_names[each.joint]

    def action_nudge(self, steps: int) -> None:
        """Another code at the chosen output's joint."""
        hand, chosen = self._ready(), self._joint() if self.hand is not None else None
        if hand is None or chosen is None or not hand.codes:
            return
        joint, name = chosen
        highest = next(
            each.codec.full_scale
            for each in self._channels
            if each.joint == joint and each.channel.leaf == Command.CURRENT
        )
        hand.do(f"dac {name} {max(0, min(highest, hand.codes[joint] + steps))}")

    def action_turn(self) -> None:
        """The next direction of the chosen output's joint: off, ccw, cw."""
        hand, chosen = self._ready(), self._joint() if self.hand is not None else None
        if hand is not None and chosen is not None and hand.directions:
            joint, name = chosen
            place = DIRECTIONS.index(hand.directions[joint])
            hand.do(f"dir {name} {DIRECTIONS[(place + 1) % len(DIRECTIONS)]}")

    def action_step(self, cycles: int) -> None:
        """So many cycles."""
        if (hand := self._ready()) is not None:
            hand.do(f"step {cycles}")

    def action_off(self) -> None:
        """Every code 0, every direction off."""
        if (hand := self._ready()) is not None:
            hand.do("off")

    def action_command(self) -> None:
        """Ask for commands."""
        if self._ready() is not None:
            field = self.query_one("#hand-command", Input)
            field.add_class("-shown")
            field.focus()

    def action_leave(self) -> None:
        """Close the line of commands."""
        field = self.query_one("#hand-command", Input)
        field.value = ""
        field.remove_class("-shown")
        self.query_one("#cards").focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Carry out what was typed."""
        event.stop()
        if (hand := self._ready()) is not None and event.value.strip() == "help":
            self.app.push_screen(HandHelpScreen(hand.help))
        elif hand is not None and event.value.strip():
            hand.do(event.value)
        self.action_leave()

    def on_unmount(self) -> None:
        """Leave the cards safe."""
        if self.hand is not None:
            self.hand.close()


def _content(lines: Sequence[Sequence[Word]]) -> Content:
    parts = (
        Content("").join(Content.styled(printable(word.text), STYLES[word.tone]) for word in line) for line in lines
    )
    return Content("\n").join(parts)


HELP = """\
A row for each wired channel: its slot and first address, → outputs and ← inputs, the code as the newest PDO carries it,
the registers that hold it, nominal volts, and what it stands for. ▸ is a code that acts at the next step.
On a narrow screen the chosen row's bits and registers stand below the table.
Below, in what room there is: the log pages of the Apple II's memory, filled from the bus, ▼ where the controller is;
of a recorded run the whole image, with its torque table.
t takes the cards in hand where no controller runs, as canarm jog does: + − [ ] change the code of the chosen output
by 1 and 16, d its direction, s and S step one cycle and ten, 0 switches all off, j takes any command of canarm jog."""

VIEW: View[Context] = View(
    name="cards",
    title="Cards",
    key="5",
    what="The cards' registers, codes and volts, and the Apple II's memory; by hand",
    make=lambda context: CardsPane(
        *(context.cell, context.bus, context.hand, context.memory, isinstance(context.feed, Player))
    ),
    help=HELP,
)
