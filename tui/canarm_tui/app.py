"""The dashboard as a Textual application: timers that drain the link and draw a snapshot, keys, commands.

Only here is the wall clock read. Samples never become messages or reactives; a timer pulls one snapshot.
"""

import asyncio
import signal
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.screen import Screen
from textual.widgets import ContentSwitcher

from canarm_protocol.cell.model import Cell
from canarm_protocol.decoding import robot_book
from canarm_protocol.faults.run_plan import RunPlan
from canarm_protocol.transport.port import BusPort

from . import texts
from .bus.hand import Hand
from .bus.recorded_watch import RecordedWatch
from .bus.watch import BusWatch, robot_watch
from .ended import BenchOutcome
from .event_texts import stopped_by
from .events_view import EventsPane
from .fault_desk import FaultDesk, Refusal
from .fault_screens import Chosen, ClearScreen
from .fault_texts import panel_lines
from .faults import Faults
from .feed import Feed
from .header import header_words
from .help import HelpScreen
from .inject_screen import InjectScreen
from .joints_view import JointsPane
from .keys_line import KeysLine
from .link import InBackground, Link, in_thread
from .news import News
from .outcome import Outcome, OutcomePanel, with_cause
from .player import NoLink, Player, RecordDesk
from .record import Record
from .remembered import remember_theme, remembered_theme
from .run_again import Again
from .run_controls import RunControls
from .snapshot import Snapshot
from .themes import SAFE
from .view_registry import VIEWS
from .view_tabs import ViewTabs
from .views import Context, Pane, Scene
from .widgets import FaultPanel, WordLine

DRAIN_HZ = 40
SOURCES_HZ = 50
REDRAW_HZ = 17
IDLE_NS = 1_000_000_000
"""Without new cycles, ages and counters are drawn this often, so that watching an idle bench is cheap."""
WORDS_NS = 200_000_000
"""Nobody reads numbers that change more often."""
FIRST = VIEWS[0]
NO_RUN = "the run is over: nobody would detect a fault; r runs again"
EARLIER = "{} is over, and its traces are not kept here: canarm tui plays its folder"
AT_REST = "no run goes on: what acts at once acts on a robot at rest, until a controller comes"


