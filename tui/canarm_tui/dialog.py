"""What every dialog has: it ends once, however often it is told to, and what comes for it after that is dropped.

Keys and answers may still wait for a dialog that has ended, while its widgets are taken away one after the other.
"""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from textual.await_complete import AwaitComplete
from textual.screen import ModalScreen, Screen, ScreenResultType

T = TypeVar("T")


class EndsOnce(Screen[ScreenResultType]):
    """A screen that ends once."""

    _is_over = False
    _is_up = False
    _late: Callable[[], object] | None = None
    when_it_takes_keys: Callable[[], object] | None = None
    """Called when keys need not wait any more."""

    @property
    def is_there(self) -> bool:
        """Whether its widgets can be asked and shown something."""
        return not self._is_over and self.is_attached and self.app.is_running

    def holds(self, key: str) -> bool:
        """Whether `key` has to wait until there is something that it can be typed into."""
        return not self._is_up and not self._is_over

    def while_open(self, take: Callable[[T], None]) -> Callable[[T], None]:
        """`take`, for an answer that may come when nobody waits for it any more."""

        def take_if_open(answer: T) -> None:
            if self.is_there:
                take(answer)

        return take_if_open

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Keys that still come do nothing."""
        return False if self._is_over else super().check_action(action, parameters)

    def dismiss(self, result: ScreenResultType | None = None) -> AwaitComplete:
        """End with `result`; beneath another screen, when that one has ended. Nothing if it has ended before."""
        stack = self.app.screen_stack
        if self._is_over or self not in stack:
            return AwaitComplete()
        self._is_over = True
        if stack[-1] is self:
            return super().dismiss(result)
        self._late = partial(super().dismiss, result)
        return AwaitComplete()

    def on_screen_resume(self) -> None:
        """It is on top, with its widgets: at first, and when the screen above has ended."""
        if not self._is_up:
            self.call_later(self._stand)
        if self._late is not None:
            late, self._late = self._late, None
            late()

    def _stand(self) -> None:
        self._is_up = True
        self.take_keys()

    def take_keys(self) -> None:
        """Those that wait need not any more."""
        then, self.when_it_takes_keys = self.when_it_takes_keys, None
        if then is not None:
            then()


# The styles are those of the first base alone.
class Dialog(ModalScreen[ScreenResultType], EndsOnce[ScreenResultType]):
    """A screen above the others, which ends once with a result. What it shows stands in a box of the class `dialog`."""

    DEFAULT_CSS = """
    Dialog { align: center middle; }
    Dialog .dialog {
        max-width: 100%; height: auto; max-height: 100%; border: round $primary; padding: 0 1; background: $surface;
    }
    """
