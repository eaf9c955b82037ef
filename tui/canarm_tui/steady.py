"""An application that outlives quick keys in its palette, and ends without a traceback on the terminal.

What is on its screens is not known here.
"""

import gc
from collections.abc import Coroutine
from typing import Any

from textual.app import App
from textual.command import Command, CommandList, CommandPalette
from textual.events import Event, InputEvent, Key, Mount
from textual.theme import ThemeProvider
from textual.worker import Worker, WorkerFailed

from .dialog import EndsOnce
from .type_ahead import TypeAhead

GARBAGE = (20_000, 10, 10)
"""Thresholds of collections. Drawing leaves thousands of objects a second, most of them garbage with the next frame:
few are older by the time they are looked through, and need not be again with all that is old."""


class Palette(CommandPalette, EndsOnce[None]):
    """Textual's palette goes on looking for commands after it was closed, for a list that is not there any more."""

    def _on_mount(self, event: Mount) -> None:
        if self._is_over:
            event.prevent_default()

    def _gather_commands(self, search_value: str) -> Worker[None] | None:  # type: ignore[override]
        return super()._gather_commands(search_value) if self.is_there else None

    def _refresh_command_list(self, command_list: CommandList, commands: list[Command], clear_current: bool) -> None:
        if self.is_there:
            super()._refresh_command_list(command_list, commands, clear_current)

    def _start_no_matches_countdown(self, search_value: str) -> None:
        if self.is_there:
            super()._start_no_matches_countdown(search_value)

    def _watch__list_visible(self) -> None:
        if self.is_there:
            super()._watch__list_visible()

    def _watch__show_busy(self) -> Coroutine[Any, Any, None] | None:  # type: ignore[override]
        return super()._watch__show_busy() if self.is_there else None

    def dismiss(self, result: None = None) -> Any:
        """Close, and stop looking for commands."""
        self.workers.cancel_node(self)
        self._stop_no_matches_countdown()
        self._stop_busy_countdown()
        return super().dismiss(result)


class SteadyApp(App[None]):
    """Keeps the error that has ended it for `run_app`."""

    escaped: BaseException | None = None
    """What has ended it, if that was an error."""
    has_process: bool = False
    """Whether it is all that its process does."""
    has_settled: bool = False
    """Whether it has set aside what stands."""

    def __init__(self) -> None:
        super().__init__()
        self.type_ahead = TypeAhead(self, super().on_event)

    def on_ready(self) -> None:
        """What stands now stands to the end: to look through it for garbage would hold up keys for 0.2 s each time."""
        if self.has_process:
            gc.collect()
            gc.freeze()
            gc.set_threshold(*GARBAGE)
            self.has_settled = True

    async def on_event(self, event: Event) -> None:
        """Keys wait for each other; they may still come when the last screen has gone."""
        if not isinstance(event, InputEvent):
            await super().on_event(event)
        elif self.screen_stack and isinstance(event, Key) and not event.is_forwarded:
            await self.type_ahead.take(event)
        elif self.screen_stack:
            await super().on_event(event)

    def action_command_palette(self) -> None:
        """Open the palette."""
        if self.use_command_palette and not isinstance(self.screen, CommandPalette):
            self.push_screen(Palette(id="--command-palette"))

    def search_themes(self) -> None:
        """Open the palette of themes."""
        self.push_screen(Palette(providers=[ThemeProvider], placeholder="Search for themes…"))

    def _handle_exception(self, error: Exception) -> None:
        if self.escaped is None:
            self.escaped = error.error if isinstance(error, WorkerFailed) else error
        super()._handle_exception(error)
        self._exit_renderables.clear()

    def _fatal_error(self) -> None:
        # Textual's own would draw a traceback with the values of all variables.
        self._close_messages_no_wait()
