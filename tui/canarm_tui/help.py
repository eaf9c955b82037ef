"""The help screen: keys, and the meaning of the texts on the screen."""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

HELP = """\
[b]Keys[/b]
  q  quit      space  pause and go on      ctrl+p  all commands      ?  this help
  f  inject a fault      x  clear faults      e  emergency stop, on and off; it asks first
  r  reset: the robot off and on again, as canarm reset does; it asks first
  1  the joints      2  events: faults and detections, newest first; the arrows scroll
  q and ctrl+c leave the dashboard; of canarm demo they stop the robot, of canarm tui nothing else.
  When the run of canarm demo is over, the dashboard stays, with how it went at the top.
  Paused, the panes stand still; data are still received, and the header stays live.

[b]Header[/b]
  connected      the bus is open and the bench sends
  no data        the bus is open, but no bench has sent telemetry on it
  lost           the bus is gone; the last data stay, and it is tried again every second
  stale          nothing has come for more than half a second
  late           cycles that the controller began too late
  cycles/s       cycles a second of the bus's time, and of wall time where that differs
  × real time    how many seconds of the run pass in a second

[b]Faults and detections[/b]
  Under the joints as soon as there are some: which act and since when, which sets wait, the last three events.
  ◆ detected     what a controller has detected, what it did, and how long after the last fault began
  Times are seconds since power-on, cycles count from NMT start. Without any there is no such part.
  f asks the bench what it can inject where: type a part of a name, choose with ↑ and ↓, go on with enter.
  A field that is left as it is keeps its default. What the bench refuses, it says in the dialog.

[b]Joints[/b]
  Angle, reference and error belong to the same cycle: the newest whose reference has arrived.
  While no cycles come, the angle is the present one, without reference and error.
  Error          true angle minus reference, in steps (LSB) of the joint's position sensor
  RMS            of the error over the last 10 s of the run, as are the traces
  saturated +/−  the amplifier is at its limit, in that direction
  ▲ ◆ ○          above a trace: a fault began, a detector answered, a fault ended; of this joint, or of none
  The traces need a terminal of 100 columns."""


class HelpScreen(ModalScreen[None]):
    """The help screen."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,question_mark,space", "dismiss", "Close"),
        Binding("q", "app.quit", "Quit"),
    ]
    DEFAULT_CSS = """
    HelpScreen { align: center middle; }
    HelpScreen VerticalScroll {
        width: 108; max-width: 100%; height: auto; max-height: 100%;
        border: round $primary; padding: 0 1; background: $surface;
    }
    """

    def compose(self) -> ComposeResult:
        """The text, and how to close it."""
        with VerticalScroll() as box:
            box.border_title, box.border_subtitle = "canarm dashboard", "escape closes"
            yield Static(HELP)
