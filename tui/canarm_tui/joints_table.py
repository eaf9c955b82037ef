"""The table of joints: a row each, with as many columns as the terminal has room for. Draws what it is given."""

from collections.abc import Sequence
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.events import Click
from textual.geometry import Size
from textual.message import Message
from textual.strip import Strip

from canarm_protocol.shown import printable

from .drawn import Drawn
from .joint_texts import columns_for, joint_words
from .snapshot import JointNow
from .styles import STYLES
from .texts import Tone, Word

LONGEST_NAME = 24
LONGEST_TITLE = 13


class JointsTable(Drawn, can_focus=True):
    """A heading and a row per joint, one of which is chosen. Textual's own table takes three times as long to draw."""

    class Chosen(Message):
        """The user has chosen a joint, by its place."""

        def __init__(self, joint: int) -> None:
            super().__init__()
            self.joint = joint

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"joints--{part}" for part in ("heading", "chosen", "focused")}
    DEFAULT_CSS = """
    JointsTable { height: auto; max-height: 50%; }
    JointsTable .joints--heading { text-style: bold; background: $panel; }
    JointsTable .joints--chosen { text-style: bold; background: $surface-lighten-2; }
    JointsTable .joints--focused { text-style: bold; background: $primary-muted; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "choose(-1)", "Joint above", show=False, id="joints.up"),
        Binding("down", "choose(1)", "Joint below", show=False, id="joints.down"),
    ]

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(id="joints")
        self._names = [printable(name, LONGEST_NAME) for name in names]
        self._name_width = max(len("joint"), *map(len, self._names))
        self._joints: Sequence[JointNow] = [JointNow()] * len(names)
        self._inner, self._inner_name = 0, ""
        self.joint = 0
        """The place of the chosen joint."""
        self._top = 0

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """A heading and the joints."""
        return 1 + len(self._names)

    def show(self, joints: Sequence[JointNow], inner: int, inner_name: str) -> None:
        """Show the state of the joints, and of the law's own values the one of that place and name."""
        self._joints, self._inner, self._inner_name = joints, inner, printable(inner_name, LONGEST_TITLE)
        self.redraw()

    def row(self, joint: int) -> list[str]:
        """What stands in the row of a joint."""
        words = joint_words(self._joints[joint], columns_for(self.app.size.width), self._inner)
        return [self._names[joint], *(word.text for word in words)]

    def action_choose(self, step: int) -> None:
        """The joint above or below."""
        self._choose(min(max(self.joint + step, 0), len(self._names) - 1))

    def on_click(self, event: Click) -> None:
        """Choose the joint that was clicked at."""
        joint = self._top + event.y - 1
        if event.y >= 1 and joint < len(self._names):
            self._choose(joint)

    def on_focus(self) -> None:
        """The chosen row looks otherwise."""
        self.redraw()

    def on_blur(self) -> None:
        """The chosen row looks otherwise."""
        self.redraw()

    def _choose(self, joint: int) -> None:
        if joint != self.joint:
            self.joint = joint
            self.redraw()
            self.post_message(self.Chosen(joint))

    def draw(self, width: int, height: int) -> list[Strip]:
        """The heading, and as many rows as there is room for, the chosen one among them."""
        columns, room = columns_for(self.app.size.width), max(height - 1, 1)
        self._top = min(max(self._top, self.joint - room + 1), self.joint, max(len(self._names) - room, 0))
        heading = "joint".ljust(self._name_width) + "".join(
            (column.title or self._inner_name).rjust(column.width) for column in columns
        )
        strips = [self._row([Word(heading)], width, self.style_of("joints--heading"))]
        chosen = self.style_of("joints--focused" if self.has_focus else "joints--chosen")
        for joint in range(self._top, min(self._top + room, len(self._names))):
            words = [Word(self._names[joint].ljust(self._name_width))]
            shown = joint_words(self._joints[joint], columns, self._inner)
            words += (
                Word(word.text.rjust(column.width), word.tone) for word, column in zip(shown, columns, strict=True)
            )
            strips.append(self._row(words, width, chosen if joint == self.joint else None))
        return strips

    def _row(self, words: Sequence[Word], width: int, over: Style | None) -> Strip:
        plain = self.described(STYLES[Tone.PLAIN])
        styles = {tone: self.described(STYLES[tone]) for tone in {word.tone for word in words}}
        if over is not None:
            under = Style(bgcolor=over.bgcolor, bold=over.bold)
            styles = {tone: over if tone is Tone.PLAIN else style + under for tone, style in styles.items()}
            plain = over
        parts = [Segment(" ", plain), *(Segment(word.text, styles[word.tone]) for word in words)]
        return Strip(parts).adjust_cell_length(width, plain)
