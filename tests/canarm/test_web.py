"""The dashboard in a browser: a real server, a real emulator and, where Chromium is installed, a real browser."""

import asyncio
import base64
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from canarm_protocol.cell import load_cell
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.transport.port import open_port
from tests.canarm.browser import PROGRAMS, Page, find_browser, started

aiohttp = pytest.importorskip("aiohttp", reason="textual-serve is not installed")
pytest.importorskip("textual_serve", reason="textual-serve is not installed")


def first_match(stream, pattern: str) -> str:
    for line in stream:
        if found := re.search(pattern, line):
            return found[1]
    raise AssertionError(f"ended without {pattern}")


@pytest.fixture(scope="module")
def emulator_port(tmp_path_factory) -> Iterator[int]:
    command = [sys.executable, "-m", "canarm", "emulator", "--clock", "sync", "--serve", "127.0.0.1:0"]
    folder = tmp_path_factory.mktemp("emulator")
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        yield int(first_match(run.stdout, r"port=(\d+)"))
        run.terminate()


@pytest.fixture(scope="module")
def url(emulator_port: int, tmp_path_factory) -> Iterator[str]:
    """Where `canarm tui --web` serves, without a terminal."""
    command = [sys.executable, "-m", "canarm", "tui", "--web", "--web-port", "0"]
    command += ["--connect", f"127.0.0.1:{emulator_port}"]
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=tmp_path_factory.mktemp("web"), **streams) as run:
        yield first_match(run.stderr, r"the dashboard is at (http://\S+);")
        run.send_signal(signal.SIGINT)
        assert run.wait(60) == 0


@contextmanager
def bench_at(port: int) -> Iterator[BenchClient]:
    with open_port("canarm", "bench", port=port) as bus, BenchClient(bus, load_cell("konkuk1")) as bench:
        yield bench


def text_of(page: Page) -> str:
    """What the dashboard has written to the page's terminal."""
    frames = (each["params"]["response"] for each in page.seen if each["method"] == "Network.webSocketFrameReceived")
    return b"".join(base64.b64decode(each["payloadData"]) for each in frames if each["opcode"] == 2).decode()


async def shows(page: Page, text: str) -> None:
    """Wait until the dashboard has written `text`."""
    async with asyncio.timeout(60.0):
        while text not in text_of(page):
            await page.evaluate("0")


def test_the_page_asks_nobody_outside_and_strangers_are_refused(url: str) -> None:
    async def look() -> None:
        async with aiohttp.ClientSession() as session:
            async with session.get(url) as answer:
                page = await answer.text()
            assert answer.status == 200
            assert set(re.findall(r'(?:src|href)="(\w+://[^/"]+)', page)) == {url}
            for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
                for path in ("/", "/ws"):
                    async with session.get(url + path, headers=headers) as answer:
                        assert answer.status == 403, (path, headers)

    assert url.startswith("http://127.0.0.1:")
    asyncio.run(look())


@pytest.mark.skipif(find_browser() is None, reason=f"none of {', '.join(PROGRAMS)} is installed: no test in a browser")
def test_a_fault_is_injected_and_the_robot_stopped_from_a_browser(url: str, emulator_port: int, tmp_path: Path) -> None:
    """By keys, and by a click: what happens is asked of the emulator, over the bus."""

    async def drive() -> None:
        with started(find_browser(), tmp_path / "profile") as tools:
            async with aiohttp.ClientSession() as session, session.ws_connect(tools, max_msg_size=0) as socket:
                page = await Page.opened(socket, url)
                await page.call("Emulation.setFocusEmulationEnabled", enabled=True)
                await shows(page, "connected")
                await page.click(100, 100)
                await page.press("f")
                await shows(page, "where?")
                await page.press(*"2 tacho")
                await shows(page, "2 tacho")
                await page.press("Enter")
                await shows(page, "which fault?")
                await page.press(*"stuck")
                await shows(page, "stuck ")
                await page.press("Enter")
                await shows(page, "enter injects")
                await page.press("Enter")
                await shows(page, "accepted")
                with bench_at(emulator_port) as bench:
                    assert [each["tap"] for each in bench.status()["active"]] == ["joint2.tachometer"]
                    assert not bench.is_stopped
                made = await page.wait_for(lambda each: each["method"] == "Network.webSocketCreated")
                columns, rows = map(int, re.findall(r"(?:width|height)=(\d+)", made["params"]["url"]))
                box = "document.querySelector('.xterm-screen').getBoundingClientRect()"
                width, height = [await page.evaluate(f"{box}.{each}") for each in ("width", "height")]
                row, column = re.findall(r"\x1b\[(\d+);(\d+)H(?:\x1b\[[\d;]*m| e )+Stop!", text_of(page))[-1]
                await page.click((int(column) + 0.5) * width / columns, (int(row) - 0.5) * height / rows)
                await shows(page, "EMERGENCY STOP")
                with bench_at(emulator_port) as bench:
                    assert bench.is_stopped

    asyncio.run(drive())
