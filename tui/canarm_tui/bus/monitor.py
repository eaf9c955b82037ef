"""The views of a bus as a program of its own, on any CAN bus, with or without a bench."""

import asyncio
import signal
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, ClassVar

from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.screen import Screen
from textual.widgets import ContentSwitcher

from ..help import HelpScreen
from ..keys_line import KeysLine
from ..news import News
from ..snapshot import Snapshot
from ..steady import SteadyApp
from ..terminal import check_terminal, ending_signals, run_app
from ..texts import Tone, Word
from ..view_tabs import ViewTabs
from ..views import Pane, Scene
from ..widgets import WordLine
from .frames_view import FramesPane
from .monitor_views import MONITOR_HELP, MONITOR_VIEWS
from .watch import BusWatch

DRAIN_HZ = 50
REDRAW_HZ = 10
IDLE_NS = 500_000_000
"""While nothing comes, ages are drawn this often."""
_NO_RUN = Snapshot(())


class MonitorApp(SteadyApp):
    """The views of `watch`. `until` ends it when true, each of `signals` too; `clock_ns` is the wall clock."""

    TITLE = "canarm monitor"
    CSS = """
    #header { background: $panel; }
    #panes { height: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", "Quit", id="app.quit"),
        Binding("question_mark", "help", "Help", key_display="?", id="app.help", tooltip="What the screen means"),
        Binding("space", "pause", "Pause", id="view.pause", tooltip="Hold the screen; frames are still received"),
        Binding("ctrl+c", "quit", "Quit", id="app.interrupt", show=False, priority=True),
        *(
            Binding(view.key, f"pane('{view.name}')", view.title, id=f"view.{view.name}", tooltip=view.what, show=False)
            for view in MONITOR_VIEWS
        ),
    ]

    def __init__(
        self,
        watch: BusWatch,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        until: Callable[[], bool] = lambda: False,
        signals: Iterable[signal.Signals] = (),
        filter_text: str = "",
    ) -> None:
        super().__init__()
        self._filter_text = filter_text
        self.bus, self.view, self.is_paused = watch, MONITOR_VIEWS[0], False
        self._clock_ns, self._until, self._signals = clock_ns, until, signals
        self._news = News(IDLE_NS)

    def compose(self) -> ComposeResult:
        """Header, views, keys."""
        yield WordLine(id="header")
        yield ViewTabs(MONITOR_VIEWS)
        with ContentSwitcher(initial=self.view.pane_id, id="panes"):
            for view in MONITOR_VIEWS:
                pane = view.make(self.bus)
                pane.id = view.pane_id
                yield pane
        yield KeysLine()

    def on_mount(self) -> None:
        """Open the bus and start the timers."""
        for number in self._signals:
            asyncio.get_running_loop().add_signal_handler(number, self.exit)
        self.query_one(FramesPane).filter(self._filter_text)
        self._pane().chosen()
        self.drain()
        self.redraw()
        self.set_interval(1.0 / DRAIN_HZ, self.drain)
        self.set_interval(1.0 / REDRAW_HZ, self.redraw_news)

    def on_unmount(self) -> None:
        """Close the bus."""
        self.bus.close()

    def drain(self) -> None:
        """Take what has arrived on the bus."""
        self.bus.poll(self._clock_ns())
        if self._until():
            self.exit()

    def redraw_news(self) -> None:
        """Draw news at once; without any, ages from time to time."""
        if self._news.is_due(self.bus.changes, self._clock_ns()):
            self.redraw()

    def redraw(self) -> None:
        """Draw one picture: the header always, the view unless it is paused."""
        if not self.screen_stack or not self.screen_stack[0].query("#header"):
            return  # a last timer tick, while the screen closes
        screen, link = self.screen_stack[0], self.bus.link
        words = [Word(self.TITLE), Word(link.where, Tone.DIM)]
        if self.is_paused:
            words.insert(1, Word("⏸ paused", Tone.WARNING))
        screen.query_one("#header", WordLine).show(tuple(words))
        screen.query_one(ViewTabs).show(self.view)
        if not self.is_paused:
            self._pane().show(Scene(_NO_RUN, now_ns=self._clock_ns()))

    def _pane(self) -> Pane:
        return self.screen_stack[0].query_one(f"#{self.view.pane_id}", Pane)

    def action_pane(self, name: str) -> None:
        """Show a view."""
        self.view = next(view for view in MONITOR_VIEWS if view.name == name)
        self.screen_stack[0].query_one(ContentSwitcher).current = self.view.pane_id
        self._pane().chosen()
        if self.is_paused:
            self._pane().show(Scene(_NO_RUN, now_ns=self._clock_ns()))
        self.redraw()

    def action_pause(self) -> None:
        """Hold the screen, or let it go on."""
        self.is_paused = not self.is_paused
        self.redraw()

    def action_help(self) -> None:
        """Show the help screen."""
        self.push_screen(HelpScreen(MONITOR_VIEWS, MONITOR_HELP, self.TITLE))

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """The commands of the palette."""
        yield SystemCommand("View: pause", "Hold the screen, or let it go on", self.action_pause)
        for view in MONITOR_VIEWS:
            yield SystemCommand(f"View: {view.title.lower()}", view.what, partial(self.action_pane, view.name))
        yield SystemCommand("View: theme", "Choose other colours", self.action_change_theme)
        yield SystemCommand("Monitor: help", "What the screen means, and its keys", self.action_help)
        yield SystemCommand("Monitor: quit", "Leave; nothing else changes", self.action_quit)


def run_monitor(watch: BusWatch, until: Callable[[], bool] = lambda: False, filter_text: str = "") -> int:
    """Show the bus, at first what fits `filter_text`, until the user quits or `until` is true; returns an exit status.

    Raises `TerminalError` without a terminal. A missing or lost bus is shown and tried again.
    """
    check_terminal("the monitor's screen")
    return run_app(MonitorApp(watch, until=until, signals=ending_signals(), filter_text=filter_text))
