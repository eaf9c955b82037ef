"""A real browser without a window, driven over the DevTools protocol of Debian's Chromium. Nothing is downloaded."""

import asyncio
import base64
import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
LIMIT_S = 60.0


def find_browser() -> str | None:
    """The first of `PROGRAMS` that is installed."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@contextmanager
def started(program: str, profile: Path) -> Iterator[str]:
    """The address of the DevTools of a browser that ends afterwards."""
    command = [program, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--window-size=1200,800"]
    command += [f"--user-data-dir={profile}", "--remote-debugging-port=0", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            for line in process.stderr:
                found = re.search(r"DevTools listening on (ws://\S+)", line)
                if found:
                    yield found[1]
                    break
            else:
                raise AssertionError("the browser has ended without DevTools")
        finally:
            process.kill()


class Page:
    """A page: `call` is a command of the DevTools protocol, `seen` what the page has said since."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._number, self._session = socket, 0, ""
        self.seen: list[dict[str, Any]] = []

    @classmethod
    async def opened(cls, socket: aiohttp.ClientWebSocketResponse, url: str) -> "Page":
        page = cls(socket)
        target = await page.call("Target.createTarget", url="about:blank")
        attached = await page.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        page._session = attached["sessionId"]
        await page.call("Network.enable")
        await page.call("Page.navigate", url=url)
        return page

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        await self._socket.send_json(message)
        while True:
            answer = await self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    async def wait_for(self, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first message of the page that fits."""
        for each in self.seen:
            if fits(each):
                return each
        async with asyncio.timeout(LIMIT_S):
            while not fits(answer := await self._next()):
                pass
        return answer

    async def heard(self) -> None:
        """Wait for the next message of the page."""
        await self._next()

    async def press(self, *keys: str) -> None:
        for key in keys:
            text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
            code = {"windowsVirtualKeyCode": 13} if key == "Enter" else {}
            await self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **text, **code)
            await self.call("Input.dispatchKeyEvent", type="keyUp", key=key, **code)

    async def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            await self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    async def evaluate(self, expression: str) -> Any:
        found = await self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        return found["result"].get("value")

    async def picture(self) -> bytes:
        found = await self.call("Page.captureScreenshot")
        return base64.b64decode(found["data"])

    async def _next(self) -> dict[str, Any]:
        async with asyncio.timeout(LIMIT_S):
            message = dict(json.loads((await self._socket.receive()).data))
        if "id" not in message:
            self.seen.append(message)
        return message