class DashboardApp(RunControls):
    """The dashboard of one cell. `open_feed_port` opens the bench bus and raises `BusError` if that fails.

    `where` names the bus in the header until a port describes itself. `clock_ns` is the wall clock in ns. `on_start` is
    called once, when the first screen is up; `until` is asked at every drain, and ends the dashboard when true. Each of
    `signals` ends it too. `outcome_of` is asked as well: what it returns is how the run has ended, which is shown, and
    without it the bench is asked; `again` can run again then. `record` is a recorded run, which plays in the place of a
    live one. `bus` is that of the robot, which is opened when it is first looked at; `hand` drives its cards when it is
    asked to. What the user has chosen is remembered in the file `config`.
    """

    TITLE = "canarm"
    CSS = """
    #header { background: $panel; }
    #notice { display: none; height: auto; max-height: 3; text-wrap: wrap; background: $surface; }
    #notice.-shown { display: block; }
    #panes { height: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "inject", "Inject", id="fault.inject", tooltip="Inject a fault, chosen in a dialog"),
        Binding("x", "clear", "Clear", id="fault.clear", tooltip="End faults, all or those of one set"),
        Binding("question_mark", "help", "Help", key_display="?", id="app.help", tooltip="What the screen means"),
        Binding("space", "pause", "Pause", id="view.pause", tooltip="Hold the panes; data are still received"),
        *(
            Binding(view.key, f"pane('{view.name}')", view.title, id=f"view.{view.name}", tooltip=view.what, show=False)
            for view in VIEWS
        ),
    ]

    def __init__(
        self,
        cell: Cell,
        open_feed_port: Callable[[], BusPort],
        *,
        where: str = "bench",
        clock_ns: Callable[[], int] = time.monotonic_ns,
        in_background: InBackground = in_thread,
        on_start: Callable[[], None] | None = None,
        until: Callable[[], bool] | None = None,
        outcome_of: Callable[[], Outcome | None] | None = None,
        signals: Iterable[signal.Signals] = (),
        bus: BusWatch | None = None,
        again: Again | None = None,
        hand: Hand | None = None,
        record: Record | None = None,
        config: Path | None = None,
    ) -> None:
        super().__init__(again, in_background, clock_ns)
        self.register_theme(SAFE)
        self._config = config
        theme = None if config is None else remembered_theme(config)
        if theme in self.available_themes:
            self.theme = theme
        self.cell = cell
        if record is None:
            self.feed, self.link = Feed(cell), Link(open_feed_port, where, in_background=in_background)
            self.desk = FaultDesk(cell, self.link, in_background)
        else:
            self.feed = self.player = player = Player(record)
            self.link = no_link = NoLink(record)
            self.desk, outcome_of = RecordDesk(player, no_link, record, in_background), player.outcome
        if record is not None:
            frames = record.frames or (lambda: iter(()))
            bus = RecordedWatch(robot_book(cell), frames, lambda: player.cycle, record.where, cell.bus.bitrate)
        bus = bus or robot_watch(cell, None, in_background)
        memory, self._complaints = (None, ()) if record is None else (record.memory, record.complaints)
        self.context = Context(cell, self.feed, bus, [bus], [self.feed.notices], self.desk, hand, memory)
        self.is_paused = False
        self.view = FIRST
        """What is on the screen."""
        self._scene: Scene | None = None
        self._on_start, self._until, self._signals = on_start, until, signals
        self._outcome_of, self._ended = outcome_of, BenchOutcome(self.desk, cell.bus.cycle_s)
        self.outcome: Outcome | None = None
        """How the run has ended, once it has."""
        self._connections = 0
        self._asked_law: tuple[object, ...] = ()
        self._news = News(IDLE_NS)
        self._words_ns = 0
        self._words: tuple[object, ...] = ()

    def compose(self) -> ComposeResult:
        """Header, notice, panes, faults, counters, keys."""
        yield WordLine(id="header")
        yield WordLine(id="notice", may_wrap=True)
        yield OutcomePanel(self._again is not None)
        yield ViewTabs(VIEWS)
        with ContentSwitcher(initial=FIRST.pane_id, id="panes"):
            for view in VIEWS:
                pane = view.make(self.context)
                pane.id = view.pane_id
                yield pane
        yield FaultPanel()
        yield WordLine(id="counters")
        yield KeysLine()

    def on_load(self) -> None:
        """Signals end it from now on: the first words are on the terminal before all widgets stand."""
        for number in self._signals:
            asyncio.get_running_loop().add_signal_handler(number, self.leave, number.name)

    def on_mount(self) -> None:
        """Start the timers."""
        self.drain()
        self.redraw()
        self.set_interval(1.0 / DRAIN_HZ, self.drain)
        self.set_interval(1.0 / SOURCES_HZ, self.drain_sources)
        self.set_interval(1.0 / REDRAW_HZ, self.redraw_news)

    def on_ready(self) -> None:
        """The first screen is up."""
        if self._on_start is not None:
            self._on_start()

    def on_unmount(self) -> None:
        """Close the buses."""
        self.link.close()
        for source in self.context.sources:
            source.close()

    def drain(self) -> None:
        """Take what has arrived on the bus."""
        now_ns = self._clock_ns()
        self.follow_run()
        frames = self.link.poll(now_ns)
        if self.link.connections != self._connections:
            self._connections = self.link.connections
            self.feed.reconnected()
            self.desk.reconnected()
        self.feed.receive(frames, now_ns)
        whose_law = self.feed.is_running, self.feed.controllers, self.link.connections
        if whose_law != self._asked_law:
            self._asked_law = whose_law
            if self.feed.is_running:
                self.desk.load_law(self._take_law)
                self.desk.load_plan(self._take_plan)
        self.desk.poll(self.feed.faults, now_ns)
        self.drain_sources()
        self.take_answers()
        if self._outcome_of is None and isinstance(self.feed, Feed):
            self.outcome = self._ended.of(self.feed, self.link, self._gathered.of_bench, now_ns)
        elif self._outcome_of is not None and (self.outcome is None or self.player is not None):
            self.outcome = self._outcome_of()
        if self._until is not None and self._until():
            self.exit()

    def _take_law(self, answer: tuple[str, tuple[str, ...]] | Refusal) -> None:
        self.feed.law, self.feed.internal_names = ("", ()) if isinstance(answer, Refusal) else answer

    def _take_plan(self, answer: RunPlan | Refusal) -> None:
        self.feed.plan = None if isinstance(answer, Refusal) else answer

    def drain_sources(self) -> None:
        """Take what has arrived elsewhere, more often: the kernel keeps some 270 frames of a bus."""
        now_ns = self._clock_ns()
        for source in self.context.sources:
            source.poll(now_ns)

    def redraw_news(self) -> None:
        """Draw new data at once; without any, ages and counters every `IDLE_NS`."""
        news = (
            *(self.link.state, self.feed.changes, self.feed.faults, self.desk.faults, self.desk.refusal),
            *(self.desk.recording, self.answer, self.outcome, [source.changes for source in self.context.sources]),
        )
        if self._news.is_due(news, self._clock_ns()):
            self.redraw()

    def redraw(self) -> None:
        """Draw one snapshot: header and faults always, the panes unless they are paused."""
        if not self.screen_stack or not self.screen_stack[0].query("#header"):
            return  # a last timer tick, while the screen closes
        snapshot, screen = self.feed.snapshot(self._clock_ns()), self.screen_stack[0]
        notice = screen.query_one("#notice", WordLine)
        said = self._said.notice(texts.notice(self.link, snapshot, self.is_starting), self._clock_ns())
        if said is None and self._complaints:
            said = texts.Word(f"▲ {'; '.join(self._complaints)}", texts.Tone.WARNING)
        notice.set_class(said is not None, "-shown")
        notice.show(() if said is None else (said,))
        self._draw_words(snapshot)
        faults, cycle_s = self.desk.faults, self.cell.bus.cycle_s
        self._gathered.gather(faults, self.context.notices, self._clock_ns())
        happened = self._gathered.of_bench
        self.cause = stopped_by(happened, cycle_s)
        screen.query_one(OutcomePanel).show(with_cause(self.outcome, self.cause))
        # The view of events has them all.
        is_events = self.view.name == "events"
        lines = (
            ()
            if is_events
            else panel_lines(snapshot.faults, faults, self.desk.refusal, happened, cycle_s, snapshot.cycle)
        )
        screen.query_one(FaultPanel).show(lines)
        screen.query_one(ViewTabs).show(self.view)
        if isinstance(self.screen, InjectScreen):
            self.screen.renew_remark()
        if not self.is_paused:
            self._scene = Scene(snapshot, self._gathered.all_of_them, faults, self._clock_ns())
            self._pane().show(self._scene)

    def _draw_words(self, snapshot: Snapshot) -> None:
        """Header and counters: at once if they say something else, and if only numbers have changed, less often."""
        now_ns, width = self._clock_ns(), self.size.width - 2
        state = None if snapshot.report is None else (snapshot.report.state, snapshot.report.is_lost)
        recording = self.desk.recording
        key = (
            self.link.state,
            self.is_starting,
            self.is_paused,
            state,
            snapshot.faults,
            snapshot.replay,
            width,
            recording,
        )
        if key == self._words and 0 < now_ns - self._words_ns < WORDS_NS:
            return
        self._words, self._words_ns = key, now_ns
        words = header_words(self.link, snapshot, self.is_paused, width, self.cell, recording, self.is_starting)
        self.screen_stack[0].query_one("#header", WordLine).show(words)
        counted = texts.counter_words(snapshot.counters, self.link.discarded, width) if self.player is None else ()
        self.screen_stack[0].query_one("#counters", WordLine).show(counted)

    def _pane(self) -> Pane:
        return self.screen_stack[0].query_one(f"#{self.view.pane_id}", Pane)

    def action_pane(self, name: str) -> None:
        """Show a view. While paused, it stands still as of now."""
        self.view = next(view for view in VIEWS if view.name == name)
        self.screen_stack[0].query_one(ContentSwitcher).current = self.view.pane_id
        self._pane().chosen()
        self.drain_sources()
        if self.is_paused and self._scene is not None:
            self._pane().show(self._scene)
        self.redraw()

    def on_events_pane_jump(self, event: EventsPane.Jump) -> None:
        """Show the traces at the moment of an event."""
        if event.is_earlier:
            self.tell(Refusal(EARLIER.format(event.which)))
            return
        self.action_pane("joints")
        if not self.screen_stack[0].query_one(JointsPane).jump(event.cycle):
            which = f"cycle {event.cycle} is" if event.cycle >= 0 else "what was before cycle 0 of this run is"
            self.tell(Refusal(f"{which} not among those that are kept"))

    def action_pause(self) -> None:
        """Pause or resume the panes, or the record that plays."""
        if self.player is not None:
            self.player.toggle()
            return
        self.is_paused = not self.is_paused
        self.redraw()

    def action_help(self) -> None:
        """Show the help screen."""
        self.push_screen(HelpScreen(VIEWS))

    def action_inject(self) -> None:
        """Inject a fault, chosen in a dialog."""

        def refusal() -> str:
            return NO_RUN if self._again is not None and self.outcome is not None else ""

        if refusal():
            self.tell(Refusal(refusal()), lambda: bool(refusal()))
            return

        def remark() -> str:
            return "" if self.feed.is_running or self.player is not None else AT_REST

        self.push_screen(InjectScreen(self.desk, remark, refusal), self.tell)

    def action_clear(self) -> None:
        """Ask which faults to end, or which set to begin, and do it."""

        def clear(chosen: Chosen | None) -> None:
            if chosen is not None and chosen.is_begin and chosen.name is not None:
                self.desk.trigger(chosen.name, self.tell)
            elif chosen is not None:
                self.desk.clear(chosen.name, self.tell)

        faults = self.desk.faults or Faults()
        self.push_screen(ClearScreen(faults.set_names, faults.waiting), clear)

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """The commands of the palette, as "area: action"."""
        yield SystemCommand("View: pause", "Hold the panes, or let them go on", self.action_pause)
        for view in VIEWS:
            yield SystemCommand(f"View: {view.title.lower()}", view.what, partial(self.action_pane, view.name))
        yield SystemCommand("View: theme", "Choose other colours", self.action_change_theme)
        yield SystemCommand("View: picture", "Save the screen as an SVG file", self._save_picture)
        yield SystemCommand("Fault: inject", "Inject a fault, chosen in a dialog", self.action_inject)
        yield SystemCommand("Fault: clear", "End faults, all or those of one set", self.action_clear)
        yield SystemCommand("Run: summary", "How the run went, all of it", self.action_outcome)
        yield SystemCommand("Bench: recording", "Stop recording, or go on with it", self.action_record)
        yield SystemCommand("Bench: emergency stop", "Open all supplies at once, or close them again", self.action_stop)
        yield SystemCommand("Bench: reset", "Switch the robot off and on again", self.action_reset)
        yield SystemCommand("Run: again", "Run again, with another law, motion, seed or pace", self.action_again)
        yield SystemCommand("Dashboard: help", "What the screen means, and its keys", self.action_help)
        yield SystemCommand("Dashboard: quit", "Leave; whatever runs goes on", self.action_quit)
        yield SystemCommand("Dashboard: quit and stop", "Leave, and stop what runs", self.action_leave_and_stop)

    def _save_picture(self) -> None:
        # The palette must be gone before the picture is taken.
        self.set_timer(0.1, self._take_picture)

    def _take_picture(self) -> None:
        """Into the folder of the run, or where we are; a browser is given it."""
        if self.is_web:
            self.deliver_screenshot()
            return
        folder = Path() if self._again is None else Path(self._again.folder)
        try:
            self.tell(f"picture saved as {self.save_screenshot(path=str(folder))}")
        except OSError as error:
            self.tell(Refusal(f"picture not saved in {folder.absolute()}: {error.strerror}"))

    def watch_theme(self, theme: str) -> None:
        """Remember the theme that was chosen."""
        if self._config is not None and self.is_running:
            remember_theme(self._config, theme)
