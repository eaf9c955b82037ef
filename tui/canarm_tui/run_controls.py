"""The keys that end things, or begin them: emergency stop, leave, run again, reset. A base of the dashboard.

What is drawn, and where data come from, is not known here.
"""

from collections import deque
from collections.abc import Callable
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.widgets import Input

from canarm_protocol.errors import CanarmError

from .fault_desk import FaultDesk, Refusal
from .fault_screens import LeaveScreen, ResetScreen, StopScreen
from .feed import Feed
from .gathered import Gathered
from .link import InBackground, Link
from .outcome import Outcome, OutcomeScreen, with_cause
from .player import NoLink, Player
from .replay_controls import ReplayControls
from .run_again import Again, AgainScreen, NextRun
from .texts import Tone, Word
from .views import Context

LEFT = "the dashboard was left"
STOPPED = "stopped from the dashboard"
NO_AGAIN = "a controller is started outside: canarm controller, with the address above; a demo runs again by itself"
NOT_OVER = "there is no summary yet: no run has ended"
NOT_AT_END = "the summary comes at the end of the record"
ON_ITS_WAY = Word("… the summary is on its way: what ran is ending", Tone.WARNING)
STILL_RUNNING = "the run goes on; r runs again when it is over, and Q ends it"


class RunControls(ReplayControls):
    """`again` is who can run again, None if nobody can."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("e", "stop", "Stop!", id="bench.stop", priority=True, tooltip="Emergency stop, at once"),
        Binding("ctrl+e", "stop_anyway", "Stop!", id="bench.stop_anyway", show=False, priority=True),
        Binding("r", "again", "Again", id="run.again", tooltip="Run again when a run of canarm demo is over"),
        Binding("h", "outcome", "Summary", id="run.outcome", show=False, tooltip="How the run went, all of it"),
        Binding("w", "record", "Record", id="bench.record", show=False, tooltip="Stop recording, or go on with it"),
        Binding("R", "reset", "Reset", id="bench.reset", show=False, tooltip="Switch the robot off and on; asks first"),
        Binding("q", "quit", "Quit", id="app.quit", tooltip="Leave the dashboard; whatever runs goes on"),
        Binding("Q", "leave_and_stop", "Leave and stop", id="app.stop", show=False, tooltip="Asks first"),
        Binding("ctrl+c", "interrupt", "Quit", id="app.interrupt", show=False, priority=True),
    ]
    feed: Feed | Player
    link: Link | NoLink
    desk: FaultDesk
    context: Context
    outcome: Outcome | None
    cause = ""
    """What from outside has ended the run, if that is known."""
    is_starting = False
    """Whether another run is being started, from here."""
    left_by = LEFT
    """How the user has left, in a few words."""

    def __init__(self, again: Again | None, in_background: InBackground, clock_ns: Callable[[], int]) -> None:
        super().__init__(clock_ns)
        self._again, self._in_background = again, in_background
        self._answers: deque[Callable[[], None]] = deque()
        self._gathered = Gathered()
        self._run = 1 if again is None else again.number

    def take_answers(self) -> None:
        """Take what jobs in the background have said."""
        while self._answers:
            self._answers.popleft()()

    def follow_run(self) -> None:
        """Another run has begun, from here or from another page: it is shown from its own buses."""
        if self._again is None or self._again.number == self._run:
            return
        self._gathered.end_run(self._run, self.desk.faults, self.context.notices)
        self.desk.reconnected()
        self._run, self.outcome = self._again.number, None
        for link in (self.link, self.context.bus.link):
            link.reopen()

    def leave(self, how: str) -> None:
        """End the dashboard."""
        self.left_by = how
        self.exit()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """The letter of the emergency stop can be typed into a field."""
        if action == "stop" and isinstance(self.focused, Input):
            return False
        return super().check_action(action, parameters)

    def action_interrupt(self) -> None:
        """Leave, as Ctrl-C does everywhere, which ends a demo."""
        self.leave("Ctrl-C in the dashboard")

    def action_leave_and_stop(self) -> None:
        """Ask whether to leave and stop what runs, and do it; nothing runs where a record plays."""
        if self.player is not None:
            self.leave(LEFT)
            return
        is_demo = self._again is not None and self._again.ends_here

        def leave(is_wanted: bool | None) -> None:
            if is_wanted and is_demo:
                self.leave(STOPPED)
            elif is_wanted:
                self.desk.stop(True, left)

        def left(answer: str | Refusal) -> None:
            self.tell(answer)
            if not isinstance(answer, Refusal):
                self.leave(STOPPED)

        self.push_screen(LeaveScreen(is_demo), leave)

    def action_stop_anyway(self) -> None:
        """The emergency stop, from a text field too."""
        self.action_stop()

    def action_stop(self) -> None:
        """Open the amplifiers' supplies at once; ask before closing them again."""
        if self.feed.faults is None or not self.feed.faults.is_stopped:
            self.desk.stop(True, self.tell)
            return

        def release(is_wanted: bool | None) -> None:
            if is_wanted:
                self.desk.stop(False, self.tell)

        if not isinstance(self.screen, StopScreen):
            self.push_screen(StopScreen(), release)

    def action_outcome(self) -> None:
        """Show all of the summary of a run that is over."""
        if self.outcome is None:
            self._tell_not_over(NOT_OVER if self.player is None else NOT_AT_END)
        else:
            shown = with_cause(self.outcome, self.cause) or self.outcome
            self.push_screen(OutcomeScreen(shown, self._again is not None))

    def _tell_not_over(self, why: str) -> None:
        """That there is no outcome yet: the processes of a run go on for some seconds when it has ended."""
        has_ended = self.feed.has_ended
        answer = ON_ITS_WAY if has_ended else Refusal(why)
        self.tell(answer, lambda: self.outcome is None and self.feed.has_ended is has_ended)

    def action_record(self) -> None:
        """Stop recording, or go on with it."""
        recording = self.desk.recording
        self.desk.record(recording is None or not recording[0], self.tell)

    def action_reset(self) -> None:
        """Ask whether the robot is to be switched off and on again, and do it."""

        def reset(is_wanted: bool | None) -> None:
            if is_wanted:
                self.desk.reset(self.tell)

        self.push_screen(ResetScreen(), reset)

    def action_again(self) -> None:
        """Ask how to run again, and do it."""
        if self._again is None:
            self.tell(Refusal(NO_AGAIN))
        elif self.outcome is None:
            self._tell_not_over(STILL_RUNNING)
        else:
            self.push_screen(AgainScreen(self._again, self._start_again), self.tell)

    def _start_again(self, wanted: NextRun, then: Callable[[str | Refusal], None]) -> None:
        again = self._again
        assert again is not None

        self.is_starting = True

        def answered(answer: str | Refusal) -> None:
            self.is_starting = False
            then(answer)

        def job() -> None:
            try:
                answer: str | Refusal = again.start(wanted)
            except (CanarmError, OSError) as error:
                answer = Refusal(str(error))
            self._answers.append(lambda: answered(answer))

        self._in_background(job)
