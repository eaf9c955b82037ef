"""The dashboard in a browser: a real server, a real emulator and, where Chromium is installed, a real browser."""

import asyncio
import base64
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from canarm import web_pages
from canarm.web_pages import MOST_COLUMNS, MOST_ROWS, first_size, sane_size
from canarm_protocol.cell import load_cell
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.transport.port import open_port
from tests.canarm.browser import PROGRAMS, Page, find_browser, started
from tests.canarm.conftest import DEADLINE_S, Commands, wait_until

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


class Terminal:
    """What the dashboard has written to the terminal of a page."""

    def __init__(self, page: Page) -> None:
        self._page, self._read, self._data = page, 0, b""

    @property
    def text(self) -> str:
        news, self._read = self._page.seen[self._read :], len(self._page.seen)
        for each in news:
            if each["method"] == "Network.webSocketFrameReceived" and each["params"]["response"]["opcode"] == 2:
                self._data += base64.b64decode(each["params"]["response"]["payloadData"])
        return self._data.decode(errors="replace")

    async def shows(self, text: str) -> None:
        """Wait until `text` has been written."""
        async with asyncio.timeout(240.0):
            while text not in self.text:
                await self._page.heard()

    async def type(self, text: str) -> None:
        """Letter by letter: textual may put keys that come faster than a hand types them into another order."""
        for end in range(1, len(text) + 1):
            await self._page.press(text[end - 1])
            await self.shows(text[:end])


def test_the_page_asks_nobody_outside_and_strangers_are_refused(url: str) -> None:
    async def look() -> None:
        async with aiohttp.ClientSession() as session:
            async with session.get(url) as answer:
                page = await answer.text()
            assert answer.status == 200
            async with session.get(f"{url}/favicon.ico") as answer:
                assert (answer.status, answer.content_type) == (200, "image/svg+xml"), "nothing on the page's console"
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
                terminal = Terminal(page)
                await page.call("Emulation.setFocusEmulationEnabled", enabled=True)
                await terminal.shows("connected")
                await page.click(100, 100)
                await page.press("f")
                await terminal.shows("where?")
                await terminal.type("2 tacho")
                await page.press("Enter")
                await terminal.shows("which fault?")
                await terminal.type("stuck")
                await page.press("Enter")
                await terminal.shows("enter injects")
                await page.press("Enter")
                await terminal.shows("accepted")
                with bench_at(emulator_port) as bench:
                    assert [each["tap"] for each in bench.status()["active"]] == ["joint2.tachometer"]
                    assert not bench.is_stopped
                made = await page.wait_for(lambda each: each["method"] == "Network.webSocketCreated")
                columns, rows = map(int, re.findall(r"(?:width|height)=(\d+)", made["params"]["url"]))
                box = "document.querySelector('.xterm-screen').getBoundingClientRect()"
                width, height = [await page.evaluate(f"{box}.{each}") for each in ("width", "height")]
                row, column = re.findall(r"\x1b\[(\d+);(\d+)H(?:\x1b\[[\d;]*m| e )+Stop!", terminal.text)[-1]
                await page.click((int(column) + 0.5) * width / columns, (int(row) - 0.5) * height / rows)
                await terminal.shows("EMERGENCY STOP")
                with bench_at(emulator_port) as bench:
                    assert bench.is_stopped

    asyncio.run(drive())


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGKILL])
def test_no_dashboard_outlives_its_page_or_the_server(canarm: Commands, number: signal.Signals) -> None:
    """A page goes away at once; the dashboard of another one does not react any more; a third stays to the end."""
    server = canarm("tui", "--web", "--web-port", "0", "--connect", "127.0.0.1:9")

    def has_none() -> bool:
        return canarm.remaining() == [server.pid]

    address = server.wait_for(r"the dashboard is at (http://\S+);")[1]

    async def look() -> None:
        async with aiohttp.ClientSession() as session:
            async with session.ws_connect(f"{address}/ws"):
                pass
            await asyncio.to_thread(wait_until, has_none, "end of the dashboard of a page that is gone")
            async with session.ws_connect(f"{address}/ws") as page:
                await page.receive()
                for each in set(canarm.remaining()) - {server.pid}:
                    os.kill(each, signal.SIGSTOP)
            await asyncio.to_thread(wait_until, has_none, "end of the dashboard of a page that is gone")
            async with session.ws_connect(f"{address}/ws") as page:
                server.send(number)
                async for _ in page:
                    pass

    asyncio.run(look())
    server.wait()
    wait_until(lambda: not canarm.remaining(), "end of all dashboards")
    assert "failed to start" not in server.complaint, "a page that is left early is no error"


@pytest.mark.parametrize(("words", "said"), [("false", ["the dashboard of a page did not start"]), ("sleep 60", [])])
def test_a_dashboard_that_ends_before_it_has_drawn_is_told_unless_its_page_was_left(
    words: str, said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import textual_serve.server
    from aiohttp.web import AppRunner, SockSite

    told: list[str] = []
    monkeypatch.setattr(web_pages, "_say", told.append)
    monkeypatch.setattr(web_pages, "END_S", 0.01)
    listening = socket.create_server(("127.0.0.1", 0))
    url = f"http://127.0.0.1:{listening.getsockname()[1]}"

    async def look() -> None:
        server = web_pages.page_server(textual_serve.server, f"exec {words}", url, "", tmp_path)
        server.dashboards = set()
        runner = AppRunner(await server._make_app())
        await runner.setup()
        await SockSite(runner, listening).start()
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{url}/ws") as page:
            if said:
                assert (await page.receive()).type is aiohttp.WSMsgType.CLOSE, "at once"
        await runner.cleanup()

    asyncio.run(look())
    assert told == said
    assert not caplog.records


def test_a_dashboard_ends_when_its_server_hangs_up() -> None:
    """Whatever becomes of what it writes."""
    command = [sys.executable, "-m", "canarm", "tui", "--connect", "127.0.0.1:9"]
    environment = {**os.environ, "TEXTUAL_DRIVER": "textual.drivers.web_driver:WebDriver"}
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env=environment, **streams) as dashboard:
        try:
            dashboard.stdin.close()
            assert dashboard.wait(DEADLINE_S) is not None
        finally:
            dashboard.kill()


