"""How a run has ended, as the dashboard shows it: values and the panel that stays below the header."""

from collections.abc import Sequence
from typing import NamedTuple

from textual.content import Content
from textual.widgets import Static

from .styles import line_of
from .texts import Tone, Word

LOW_ROWS = 30
LEAVE = Word("q leaves", Tone.DIM)
AGAIN = Word("r runs again", Tone.DIM)


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
    OutcomePanel.-low { max-height: 5; }
    """

    def __init__(self, may_run_again: bool = False) -> None:
        super().__init__(id="outcome")
        self._keys = (AGAIN, LEAVE) if may_run_again else (LEAVE,)
        self.outcome: Outcome | None = None

    def show(self, outcome: Outcome | None) -> None:
        """Show it, or nothing; on a low terminal its first lines, and the others can be scrolled to."""
        self.set_class(self.app.size.height < LOW_ROWS, "-low")
        if outcome == self.outcome:
            return
        self.outcome = outcome
        self.set_class(outcome is not None, "-shown")
        if outcome is not None:
            sign, tone = ("✓", Tone.GOOD) if outcome.is_well else ("✖", Tone.BAD)
            lines = [line_of((Word(f"{sign} {outcome.verdict}", tone), *self._keys))]
            lines += (line_of((Word(text),)) for text in outcome.details)
            self.update(Content("\n").join(lines), layout=True)
