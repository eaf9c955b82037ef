"""The views of the dashboard, in the order of their tabs. A view is a file and a line here."""

from . import events_view, joints_view, wire_view
from .bus import cards_view, frames_view, nodes_view
from .views import Context, View

VIEWS: tuple[View[Context], ...] = (
    joints_view.VIEW,
    events_view.VIEW,
    frames_view.VIEW,
    nodes_view.VIEW,
    cards_view.VIEW,
    wire_view.VIEW,
)
