"""The views of the dashboard, in the order of their tabs. A view is a file and a line here."""

from . import events_view, joints_view

VIEWS = (
    joints_view.VIEW,
    events_view.VIEW,
)