@pytest.mark.slow
def test_what_no_page_sends_is_told_in_a_line_and_no_size_is_too_large(canarm: Commands) -> None:
    """Without limit, one page of 100000 columns and rows would take all memory."""
    server = canarm("tui", "--web", "--web-port", "0", "--connect", "127.0.0.1:9")
    address = server.wait_for(r"the dashboard is at (http://\S+);")[1]
    garbage = ["", "{", "[]", "7", '["stdin"]', '["stdin", 7]', '["stdin", "\\ud800"]', '["resize", {"width": "wide"}]']
    garbage += ['["resize", {"width": 1e9, "height": null}]', "[" * 100_000, '["resize", {"width": true, "height": 3}]']
    garbage += ['["resize", {"width": 100000, "height": 100000}]', '["resize", {"width": -5, "height": 0}]']

    async def look() -> None:
        where = f"{address}/ws?width=100000&height=100000"
        async with (
            asyncio.timeout(2 * DEADLINE_S),
            aiohttp.ClientSession() as session,
            session.ws_connect(where) as page,
        ):
            await page.receive()
            for each in garbage:
                await page.send_str(each)
            await page.send_str('["resize", {"width": 120, "height": 40}]')
            await page.send_str('["stdin", "?"]')
            drawn = b""
            while b"Help" not in drawn:
                drawn += (await page.receive()).data

    asyncio.run(look())
    server.send(signal.SIGINT)
    assert server.wait() == 0
    complaints = [line for line in server.complaint.splitlines() if "no page of ours" in line]
    assert len(complaints) == 1


def test_a_size_of_a_page_is_a_number_of_columns_and_rows() -> None:
    assert sane_size(120, 40) == (120, 40)
    assert sane_size(100_000, 100_000) == (MOST_COLUMNS, MOST_ROWS)
    assert sane_size(-5, 0) == (1, 1)
    assert first_size({"width": "9" * 5000, "height": "40"}) == (80, 24)
    for wrong in (("80", 24), (True, 24), (80.5, 24), (None, 24)):
        with pytest.raises(ValueError, match="size"):
            sane_size(*wrong)


@pytest.mark.slow
def test_a_page_that_is_opened_after_a_demo_shows_how_it_has_ended(canarm: Commands) -> None:
    demo = canarm("demo", "--web", "--web-port", "0", "--seconds", "0.5", "--pace", "max", "--out", "recorded-here")
    address = demo.wait_for(r"the dashboard is at (http://\S+);")[1]
    verdict = demo.wait_for(r"the run is over: (.*); Ctrl-C")[1]

    async def look() -> None:
        drawn = b""
        async with (
            asyncio.timeout(DEADLINE_S),
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{address}/ws?width=120&height=40") as page,
        ):
            while verdict.encode() not in drawn or b"recorded-here" not in drawn:
                drawn += await page.receive_bytes()

    asyncio.run(look())
    demo.send(signal.SIGINT)
    assert demo.wait() == 0
    assert demo.stdout[0] == verdict


@pytest.mark.slow
def test_a_run_of_a_demo_is_run_again_from_a_page_and_other_pages_follow(canarm: Commands, tmp_path: Path) -> None:
    demo = canarm("demo", "--web", "--web-port", "0", "--seconds", "0.5", "--pace", "max", "--out", "runs")
    address = demo.wait_for(r"the dashboard is at (http://\S+);")[1]
    demo.wait_for(r"the run is over: .* konkuk1")

    async def press(page: aiohttp.ClientWebSocketResponse, keys: str) -> None:
        await page.send_str(json.dumps(["stdin", keys]))

    async def drawn(page: aiohttp.ClientWebSocketResponse, text: str) -> None:
        found = b""
        while text.encode() not in found:
            found += (await page.receive()).data

    async def look() -> None:
        where = f"{address}/ws?width=160&height=48"
        async with (
            asyncio.timeout(2 * DEADLINE_S),
            aiohttp.ClientSession() as session,
            session.ws_connect(where) as page,
            session.ws_connect(where) as other,
        ):
            for each in (page, other):
                await drawn(each, "r runs again")
            await press(page, "r")
            await drawn(page, "enter runs")
            await press(page, "\r")
            await drawn(page, "running again")
            for each in (page, other):
                await drawn(each, "run-2")

    asyncio.run(look())
    demo.wait_for(r"running again: .* recorded in runs/run-2")
    wait_until(lambda: sum("the run is over" in line for line in demo.stderr) == 2, "end of the second run")
    demo.send(signal.SIGINT)
    assert demo.wait() == 0
    assert sum("konkuk1" in line for line in demo.stdout) == 2
    assert json.loads((tmp_path / "runs" / "run-2" / "run.json").read_text())["summary"]["state"] == "done"
