"""The server of the dashboard's pages: textual-serve's, on a socket that is ours, for pages that are.

What a page sends is judged here: anything on this machine can connect. What is served belongs to `web`.
"""

import asyncio
import contextlib
import logging
import signal
import socket
import sys
from pathlib import Path
from typing import Any

from canarm_protocol.shown import named_error

FONT = "fonts.googleapis.com"
"""The library's page asks for a font there; ours asks nobody outside."""
ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><rect width="16" height="16" rx="3" fill="#1e293b"/>'
    '<path d="M3 13 6 6l6-2" fill="none" stroke="#38bdf8" stroke-width="2"/></svg>'
)
"""An arm of two links."""
END_S = 5.0
"""How long the dashboard of a page may take to end once its page is gone; then it is killed."""
LIBRARY, NOT_STARTED = "textual-serve", "Application failed to start"
"""The library's logger, and what it says of every dashboard that ends before it has drawn anything."""
USUAL_SIZE = 80, 24
MOST_COLUMNS, MOST_ROWS = 1000, 400
"""Of a page: beyond that no screen is legible, and a dashboard holds all of its cells in memory."""


def sane_size(columns: object, rows: object) -> tuple[int, int]:
    """The size of a page in characters, within what a dashboard can draw. Raises `ValueError` for what is no size."""
    if type(columns) is not int or type(rows) is not int:
        raise ValueError("not a size in columns and rows")
    return min(max(columns, 1), MOST_COLUMNS), min(max(rows, 1), MOST_ROWS)


def first_size(query: Any) -> tuple[int, int]:
    """The size that the address of a page names; the usual one if it names none."""
    try:
        return sane_size(int(query["width"]), int(query["height"]))
    except (KeyError, ValueError):
        return USUAL_SIZE


async def take_message(dashboard: Any, page: Any, words: object) -> None:
    """Do what a page has sent. Raises `ValueError` for what no page sends; what is unknown is nothing."""
    match words:
        case ["stdin", str(typed)]:
            await dashboard.send_bytes(typed.encode())
        case ["resize", {"width": columns, "height": rows}]:
            await dashboard.set_terminal_size(*sane_size(columns, rows))
        case ["ping", data]:
            await page.send_json(["pong", data])
        case ["blur"] | ["blur", _]:
            await dashboard.blur()
        case ["focus"] | ["focus", _]:
            await dashboard.focus()
        case _:
            raise ValueError("not a message of a page")


def page_server(library: Any, command: str, url: str, title: str, pages: Path) -> Any:
    """A server that starts the shell's `command` for each page of `url`; `pages` is a folder for their templates.

    `library` is textual-serve's module of its server.
    """
    from aiohttp import WSMsgType, web

    class Dashboard(library.AppService):  # type: ignore[misc]  # the library has no types
        """The dashboard of a page. One that ends before it has drawn anything is told here, and not by the library."""

        has_started = is_ended = False

        async def run(self) -> None:
            try:
                await super().run()
            except asyncio.CancelledError:
                # Where the process is over at once, the library cancels its reader of stderr before that has begun.
                task = asyncio.current_task()
                if task is None or task.cancelling():
                    raise
            if not self.has_started and not self.is_ended:
                _say("the dashboard of a page did not start")
                await self.remote_close()

        async def on_data(self, payload: bytes) -> None:
            self.has_started = True
            await super().on_data(payload)

        async def on_meta(self, data: bytes) -> None:
            self.has_started = True
            await super().on_meta(data)

    class Server(library.Server):  # type: ignore[misc]  # the library has no types
        def run(self, listening: socket.socket) -> None:
            loop = asyncio.new_event_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, self.request_exit)
            application, self.dashboards = self._make_app(), set[Any]()
            options: dict[str, Any] = {"handle_signals": False, "loop": loop, "print": None, "shutdown_timeout": END_S}
            web.run_app(application, sock=listening, **options)

        async def _make_app(self) -> web.Application:
            application: web.Application = await super()._make_app()
            application.router.add_get("/favicon.ico", self._icon)
            return application

        async def _icon(self, request: web.Request) -> web.Response:
            """Browsers ask for one, and complain on their console where there is none."""
            return web.Response(text=ICON, content_type="image/svg+xml")

        async def on_startup(self, app: web.Application) -> None:
            """Without the library's own banner."""

        async def on_shutdown(self, app: web.Application) -> None:
            """All dashboards end with the server, whether or not their pages still stand."""
            await asyncio.gather(*map(_end, self.dashboards))

        async def handle_index(self, request: web.Request) -> Any:
            _refuse_strangers(request, url)
            return await super().handle_index(request)

        async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
            """A page, until it is gone, and its dashboard, which ends with it."""
            _refuse_strangers(request, url)
            page = web.WebSocketResponse(heartbeat=15)
            await page.prepare(request)
            dashboard = Dashboard(
                self.command,
                write_bytes=page.send_bytes,
                write_str=page.send_str,
                close=page.close,
                download_manager=self.download_manager,
            )
            self.dashboards.add(dashboard)
            try:
                await dashboard.start(*first_size(request.query))
                await self._process_messages(page, dashboard)
            except (OSError, RuntimeError) as error:  # the page, or its dashboard, is gone
                _say(f"a page: {named_error(error)}")
            finally:
                await _end(dashboard)
                self.dashboards.discard(dashboard)
                with contextlib.suppress(OSError, RuntimeError):
                    await dashboard.stop()
            return page

        async def _process_messages(self, websocket: web.WebSocketResponse, app_service: Any) -> None:
            is_told = False
            async for message in websocket:
                if message.type is not WSMsgType.TEXT:
                    continue
                try:
                    await take_message(app_service, websocket, message.json())
                except (ValueError, RecursionError) as error:
                    if not is_told:
                        _say(f"a page sends what no page of ours does ({named_error(error)}); it is dropped")
                    is_told = True

    def _refuse_strangers(request: web.Request, own: str) -> None:
        # Any page that is open in the same browser could connect here, also under a name of its own.
        if request.headers.get("Origin", own) != own or f"http://{request.headers.get('Host')}" != own:
            raise web.HTTPForbidden(text=f"only for pages of {own}")

    logging.getLogger(LIBRARY).addFilter(_is_no_news)
    server = Server(command, "127.0.0.1", 0, title, public_url=url, templates_path=pages)
    for page in (Path(library.__file__).parent / "templates").glob("*.html"):
        parts = page.read_text(encoding="utf-8").split("<link")
        kept = [parts[0], *(f"<link{part}" if FONT not in part else part.partition("/>")[2] for part in parts[1:])]
        (pages / page.name).write_text("".join(kept), encoding="utf-8")
    return server


def _is_no_news(record: logging.LogRecord) -> bool:
    """Whether the library's log says what is said here: a page that is left early is no error of its dashboard."""
    return record.getMessage() != NOT_STARTED


async def _end(dashboard: Any) -> None:
    dashboard.is_ended, process = True, dashboard._process
    if process is None:
        return
    try:
        async with asyncio.timeout(END_S):
            await dashboard.send_meta({"type": "quit"})
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()


def _say(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr, flush=True)
