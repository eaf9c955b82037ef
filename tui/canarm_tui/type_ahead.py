"""One key after the other: the next one waits until the last has had its whole effect, and an opened dialog stands.

A key that no field takes is asked of the focused widget and all above it before it is a binding's: one typed behind it
would meet the screen as it was before, where its letter may mean something else. What keys mean is not known here.
"""

from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any

from textual.app import App
from textual.dom import DOMNode
from textual.events import Key

from .dialog import EndsOnce

AT_ONCE = ("ctrl+e", "ctrl+c")
"""Wait for nothing: the emergency stop that is no letter, and leaving."""
PASSES = 3
"""Messages go up from widget to widget, each in turn: first the key, then what its binding has posted (a field that was
submitted), then what a screen has put off (fields that take the place of others)."""
PATIENCE_S = 0.5
"""A widget that is taken away takes with it what waits in it: no key waits for longer."""


class TypeAhead:
    """Keys of `app` that wait; `forward` is what the app does with one."""

    def __init__(self, app: App[Any], forward: Callable[[Key], Awaitable[None]]) -> None:
        self._app, self._forward = app, forward
        self._held: deque[Key] = deque()
        self._given: Key | None = None
        self._dialog: EndsOnce[Any] | None = None
        """What the keys wait for."""

    @property
    def is_busy(self) -> bool:
        """Whether a key has not had its whole effect yet."""
        return self._given is not None

    async def take(self, key: Key) -> None:
        """A key was pressed."""
        if key.key in AT_ONCE:
            await self._forward(key)
            return
        if self._given is not None and key.time - self._given.time > PATIENCE_S:
            self._given = None
        if self._given is None and (key.key == "escape" or self._dialog not in (None, self._app.screen)):
            self._held.clear()
        self._held.append(key)
        await self._go_on()

    async def _go_on(self) -> None:
        while self._held and self._given is None and self._app.screen_stack:
            screen = self._app.screen
            if isinstance(screen, EndsOnce) and screen.holds(self._held[0].key):
                self._dialog = screen
                screen.when_it_takes_keys = lambda: self._app.call_later(self._go_on)
                return
            self._dialog = None
            self._given = key = self._held.popleft()
            widget: DOMNode = self._app.focused or screen
            await self._forward(key)
            self._follow(widget, key, PASSES)

    def _follow(self, widget: DOMNode, key: Key, passes: int) -> None:
        """Go up from `widget` behind the messages that do, to the app and through its own queue."""
        node: Any = widget
        while node is not self._app:
            above = node.parent or self._app
            if node.call_later(self._follow, above, key, passes):
                return
            node = above
        self._app.call_later(self._at_the_top, key, passes)

    async def _at_the_top(self, key: Key, passes: int) -> None:
        if self._given is not key:
            return
        if passes > 1 and self._app.screen_stack:
            self._follow(self._app.focused or self._app.screen, key, passes - 1)
            return
        self._given = None
        await self._go_on()
