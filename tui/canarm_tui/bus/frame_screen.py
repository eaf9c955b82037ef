"""One kind of frame, opened: its figures, its bits, and the signals that they belong to. It goes on while open."""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Static

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.decoding import Field, Meaning
from canarm_protocol.shown import printable

from ..dialog import Dialog
from ..styles import STYLES
from ..texts import Tone, Word
from .bus_texts import identifier_text, period_text, rate_text
from .rows import Key, RowNow
from .store import Heard
from .watch import BusWatch

REDRAW_S = 0.1
LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
"""By which bits and signals find each other."""

Lines = list[list[Word]]


def frame_lines(frame: Frame, meaning: Meaning, changed: int, row: RowNow | None) -> Lines:
    """Title and figures, a line of bits for each byte with the letters of its signals, then a line per signal."""
    lines = [[Word(f"{identifier_text(frame)}  "), Word(meaning.title, Tone.BAD if meaning.is_wrong else Tone.GOOD)]]
    lines.append([Word(_figures(frame, row), Tone.DIM)])
    if meaning.text and (meaning.said or not meaning.fields):
        lines.append([Word(meaning.text, Tone.BAD if meaning.is_wrong else Tone.PLAIN)])
    if frame.is_remote or not frame.data:
        return lines
    letters = _letters(meaning.fields)
    lines += [[], [Word("byte  hex   7 6 5 4 3 2 1 0    signals    character", Tone.DIM)]]
    for place, octet in enumerate(frame.data):
        words = [Word(f"{place:>4}   ", Tone.DIM), Word(f"{octet:02X}   ")]
        for bit in range(7, -1, -1):
            at = 8 * place + bit
            words.append(Word(str(octet >> bit & 1), Tone.CHANGED if changed >> at & 1 else Tone.PLAIN))
            words.append(Word(" "))
        words.append(Word("   "))
        words += (Word(letters.get(8 * place + bit, "·"), Tone.GOOD) for bit in range(7, -1, -1))
        character = chr(octet) if 0x20 <= octet < 0x7F else "·"
        words += [Word("   "), Word(character, Tone.DIM)]
        lines.append(words)
    if meaning.fields:
        lines += [[], *(_field_line(letter, field) for letter, field in zip(LETTERS, meaning.fields, strict=False))]
    return lines


def _letters(fields: tuple[Field, ...]) -> dict[int, str]:
    """The letter of the signal of each bit."""
    return {bit: letter for letter, field in zip(LETTERS, fields, strict=False) for bit in field.bits}


def _field_line(letter: str, field: Field) -> list[Word]:
    order = ", big-endian" if field.is_big_endian and field.bit_length > 1 else ""
    where = f"bits {field.start_bit}+{field.bit_length}{order}"
    return [
        Word(f"{letter}  ", Tone.GOOD),
        Word(f"{field.name:<32} "),
        Word(f"{field.text:<24} "),
        Word(where, Tone.DIM),
    ]


def _figures(frame: Frame, row: RowNow | None) -> str:
    size = f"{len(frame.data)} bytes" + (", remote" if frame.is_remote else "")
    sort = "error frame" if frame.is_error else "29 bits" if frame.is_extended else "11 bits"
    if row is None:
        return f"{sort}, {size}"
    period = period_text(row.period_ns)
    unit = "" if period.endswith("s") else " ms"
    return f"{sort}, {size}   {row.times} frames   {rate_text(row.rate_hz)}/s   every {period}{unit}"


class FrameScreen(Dialog[None]):
    """A row of the table that goes on changing, or one frame of the log as it was."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,enter,q", "dismiss", "Close"),
        Binding("space", "hold", "Hold"),
    ]
    DEFAULT_CSS = """
    FrameScreen .dialog { width: 96; }
    FrameScreen Static { height: auto; text-wrap: nowrap; text-overflow: ellipsis; }
    """

    def __init__(self, watch: BusWatch, key: Key, opened: RowNow | Heard) -> None:
        super().__init__()
        self._watch, self._key, self._opened = watch, key, opened
        self._is_held = isinstance(opened, Heard)

    def compose(self) -> ComposeResult:
        """One text."""
        with VerticalScroll(classes="dialog") as box:
            box.border_title = "Frame"
            box.border_subtitle = "escape closes" if self._is_held else "space holds │ escape closes"
            yield Static(id="frame-text")

    def on_mount(self) -> None:
        """Draw, and go on drawing."""
        self.redraw()
        self.set_interval(REDRAW_S, self.redraw)

    def action_hold(self) -> None:
        """Stand still, or go on."""
        if isinstance(self._opened, RowNow):
            self._is_held = not self._is_held
            self.query_one(VerticalScroll).border_title = "Frame, held" if self._is_held else "Frame"

    def redraw(self) -> None:
        """Draw the newest frame of the row, unless it is held."""
        if not self.is_there:
            return  # a last tick
        row = self._opened if isinstance(self._opened, RowNow) else None
        if row is not None and not self._is_held:
            row = self._watch.store.row(self._key) or row
            self._opened = row
        opened = self._opened
        meaning = self._watch.decoder.meaning(opened.frame, opened.about)
        lines = frame_lines(opened.frame, meaning, 0 if row is None else row.changed, row)
        shown = Content("\n").join(
            Content("").join(Content.styled(printable(word.text), STYLES[word.tone]) for word in line) for line in lines
        )
        self.query_one(Static).update(shown)
