"""The help screen: keys, and the meaning of the texts on the screen. Each view brings its own part."""

from collections.abc import Iterable
from textwrap import indent
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from .dialog import Dialog
from .views import View

_KEYS = """\
[b]Keys[/b]
  e  emergency stop, at once, from everywhere; asks before it is released; in a text field: ctrl+e
  f  inject a fault      x  clear faults, or begin one that waits (t)
  space  pause and go on      ctrl+p  all commands      ?  this help
  r  run again, when a run of canarm demo is over; law, motion, seed and pace can be other ones
  h  how it went: all of the summary      w  stop recording, or go on with it
  R  reset: the robot off and on again, as canarm reset does; it asks first
  q  leave; whatever runs goes on      Q  leave and stop what runs; it asks first      ctrl+c  leave; ends a demo
  When the run of canarm demo is over, the dashboard stays, with how it went at the top.
  A recorded run: space stops and goes on, n N the next event and the one before, [ ] 5 s back and on, , . speed
  Paused, the panes stand still; data are still received, and the header stays live."""
_SCREEN = """\
[b]Header[/b]
  connected      the bus is open and the bench sends
  no data        the bus is open, but no bench has sent telemetry on it
  rec            the bench records frames and signals; "not recorded": w has stopped that
  lost           the bus is gone; the last data stay, and it is tried again every second
  controller lost  it has said nothing for more than a second, while the bench goes on
  stale          nothing has come for more than half a second
  late           cycles that the controller began too late
  cycles/s       cycles a second of the bus's time, and of wall time where that differs
  × real time    how many seconds of the run pass in a second

[b]Faults and detections[/b]
  Under the joints as soon as there are some: which act, since when and for how long yet, which sets wait for what, the
  last three events.
  ◆ detected     what a controller has detected, what it did, and how long after the last fault began
  Times are seconds from cycle 0 of the present run. Without any there is no such part.
  f asks the bench what it can inject where: type a part of a name, choose with ↑ and ↓, go on with enter.
  When it acts stands below its values: at once unless you say when. A field that is left as it is keeps its default.
  What the bench refuses, it says in the dialog."""


DASHBOARD = _KEYS, _SCREEN


def help_text(views: Iterable[View[Any]], parts_before: tuple[str, ...] = DASHBOARD) -> str:
    """Keys, what the screen says, and what each of `views` shows, in textual's markup.

    Of `parts_before` the first is about keys, and the keys of the views follow it.
    """
    tabs = "\n".join(f"  {view.key}  {view.title}: {view.what[:1].lower()}{view.what[1:]}" for view in views)
    parts = [f"[b]{view.title}[/b]\n{indent(view.help, '  ')}" for view in views if view.help]
    keys, *others = parts_before
    return "\n\n".join([f"{keys}\n{tabs}", *others, *parts])


class HelpScreen(Dialog[None]):
    """The help screen."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,question_mark,space", "dismiss", "Close"),
        Binding("q", "app.quit", "Quit"),
    ]
    DEFAULT_CSS = """
    HelpScreen .dialog { width: 108; }
    """

    def __init__(
        self,
        views: Iterable[View[Any]],
        parts_before: tuple[str, ...] = DASHBOARD,
        title: str = "canarm dashboard",
    ) -> None:
        super().__init__()
        self._text, self._heading = help_text(views, parts_before), title

    def compose(self) -> ComposeResult:
        """The text, and how to close it."""
        with VerticalScroll(classes="dialog") as box:
            box.border_title, box.border_subtitle = self._heading, "escape closes"
            yield Static(self._text)
