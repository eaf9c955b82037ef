"""Reports: what they say is what was recorded, foreign texts stay texts, and a real browser draws them."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from canarm import Rig, open_run
from canarm.cli import run as canarm
from canarm.runs.record_of import record_of
from canarm.runs.report.charts import MOST_POINTS, thinned
from canarm.runs.report.figures import Figure, above
from canarm.runs.report.page import report_page
from canarm.runs.report.story import spans_of, verdict

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
MARKUP = "</script><script>document.title='owned'</script><img src=x onerror=alert(1)>\x1b[2J"
GESTURE = """<script>
const chart = document.querySelector("[data-chart] svg"), box = chart.getBoundingClientRect();
const place = (share) => ({ clientX: box.left + box.width * share, bubbles: true });
const at = (type, share) => chart.dispatchEvent(new PointerEvent(type, place(share)));
const labels = () => [...chart.querySelectorAll('text[text-anchor="middle"]:not(.number)')];
const ends = () => labels().map((each) => Number(each.textContent));
const seen = [ends()];
at("pointerdown", 0.4); at("pointermove", 0.5); at("pointerup", 0.6); seen.push(ends());
chart.dispatchEvent(new MouseEvent("dblclick")); seen.push(ends());
document.documentElement.dataset.seen = JSON.stringify(seen);
</script></body>"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs: `mras` with a fault that is noticed, and `pd`, which errs more."""
    folder = tmp_path_factory.mktemp("reported")
    with Rig(law="mras", seed=3, out=folder / "mras") as rig:
        rig.inject("joint2.tachometer", "stuck", at=1.0, duration=0.5)
        rig.run(3.0)
    with Rig(law="pd", seed=3, out=folder / "pd") as rig:
        rig.run(3.0)
    return folder


