"""The next run of a demo: what can be chosen for it, the dialog that asks, and what the front door has to offer.

What is typed is passed on as text; what it may be is known to the front door alone.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import ClassVar, Protocol

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.widgets import Input, Static

from .dialog import Dialog
from .fault_desk import Refusal
from .styles import STYLES
from .texts import Tone


@dataclass(frozen=True, slots=True)
class NextRun:
    """A run to come, as on the command line."""

    law: str
    trajectory: str
    seed: str
    pace: str


class Again(Protocol):
    """Who can run again. `number` counts the runs: another one is shown from its own bus as soon as it begins."""

    @property
    def number(self) -> int:
        """Which run it is, from 1."""

    @property
    def ends_here(self) -> bool:
        """Whether it is ended by leaving this dashboard."""

    @property
    def last(self) -> NextRun:
        """The run that is shown."""

    @property
    def hints(self) -> NextRun:
        """What each of the fields may be."""

    def start(self, wanted: NextRun) -> str:
        """End what is left of the last run and begin another one; say so in a few words. Takes seconds.

        Raises `CanarmError` if there is no such run; the last one is as it was then, unless it has begun to end.
        """

    @property
    def folder(self) -> str:
        """Where the run is recorded."""


Start = Callable[[NextRun, Callable[[str | Refusal], None]], None]


class AgainScreen(Dialog[str]):
    """Ends with what was said of the new run, or None if the user cancels."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss", "Back"),
        Binding("up", "app.focus_previous", "Up", show=False, priority=True),
        Binding("down", "app.focus_next", "Down", show=False, priority=True),
    ]
    DEFAULT_CSS = """
    AgainScreen .dialog { width: 96; }
    AgainScreen Horizontal { height: auto; }
    AgainScreen .name { width: 12; }
    AgainScreen Input { width: 28; }
    AgainScreen .hint { width: 1fr; padding-left: 1; color: $foreground 60%; }
    AgainScreen #said { height: auto; max-height: 6; }
    """

    def __init__(self, again: Again, start: Start) -> None:
        super().__init__()
        self._again, self._start = again, start
        self._is_asking = False

    def compose(self) -> ComposeResult:
        """A field for everything that can be another one."""
        last, hints = self._again.last, self._again.hints
        with Vertical(classes="dialog") as box:
            box.border_title, box.border_subtitle = "Run again", "↑ ↓ next field │ enter runs │ escape goes back"
            for each in fields(NextRun):
                with Horizontal():
                    yield Static(each.name, classes="name")
                    yield Input(getattr(last, each.name), name=each.name, compact=True, select_on_focus=False)
                    yield Static(Content(getattr(hints, each.name)), classes="hint")
            yield Static(id="said")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter: run."""
        if self._is_asking or not self.is_there:
            return
        self._is_asking = True
        self._say("… starting", Tone.DIM)
        typed = {field.name or "": field.value.strip() for field in self.query(Input)}
        self._start(NextRun(**typed), self.while_open(self._take))

    def _take(self, answer: str | Refusal) -> None:
        self._is_asking = False
        if isinstance(answer, Refusal):
            self._say(answer.reason, Tone.BAD)
        else:
            self.dismiss(answer)

    def _say(self, text: str, tone: Tone) -> None:
        self.query_one("#said", Static).update(Content.styled(text, STYLES[tone]))
