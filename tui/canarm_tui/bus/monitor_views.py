"""The views of the monitor, in the order of their tabs: those of the dashboard that need a bus alone."""

from ..views import View
from . import frames_view, nodes_view
from .frames_view import FramesPane
from .nodes_view import NodesPane
from .watch import BusWatch

MONITOR_HELP = (
    """\
[b]Keys[/b]
  q  quit      space  pause and go on      ctrl+p  all commands      ?  this help
  Nothing is sent to the bus unless you read or write an object.
  Frames are decoded as CANopen, and by what --cell, --eds and --dbc say of them.""",
)
MONITOR_VIEWS: tuple[View[BusWatch], ...] = (
    View("bus", "Bus", "1", "Frames of the bus, decoded", FramesPane, frames_view.HELP),
    View("nodes", "Nodes", "2", "Nodes of the bus, and their objects", NodesPane, nodes_view.HELP),
)
