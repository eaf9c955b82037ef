"""The objects of one node: found by name or index, read and written, within the types and limits of the data sheet."""

from collections.abc import Sequence
from functools import partial
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input

from canarm_protocol.canopen.values import ValueTextError, type_text, value_bytes, value_text

from ..dialog import Dialog
from ..grid import Column, Grid
from ..texts import Tone, Word
from ..widgets import WordLine
from .objects import Entry, common_dictionary, entries_of
from .sdo_desk import Answer
from .watch import BusWatch

MOST_AT_ONCE = 64
"""Objects that one key reads."""
COLUMNS = (
    Column("object", 7),
    Column("name", 0),
    Column("type", 26, from_width=100),
    Column("access", 6, from_width=70),
    Column("value", 28),
)
_KEYS = "enter reads │ w writes │ a reads all shown │ / finds │ escape closes"
_NO_SHEET = "without a data sheet (--eds): what every device has or may have"
Key = tuple[int, int]


class SdoScreen(Dialog[None]):
    """The dictionary of a node. Nothing is sent before a key asks for it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "back", "Back"),
        Binding("q", "dismiss", "Close"),
        Binding("w", "write", "Write"),
        Binding("a", "read_all", "Read all"),
        Binding("slash", "find", "Find", key_display="/"),
    ]
    DEFAULT_CSS = """
    SdoScreen .dialog { width: 130; height: 90%; padding: 0; }
    SdoScreen Input { display: none; height: 1; border: none; padding: 0 1; }
    SdoScreen Input.-shown { display: block; }
    SdoScreen #sdo-said { height: auto; max-height: 4; text-wrap: wrap; }
    """

    def __init__(self, watch: BusWatch, node_id: int) -> None:
        super().__init__()
        self._bus, self._node_id = watch, node_id
        known = watch.book.dictionary(node_id)
        self._has_sheet = known is not None
        self._entries = entries_of(common_dictionary() if known is None else known)
        self._values: dict[Key, Word] = {}
        self._writing: Entry | None = None
        self.said: tuple[Word, ...] = () if self._has_sheet else (Word(_NO_SHEET, Tone.WARNING),)

    def compose(self) -> ComposeResult:
        """The objects, what was said last, and a line to type into."""
        with Vertical(classes="dialog") as box:
            box.border_title = f"Objects of {self._bus.book.name(self._node_id)}, node 0x{self._node_id:02X}"
            box.border_subtitle = _KEYS
            yield Grid[Entry](COLUMNS, self._cells, _key, id="objects", empty="no object fits")
            yield WordLine(id="sdo-said", may_wrap=True)
            yield Input(id="sdo-find", placeholder="part of a name, or an index such as 1018", compact=True)
            yield Input(id="sdo-value", compact=True)

    def on_mount(self) -> None:
        """Show all objects."""
        self._show(self._entries)
        self.query_one(Grid).focus()
        self._say(*self.said)

    def _cells(self, entry: Entry) -> Sequence[Sequence[Word]]:
        variable = entry.variable
        value = self._values.get(_key(entry), Word("" if entry.is_readable else "write only", Tone.DIM))
        return (
            (Word(entry.where),),
            (Word(entry.name),),
            (Word(type_text(variable), Tone.DIM),),
            (Word(str(variable.access_type), Tone.DIM),),
            (value,),
        )

    def _show(self, entries: Sequence[Entry]) -> None:
        self.query_one("#objects", Grid).show(entries)

    def _say(self, *words: Word) -> None:
        self.said = words
        self.query_one("#sdo-said", WordLine).show(words)

    def on_grid_chosen(self, event: Grid.Chosen) -> None:
        """Read the object at the cursor."""
        event.stop()
        if self.is_there:
            self._read(event.row)

    def _read(self, entry: Entry) -> None:
        if not entry.is_readable:
            self._say(Word(f"{entry.where} {entry.name}: write only, by its data sheet", Tone.WARNING))
            return
        self._note(entry, Word("…", Tone.DIM))
        self._bus.desk.read(self._node_id, entry.index, entry.subindex, self.while_open(partial(self._take, entry)))

    def _take(self, entry: Entry, answer: Answer) -> None:
        if answer.failure is not None:
            self._note(entry, Word(f"✖ {answer.failure}", Tone.BAD))
            self._say(Word(f"{entry.where} {entry.name}: {answer.failure}", Tone.BAD))
            return
        text = value_text(entry.variable, answer.data)
        self._note(entry, Word(text))
        self._say(Word(f"{entry.where} {entry.name} = {text}"))

    def _note(self, entry: Entry, word: Word) -> None:
        self._values[_key(entry)] = word
        self.query_one(Grid).refresh()

    def action_read_all(self) -> None:
        """Read what is shown, but not more than `MOST_AT_ONCE`."""
        entries = [entry for entry in self.query_one(Grid).rows if entry.is_readable]
        for entry in entries[:MOST_AT_ONCE]:
            self._read(entry)
        if len(entries) > MOST_AT_ONCE:
            self._say(Word(f"the first {MOST_AT_ONCE} of {len(entries)} are read; / shows fewer", Tone.WARNING))

    def action_write(self) -> None:
        """Ask for the value of the object at the cursor."""
        entry: Entry | None = self.query_one(Grid).chosen
        if entry is None:
            return
        if not entry.is_writable:
            self._say(Word(f"{entry.where} {entry.name}: read only, by its data sheet", Tone.WARNING))
            return
        self._writing = entry
        field = self.query_one("#sdo-value", Input)
        field.value = ""
        field.placeholder = f"{entry.where} {entry.name}: {type_text(entry.variable)}"
        self._say(Word(f"{entry.where} {entry.name} is to be: {type_text(entry.variable)}; enter writes it"))
        self._open(field)

    def action_find(self) -> None:
        """Ask which objects to show."""
        self._open(self.query_one("#sdo-find", Input))

    def _open(self, field: Input) -> None:
        field.add_class("-shown")
        field.focus()

    def action_back(self) -> None:
        """Close what is open: the value, what was looked for, the screen."""
        shown = [field for field in self.query(Input) if field.has_class("-shown")]
        if not shown:
            self.dismiss()
        for field in shown:
            field.remove_class("-shown")
            if field.id == "sdo-find":
                field.value = ""
        self._writing = None
        self.query_one(Grid).focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """What is looked for acts at once."""
        event.stop()
        if event.input.id == "sdo-find" and self.is_there:
            wanted = event.value.strip().casefold()
            self._show(
                [each for each in self._entries if wanted in f"{each.where} 0x{each.where} {each.name}".casefold()]
            )

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Write the value if it fits; else say what would."""
        event.stop()
        if not self.is_there:
            return
        entry = self._writing
        if event.input.id == "sdo-value" and entry is not None:
            try:
                data = value_bytes(entry.variable, event.value)
            except ValueTextError as error:
                self._say(Word(f"{entry.where} {entry.name}: {error}", Tone.BAD))
                return
            self._note(entry, Word("…", Tone.DIM))
            then = self.while_open(partial(self._written, entry))
            self._bus.desk.write(self._node_id, entry.index, entry.subindex, data, then)
            self._writing = None
        event.input.remove_class("-shown")
        self.query_one(Grid).focus()

    def _written(self, entry: Entry, answer: Answer) -> None:
        if answer.failure is not None:
            self._take(entry, answer)
        elif entry.is_readable:
            self._read(entry)
        else:
            self._note(entry, Word("written", Tone.GOOD))
            self._say(Word(f"{entry.where} {entry.name} is written", Tone.GOOD))

    def on_unmount(self) -> None:
        """Nobody waits for answers any more."""
        self._bus.desk.drop()


def _key(entry: Entry) -> Key:
    return entry.index, entry.subindex
