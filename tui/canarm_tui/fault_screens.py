"""The small dialogs: which sets to clear or trigger, emergency stop, power-on reset, leaving. Others do it."""

from collections.abc import Collection, Sequence
from typing import ClassVar, NamedTuple

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.events import Key
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from .dialog import Dialog

ALL = "all faults and all sets that wait"
KEYS = "enter clears │ escape closes"


class Chosen(NamedTuple):
    """A set (None: all of them), which is to begin if `is_begin`, or else to end."""

    name: str | None
    is_begin: bool = False


class ClearScreen(Dialog[Chosen]):
    """Ends with what was chosen, or None if the user cancels. `waiting` sets can be triggered."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q", "dismiss", "Close"),
        Binding("t", "trigger", "Trigger"),
    ]
    DEFAULT_CSS = """
    ClearScreen .dialog { width: 76; }
    ClearScreen OptionList, ClearScreen OptionList:focus {
        height: auto; max-height: 16; border: none; padding: 0; text-wrap: nowrap; text-overflow: ellipsis;
    }
    """

    def __init__(self, names: Sequence[str], waiting: Collection[str] = ()) -> None:
        super().__init__()
        self._waiting = waiting
        self._choices: tuple[str | None, ...] = (None, *names)

    def compose(self) -> ComposeResult:
        """A line for all, and one per set."""
        with Vertical(classes="dialog") as box:
            keys = "enter clears │ t triggers what waits │ escape closes" if self._waiting else KEYS
            box.border_title, box.border_subtitle = "Clear", keys
            yield OptionList(*(Option(Content(self._line(name))) for name in self._choices))

    def _line(self, name: str | None) -> str:
        return ALL if name is None else f"{name}{' (waits)' * (name in self._waiting)}"

    def action_trigger(self) -> None:
        """Begin the set at the cursor, if it waits."""
        place = self.query_one(OptionList).highlighted
        name = None if place is None else self._choices[place]
        if name in self._waiting:
            self.dismiss(Chosen(name, is_begin=True))

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Clear the selected line."""
        self.dismiss(Chosen(self._choices[event.option_index]))


class QuestionScreen(Dialog[bool]):
    """Ends with the answer to a question; `key` says yes too."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter,y", "answer(True)", "Yes"),
        Binding("escape,n,q", "answer(False)", "No"),
    ]
    DEFAULT_CSS = """
    QuestionScreen .dialog { width: 60; border: heavy $error; padding: 1 2; }
    """

    def __init__(self, title: str, question: str, key: str) -> None:
        super().__init__()
        self._heading, self._text, self._yes = title, question, key

    def compose(self) -> ComposeResult:
        """The question."""
        question = Static(self._text, classes="dialog")
        question.border_title = self._heading
        keys = "enter or y" if self._yes == "y" else f"enter, y or {self._yes}"
        question.border_subtitle = f"{keys}: yes │ escape, n: no"
        yield question

    def on_key(self, event: Key) -> None:
        """The key that has led here says yes as well."""
        if event.key == self._yes:
            event.stop()
            self.dismiss(True)

    def action_answer(self, is_wanted: bool) -> None:
        """The user has decided."""
        self.dismiss(is_wanted)


class StopScreen(QuestionScreen):
    """Whether the emergency stop is to be released."""

    def __init__(self) -> None:
        question = "Close the supply of all amplifiers again?\nThe robot may move at once."
        super().__init__("Emergency stop", question, "y")


class LeaveScreen(QuestionScreen):
    """Whether to leave and stop what runs: `is_demo` says that it is ours."""

    def __init__(self, is_demo: bool) -> None:
        what = "The demo ends: the robot stops safely, and its processes end."
        if not is_demo:
            what = (
                "The supply of all amplifiers is opened, and the controller ends in a safe stop. The emulator stays, "
                "for others have started it."
            )
        super().__init__("Leave and stop", f"Leave the dashboard, and stop what runs?\n{what}", "Q")


class ResetScreen(QuestionScreen):
    """Whether the robot is to be switched off and on again."""

    def __init__(self) -> None:
        super().__init__(
            "Reset",
            "Switch the robot off and on again?\nFaults and emergency stop are gone then, the arm is parked, and a "
            "controller that runs loses its cards.",
            "R",
        )