class Page(HTMLParser):
    """Tags, attributes and texts of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs


def charts_in(page: str) -> list[dict[str, object]]:
    found = re.search(r'<script id="charts" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return list(json.loads(found.group(1)))


def test_a_fault_after_the_end_of_a_run_is_not_called_missed(recorded: Path, tmp_path: Path) -> None:
    """As when somebody breaks something on a bench whose controller has gone."""
    folder = shutil.copytree(recorded / "pd", tmp_path / "pd")
    event = {"source": "controller", "event": "state", "cycle": 1200, "time_s": 3.0, "state": "DONE"}
    broken = {"set": "late", "tap": "joint2.motor", "fault": "winding-open", "cycle": 1202, "power_on_s": 3.2}
    begins = {"source": "emulator", "event": "fault-begins", "time_s": 3.1, **broken}
    with (folder / "events.jsonl").open("a") as file:
        file.writelines(json.dumps(each) + "\n" for each in (event, begins))
    _, lines = verdict(open_run(folder))
    assert "when the run was over: no controller was there to detect it." in lines[-1]
    assert "the run was over" in report_page([open_run(folder)])


def test_a_gap_in_the_record_is_said(recorded: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(recorded / "pd", tmp_path / "pd")
    off = {"source": "emulator", "event": "recording", "cycle": 400, "time_s": 1.0, "state": "off", "power_on_s": 1.1}
    with (folder / "events.jsonl").open("a") as file:
        for each in (off, {**off, "state": "on", "time_s": 1.5}, {**off, "time_s": 2.0}):
            file.write(json.dumps(each) + "\n")
    _, lines = verdict(open_run(folder))
    assert "Frames and true signals were not recorded from 1.0000 s to 1.5000 s." in lines
    assert "Frames and true signals were not recorded from 2.0000 s on." in lines


def test_the_verdict_comes_first_and_says_what_the_rig_knew(recorded: Path) -> None:
    run = open_run(recorded / "mras")
    is_good, lines = verdict(run)
    assert is_good
    assert lines[0] == "The run ended as planned after 1200 cycles."
    assert lines[1].startswith("joint2 followed its reference within ")
    (span,) = spans_of(run)
    (seen, *_) = [each for each in run.event_list if each["event"] == "detection"]
    assert span.latency_ms == pytest.approx((seen["time_s"] - 1.0) * 1e3)
    assert f"joint2.tachometer stuck began at 1.0000 s and was noticed after {span.latency_ms:.1f} ms" in lines[-1]
    page = report_page([run])
    assert page.index(lines[0]) < page.index("Figures") < page.index("Over time") < page.index("canarm replay")


def test_a_detection_after_the_emergency_stop_is_its_doing_and_no_faults(recorded: Path, tmp_path: Path) -> None:
    shutil.copytree(recorded / "mras", tmp_path / "run")
    events = tmp_path / "run" / "events.jsonl"
    lines = events.read_text().splitlines()
    (first, *_) = [json.loads(line) for line in lines if '"detection"' in line]
    # As an emulator writes it: pressed after the fault has begun at 1 s, in the very cycle of the first detection.
    pressed = {"time_s": first["time_s"], "cycle": first["cycle"], "source": "emulator", "event": "emergency-stop"}
    added = [json.dumps({**pressed, "state": "on"}), json.dumps({**pressed, "time_s": 2.9, "state": "off"})]
    events.write_text("\n".join([*lines, *added]) + "\n")
    run = open_run(tmp_path / "run")
    fault, stop = spans_of(run)
    assert (fault.what, fault.noticed) == ("joint2.tachometer stuck", None)
    assert (stop.what, stop.end_s) == ("emergency stop", 2.9)
    assert run.reason is None, "it has ended as planned all the same"
    said = f"The emergency stop was pressed at {first['time_s']:.4f} s and was noticed after 0.0 ms by "
    assert any(line.startswith(said) for line in verdict(run)[1])
    released, on = record_of(run).faults.stops
    assert (on.is_on, on.cycle, released.is_on) == (True, first["cycle"], False), "the dashboard plays it too"
    document = json.loads((tmp_path / "run" / "run.json").read_text())
    document["summary"] |= {"state": "failed", "reason": "current-mismatch: joint2"}
    (tmp_path / "run" / "run.json").write_text(json.dumps(document))
    failed = open_run(tmp_path / "run")
    assert failed.reason == f"after the emergency stop at {first['time_s']:.3f} s: current-mismatch: joint2"
    assert failed.reason in verdict(failed)[1][0]
    assert failed.reason in failed.headline
    # Without the fault's own events, the stop is the cause.
    events.write_text("\n".join([line for line in lines if '"fault-' not in line] + added) + "\n")
    assert not any("though no fault was injected" in line for line in verdict(open_run(tmp_path / "run"))[1])


def test_the_curves_are_those_of_the_files(recorded: Path) -> None:
    run = open_run(recorded / "mras")
    charts = {str(chart["title"]): chart for chart in charts_in(report_page([run]))}
    angle = charts["joint2: angle, degrees"]
    true = next(each for each in angle["series"] if each["name"] == "true")
    assert true["y"] == pytest.approx(np.degrees(run.columns["joint2.true_angle_rad"]), rel=1e-5, abs=1e-5)
    assert true["x"] == pytest.approx(run.columns["time_s"])
    (band,) = angle["bands"]
    assert band[:2] == pytest.approx([1.0, 1.5])
    limits = [each["y"][0] for each in charts["joint2: current, A"]["series"] if each["name"].startswith("limit")]
    assert limits == [1.5, -1.5]  # of the D669 (cell konkuk1)
    assert "joint2: alpha of the law" in charts


def test_the_tip_is_where_two_links_of_180_mm_put_it(recorded: Path) -> None:
    """The paper's arm: a2 = a3 = 180 mm in the vertical plane."""
    run = open_run(recorded / "mras")
    charts = {str(chart["title"]): chart for chart in charts_in(report_page([run]))}
    places = {each["name"]: each["y"] for each in charts["konkuk1: place of its tip, m"]["series"]}
    known = np.isfinite(run.columns["joint2.reference_rad"])  # not through the stop
    for suffix, column in (("", "true_angle_rad"), (", reference", "reference_rad")):
        first, second = (run.columns[f"{joint}.{column}"][known] for joint in ("joint2", "joint3"))
        x, y = (np.array(places[f"{axis}{suffix}"], dtype=float)[known] for axis in "xy")
        np.testing.assert_allclose(x, 0.18 * (np.cos(first) + np.cos(first + second)), atol=1e-6)
        np.testing.assert_allclose(y, 0.18 * (np.sin(first) + np.sin(first + second)), atol=1e-6)
    assert set(places) == {"x", "x, reference", "y", "y, reference"}, "it never leaves the plane"
    (distance,) = charts["konkuk1: its tip from where it should be, mm"]["series"]
    last = int(np.flatnonzero(known)[-1])
    off = [places[axis][last] - places[f"{axis}, reference"][last] for axis in "xy"]
    assert distance["y"][last] == pytest.approx(1e3 * np.linalg.norm(off), abs=2e-3)


