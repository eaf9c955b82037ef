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
from .web_pages import page_server

HOST = "127.0.0.1"
DEFAULT_PORT = 8000
LARGEST_PORT = 65535

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
        server = page_server(library, text, url, title, Path(pages))
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
