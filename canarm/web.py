"""The dashboard in a browser: a server on this machine that starts `canarm tui` for every page, by textual-serve.

Loopback only, and only for pages that it has served itself: whoever reaches the page can drive the robot.
"""

import shlex
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from .libraries import load_library
from .options import Flag, whole_number
from .stopping import signals_as_before
from .usage import UsageError

HOST = "127.0.0.1"
DEFAULT_PORT = 8000
LARGEST_PORT = 65535
FONT = "fonts.googleapis.com"
"""The library's page asks for a font there; ours asks nobody outside."""
END_S = 5.0
"""How long the dashboard of a page may take to end once its page is gone; then it is killed."""

Web = Annotated[
    Flag, Parameter(help="The dashboard in a browser, on this machine only; needs: pip install 'canarm[web]'.")
]
WebPort = Annotated[
    int, Parameter(converter=whole_number, help="Where the browser finds it; 0 is any free port.", show_env_var=False)
]


def check_web() -> Any:
    """The library that serves. Raises `MissingLibraryError`."""
    return load_library("textual_serve.server", "the dashboard in a browser")


def serve_web(command: Sequence[str], port: int, title: str) -> None:
    """Serve the dashboard `canarm command …` until SIGINT or SIGTERM; says where on stderr.

    Raises `MissingLibraryError` without textual-serve, and `UsageError` if the port cannot be had.
    """
    library = check_web()
    listening = _listening(port)
    url = f"http://{HOST}:{listening.getsockname()[1]}"
    words = [sys.executable, "-P", "-m", "canarm", *command]
    # exec: what is started, and killed, is the dashboard itself and no shell around it.
    text = subprocess.list2cmdline(words) if sys.platform == "win32" else f"exec {shlex.join(words)}"
    with tempfile.TemporaryDirectory() as pages, signals_as_before():
        server = _server(library, text, url, title, Path(pages))
        print(f"canarm: the dashboard is at {url}; Ctrl-C ends it", file=sys.stderr, flush=True)
        server.run(listening)


def _listening(port: int) -> socket.socket:
    if not 0 <= port <= LARGEST_PORT:
        raise UsageError(f"--web-port {port}: must be a port, 0 to {LARGEST_PORT}")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()  # from now on who comes waits
    except OSError as error:
        listening.close()
        raise UsageError(f"--web-port {port}: {error.strerror}; name another one, or 0 for any free one") from None
    return listening


def _server(library: Any, command: str, url: str, title: str, pages: Path) -> Any:
    """The library's server, on a socket that is ours, for pages that are."""
    import asyncio
    import signal

    from aiohttp import web

    class Server(library.Server):  # type: ignore[misc]  # the library has no types
        def run(self, listening: socket.socket) -> None:
            loop = asyncio.new_event_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, self.request_exit)
            application, self.dashboards = self._make_app(), set[Any]()
            options: dict[str, Any] = {"handle_signals": False, "loop": loop, "print": None, "shutdown_timeout": END_S}
            web.run_app(application, sock=listening, **options)

        async def on_startup(self, app: web.Application) -> None:
            """Without the library's own banner."""

        async def on_shutdown(self, app: web.Application) -> None:
            """All dashboards end with the server, whether or not their pages still stand."""
            await asyncio.gather(*map(_end, self.dashboards))

        async def _process_messages(self, websocket: web.WebSocketResponse, app_service: Any) -> None:
            """Until the page is gone; the library would wait for ever for a dashboard that does not end then."""
            self.dashboards.add(app_service)
            try:
                await super()._process_messages(websocket, app_service)
            finally:
                await _end(app_service)
                self.dashboards.discard(app_service)

        async def handle_index(self, request: web.Request) -> Any:
            _refuse_strangers(request, url)
            return await super().handle_index(request)

        async def handle_websocket(self, request: web.Request) -> Any:
            _refuse_strangers(request, url)
            return await super().handle_websocket(request)

    def _refuse_strangers(request: web.Request, own: str) -> None:
        # Any page that is open in the same browser could connect here, also under a name of its own.
        if request.headers.get("Origin", own) != own or f"http://{request.headers.get('Host')}" != own:
            raise web.HTTPForbidden(text=f"only for pages of {own}")

    async def _end(dashboard: Any) -> None:
        process = dashboard._process
        try:
            async with asyncio.timeout(END_S):
                await dashboard.send_meta({"type": "quit"})
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()

    server = Server(command, HOST, 0, title, public_url=url, templates_path=pages)
    for page in (Path(library.__file__).parent / "templates").glob("*.html"):
        parts = page.read_text(encoding="utf-8").split("<link")
        kept = [parts[0], *(f"<link{part}" if FONT not in part else part.partition("/>")[2] for part in parts[1:])]
        (pages / page.name).write_text("".join(kept), encoding="utf-8")
    return server