@pytest.mark.slow
def test_every_chart_becomes_an_svg_and_a_png_and_the_same_ones_each_time(recorded: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    page = charts_in(report_page([open_run(recorded / "mras")]))
    words = ["report", str(recorded / "mras"), "--out", str(tmp_path / "page.html"), "--figures"]
    for name in ("one", "two"):
        assert canarm([*words, str(tmp_path / name)]) == 0
    one, two = (sorted((tmp_path / name).iterdir()) for name in ("one", "two"))
    assert len(one) == 2 * len(page)
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
    pictures = [path for path in one if path.suffix == ".svg"]
    for path, chart in zip(pictures, page, strict=True):
        root = ElementTree.parse(path).getroot()
        texts = {"".join(each.itertext()) for each in root.iter("{http://www.w3.org/2000/svg}text")}
        assert str(chart["title"]) in texts
        assert {str(each["name"]) for each in chart["series"]} <= texts
        assert path.with_suffix(".png").read_bytes().startswith(b"\x89PNG\r\n")


def test_no_spike_is_lost_in_a_long_run() -> None:
    values = np.zeros(1_000_000)
    values[123_457], values[777_777] = 5.0, -7.0
    times, thin = thinned(np.arange(1e6), values)
    assert len(thin) <= MOST_POINTS
    assert (thin.max(), thin.min()) == (5.0, -7.0)
    assert abs(times[int(np.argmax(thin))] - 123_457) < 1e6 / MOST_POINTS * 2


def test_runs_are_compared_with_the_first(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mras, pd = str(recorded / "mras"), str(recorded / "pd")
    out = tmp_path / "compared.html"
    assert canarm(["report", mras, pd, "--out", str(out), "--fail-above", "rms_lsb=1.5"]) == 1
    rms = [open_run(path).summary["joints"]["joint2"]["rms_lsb"] for path in (mras, pd)]
    told = capsys.readouterr().out
    assert f"joint2.rms_lsb of pd: {rms[1] / rms[0]:.4g} times that of mras, above 1.5" in told
    assert f"{rms[1] / rms[0]:.4g} (above 1.5)" in out.read_text()
    assert canarm(["report", pd, mras, "--out", str(out), "--fail-above", "rms_lsb=1.5"]) == 0
    assert canarm(["report", mras, mras, "--out", str(out), "--fail-above", "joint2.rms_lsb=1"]) == 0
    assert canarm(["report", mras, pd, "--out", str(out), "--fail-above", "speed=1"]) == 2
    assert "the runs have no such figure; there are joint2.rms_lsb" in capsys.readouterr().err
    assert canarm(["report", mras, "--fail-above", "rms_lsb=1"]) == 2
    assert canarm(["report", mras, pd, "--fail-above", "rms_lsb=nan"]) == 2
    assert canarm(["report", mras, pd, "--fail-above", "rms_lsb=1e400"]) == 2
    assert canarm(["report"]) == 2


@pytest.mark.parametrize(
    ("values", "is_above"),
    [
        ((1.0, 1.1), False),
        ((1.0, 1.3), True),
        ((0.0, 0.0), False),
        ((0.0, 0.1), True),
        ((1.0, None), True),
        ((None, 1.0), False),
    ],
)
def test_a_figure_is_beyond_its_limit(values: tuple[float | None, ...], is_above: bool) -> None:
    assert bool(above([Figure("joint2.rms_lsb", values)], {"rms_lsb": 1.2})) is is_above


def test_foreign_texts_stay_texts(recorded: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(recorded / "mras", tmp_path / "</title><b>"))
    document = json.loads((folder / "run.json").read_text())
    document["summary"] |= {"reason": MARKUP, "cell": MARKUP, "state": "failed", "starved": MARKUP}
    document["summary"]["joints"][MARKUP] = {MARKUP: 1.0, "rms_lsb": 1, "max_lsb": 2}
    document["rig"]["law"] = MARKUP
    document["pacing"] = {"jitter": {"histogram": {"from_us": [1, MARKUP, 1e400], "count": [2, 3, 4]}}, "law": MARKUP}
    document[MARKUP] = MARKUP
    (folder / "run.json").write_text(json.dumps(document))
    events = [
        {"time_s": 0.5, "event": MARKUP, MARKUP: MARKUP},
        {
            "time_s": 0.5,
            "cycle": 1,
            "power_on_s": 0.5,
            "event": "fault-begins",
            "set": MARKUP,
            "tap": "a",
            "fault": "b",
        },
    ]
    with (folder / "events.jsonl").open("a") as file:
        file.writelines(json.dumps(each) + "\n" for each in events)
    header, rest = (folder / "signals" / "robot.csv").read_text().split("\n", 1)
    header = header.replace("joint2.", f"joint2{MARKUP.replace(chr(27), '')}.").replace(",", ",")
    (folder / "signals" / "robot.csv").write_text(f"{header}\n{rest}")
    plain, page = Page(report_page([open_run(recorded / "mras")])), Page(text := report_page([open_run(folder)]))
    assert set(page.tags) <= set(plain.tags)
    assert page.tags.count("script") == 2
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert "\x1b" not in text
    assert "owned" in text, "it is shown"


def test_a_report_needs_nothing_else(recorded: Path) -> None:
    text = report_page([open_run(recorded / "mras")])
    page = Page(text)
    assert not {"link", "img", "iframe", "object", "embed", "base"} & set(page.tags)
    assert not [name for name, _ in page.attributes if name in ("src", "href", "action")]
    assert set(re.findall(r"https?://[^\s\"'`)]+", text)) == {"http://www.w3.org/2000/svg"}, "a name, no address"
    assert "default-src 'none'" in text


@pytest.mark.parametrize("left", ["run.json", "can0.log", "signals"])
def test_of_half_a_run_there_is_half_a_report(recorded: Path, tmp_path: Path, left: str) -> None:
    folder = Path(shutil.copytree(recorded / "mras", tmp_path / "run"))
    for path in list(folder.iterdir()):
        if path.name != left:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    page = report_page([open_run(folder)])
    assert "verdict" in page
    assert len(charts_in(page)) > 4 if left == "signals" else not charts_in(page)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_real_browser_draws_every_chart_and_zooms(recorded: Path, tmp_path: Path) -> None:
    for name, runs in (("one", ["mras"]), ("two", ["mras", "pd"])):
        page = report_page([open_run(recorded / each) for each in runs])
        path = tmp_path / f"{name}.html"
        path.write_text(page.replace("</body>", GESTURE))
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        log = ["--enable-logging=stderr", f"--user-data-dir={tmp_path / ('profile-' + name)}", "--dump-dom"]
        done = subprocess.run(
            [str(CHROMIUM), *flags, *log, path.as_uri()], capture_output=True, text=True, timeout=200, check=True
        )
        assert "CONSOLE" not in done.stderr, done.stderr
        charts = charts_in(page)
        assert f'data-drawn="{len(charts)}"' in done.stdout
        assert done.stdout.count('<path class="line') == sum(len(chart["series"]) for chart in charts)
        seen = re.search(r'data-seen="([^"]*)"', done.stdout)
        assert seen is not None
        whole, zoomed, again = json.loads(seen.group(1).replace("&quot;", '"'))
        # 40 % to 60 % of the picture, whose margins are 64 and 12 of 900, of 3 s.
        low_s, high_s = ((900 * share - 64) / (900 - 64 - 12) * 3.0 for share in (0.4, 0.6))
        assert low_s <= min(zoomed) < max(zoomed) <= high_s
        assert max(zoomed) - min(zoomed) > 0.6 * (high_s - low_s)
        assert whole == again
        assert (min(whole), max(whole)) == (0.0, 3.0)
