"""How a run has ended, as the dashboard shows it: values, the panel below the header, and all of it in a dialog."""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Static

from .dialog import Dialog
from .styles import line_of
from .texts import Tone, Word

LOW_ROWS, LOW_LINES = 30, 7
"""On a terminal of fewer rows than this the panel has so many lines at most: those of two joints."""
LEAVE = Word("q leaves", Tone.DIM)
AGAIN = Word("r runs again", Tone.DIM)
ALL = Word("h shows all", Tone.DIM)
KEYS = {"r": "again", "q": "quit", "Q": "leave_and_stop"}
"""What the panel offers is to be had from all of the summary too: keys, and actions of the dashboard."""


class Outcome(NamedTuple):
    """The verdict in a few words, whether all went well, and further lines, the important ones first."""

    verdict: str
    is_well: bool
    details: Sequence[str] = ()


def with_cause(outcome: Outcome | None, cause: str) -> Outcome | None:
    """The outcome, if it is not well with the cause from outside, if there is one, before all details."""
    if outcome is None or outcome.is_well or not cause:
        return outcome
    return outcome._replace(details=(cause, *outcome.details))


class OutcomePanel(Static):
    """Hidden until there is an outcome."""

    DEFAULT_CSS = """
    OutcomePanel { display: none; height: auto; max-height: 50%; padding: 0 1; background: $panel; overflow-y: auto; }
    OutcomePanel.-shown { display: block; }
    OutcomePanel.-low { max-height: 7; overflow-y: hidden; text-wrap: nowrap; text-overflow: ellipsis; }
    """

    def __init__(self, may_run_again: bool = False) -> None:
        super().__init__(id="outcome")
        self._keys = (AGAIN, LEAVE) if may_run_again else (LEAVE,)
        self._shown: object = None
        self.outcome: Outcome | None = None

    def show(self, outcome: Outcome | None) -> None:
        """Show it, or nothing; on a low terminal its first lines, and how all of it is seen."""
        size, is_low = self.app.size, self.app.size.height < LOW_ROWS
        self.set_class(is_low, "-low")
        shown = outcome, size.width, is_low
        if shown == self._shown:
            return
        self._shown, self.outcome = shown, outcome
        self.set_class(outcome is not None, "-shown")
        if outcome is not None:
            self.update(Content("\n").join(self._lines(outcome, size.width - 2, is_low)), layout=True)

    def _lines(self, outcome: Outcome, width: int, is_low: bool) -> list[Content]:
        sign, tone = ("✓", Tone.GOOD) if outcome.is_well else ("✖", Tone.BAD)
        verdict, keys = Word(f"{sign} {outcome.verdict}", tone), self._keys
        if is_low and len(outcome.details) >= LOW_LINES - 1:
            keys = (*keys, ALL)
        first = [line_of((verdict, *keys))]
        if is_low and first[0].cell_length > width:
            first = [line_of((verdict,)), line_of(keys)]
        return [*first, *(line_of((Word(text),)) for text in outcome.details)]


class OutcomeScreen(Dialog[None]):
    """All of the summary, to be scrolled."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,h", "dismiss", "Close"),
        *(Binding(key, f"go_on('{action}')", show=False) for key, action in KEYS.items()),
    ]
    DEFAULT_CSS = """
    OutcomeScreen .dialog { width: 120; }
    """

    def __init__(self, outcome: Outcome, may_run_again: bool = False) -> None:
        super().__init__()
        self._further = " │ r runs again │ q leaves" if may_run_again else " │ q leaves"
        self._lines = (outcome.verdict, *outcome.details)

    async def action_go_on(self, action: str) -> None:
        """Close, and do what the key does without this dialog."""
        await self.dismiss()
        await self.app.run_action(action, self.app)

    def compose(self) -> ComposeResult:
        """The lines, wrapped."""
        with VerticalScroll(classes="dialog") as box:
            box.border_title = "How it went"
            box.border_subtitle = f"↑ ↓ scroll │ escape closes{self._further}"
            yield Static(Content("\n").join(line_of((Word(text),)) for text in self._lines))
