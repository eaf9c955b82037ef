"""The keys that play a recorded run. A base of the dashboard; without a player none of them is there."""

from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.events import Key
from textual.screen import ModalScreen

from .answers import AnsweringApp
from .fault_desk import Refusal
from .player import NOBODY, Player

ACTIONS = ("skip", "faster", "event")
LIVE_ACTIONS = ("inject", "clear", "stop", "stop_anyway", "reset", "again", "record")
LIVE_KEYS = ("f", "x", "e", "ctrl+e", "R", "r", "w", "t", "j")
"""Those of what only a live run can do, where no view has taken them for something else."""
NO_FURTHER, NONE_BEFORE = "there is no further event; N goes to the one before", "there is no event before; n goes on"


class ReplayControls(AnsweringApp):
    """`player` is None unless a recorded run is shown."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("n", "event(False)", "Next event", id="replay.next", tooltip="Go to the next event of the run"),
        Binding("N", "event(True)", "Event before", id="replay.before", show=False),
        Binding("left_square_bracket", "skip(-1)", "Back", key_display="[", id="replay.back", tooltip="5 s back"),
        Binding("right_square_bracket", "skip(1)", "On", key_display="]", id="replay.on", tooltip="5 s on"),
        Binding("comma", "faster(-1)", "Slower", id="replay.slower", show=False),
        Binding("full_stop", "faster(1)", "Faster", id="replay.faster", show=False),
    ]
    player: Player | None = None

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Some only with a player, and those that would do something to a bench only without."""
        if action in (*ACTIONS, *LIVE_ACTIONS) and (action in ACTIONS) is (self.player is None):
            return False
        return super().check_action(action, parameters)

    def action_skip(self, steps: int) -> None:
        """Some seconds on, or back."""
        self._playing().skip(steps)

    def action_faster(self, steps: int) -> None:
        """Another speed."""
        self._playing().faster(steps)

    def action_event(self, is_back: bool) -> None:
        """To the next event, or the one before."""
        if not self._playing().next_event(is_back):
            self.tell(Refusal(NONE_BEFORE if is_back else NO_FURTHER))

    def on_key(self, event: Key) -> None:
        """A key that nobody has taken: of a live run's it is said why it does nothing."""
        if self.player is not None and event.key in LIVE_KEYS and not isinstance(self.screen, ModalScreen):
            self.tell(Refusal(NOBODY))

    def _playing(self) -> Player:
        assert self.player is not None
        return self.player
