"""What a rig, its joints and a run say of themselves at a prompt and in a notebook."""

import base64
import json
import re
import shutil
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import pytest

from canarm import Rig, open_run
from canarm.runs.report.story import verdict

MARKUP = "<script>alert(1)</script>\x1b[2J"


class Tags(HTMLParser):
    """The tags of a display."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.add(tag)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("displays") / "run"
    with Rig(out=folder) as rig:
        rig.inject("joint2.tachometer", "stuck", at=0.2)
        rig.run(0.5)
    return folder


def picture_in(shown: str) -> str:
    (data,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', shown)
    return base64.b64decode(data).decode()


def test_a_joint_at_a_prompt_says_what_it_is() -> None:
    with Rig() as rig:
        rig.run(0.25)
        joint = rig.joints["joint2"]
        said = f"<joint joint2: 100 cycles kept, no error counts yet, peak current {joint.peak_current_a:.3g} A>"
        assert repr(joint) == said
        rig.run(2.5)
        assert f"error {joint.rms_error_lsb:.3g} LSB RMS, {joint.max_error_lsb:.3g} at most" in repr(joint)


def test_a_carried_object_at_a_prompt_says_who_holds_it() -> None:
    with Rig("rhino-pair") as rig:
        assert repr(rig.object) == "<carried object: not known before the first cycle>"
        rig.run(0.05)
        x, y, z = rig.object.state.position_m
        assert f"held by both hands, master's grip at {x:.3f}, {y:.3f}, {z:.3f} m>" in repr(rig.object)


def test_a_rig_in_a_notebook_shows_figures_faults_and_its_figure() -> None:
    with Rig() as rig:
        assert "0 cycles kept" in rig._repr_html_(), "before it has run, too"
        rig.inject("joint2.tachometer", "stuck", at=1.0)
        rig.run(1.2)
        shown = rig._repr_html_()
        assert picture_in(shown) == rig.plot()
        assert f"<td>{rig.joints['joint2'].peak_current_a:.4g}</td>" in shown
        assert "fault: joint2.tachometer stuck at 1.0000 s" in shown
        assert f"detected: {rig.noticed[0].text}" in shown


def test_a_run_in_a_notebook_shows_its_end_figures_faults_and_its_figure(recorded: Path) -> None:
    run = open_run(recorded)
    shown = run._repr_html_()
    assert "done, 200 cycles" in shown or "failed, " in shown
    assert f"<td>{run.summary['joints']['joint2']['peak_current_a']:.4g}</td>" in shown
    assert picture_in(shown) == run.plot()
    lines = verdict(run)[1]
    assert any("joint2.tachometer stuck began at 0.2000 s" in line for line in lines)
    assert all(f"<div>{escape(line)}</div>" in shown for line in lines)


def test_a_hostile_run_writes_nothing_but_text_into_a_notebook(recorded: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(recorded, tmp_path / "<b>run"))
    document = json.loads((folder / "run.json").read_text())
    document["summary"] |= {"reason": MARKUP, "cell": MARKUP, "joints": {MARKUP: {"rms_lsb": MARKUP}, "a": 7}}
    (folder / "run.json").write_text(json.dumps(document))
    with (folder / "events.jsonl").open("a") as file:
        begins = {"set": MARKUP, "tap": MARKUP, "fault": MARKUP, "cycle": 1, "power_on_s": 0.1}
        file.write(json.dumps({"time_s": 0.1, "source": "emulator", "event": "fault-begins", **begins}) + "\n")
    shown = open_run(folder)._repr_html_()
    assert Tags(shown).found <= {"div", "b", "table", "thead", "tbody", "tr", "th", "td", "img"}
    assert "\x1b" not in shown
    assert "&lt;script&gt;" in shown


@pytest.mark.parametrize("left", ["run.json", "can0.log", "signals"])
def test_of_half_a_run_there_is_half_a_display(recorded: Path, tmp_path: Path, left: str) -> None:
    folder = Path(shutil.copytree(recorded, tmp_path / "run"))
    for path in list(folder.iterdir()):
        if path.name != left:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert f"Run {folder}" in open_run(folder)._repr_html_()
