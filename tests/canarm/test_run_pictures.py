"""The figure of a run as a file, of whatever numbers; its tables as DataFrames with integer cycles."""

import shutil
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canarm import Rig, open_run
from canarm.cli import run as canarm_here
from canarm.usage import UsageError

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose stop goes on after the last controlled cycle."""
    folder = tmp_path_factory.mktemp("pictures") / "run"
    with Rig(law="pd", seed=3, out=folder) as rig:
        rig.run(0.5)
    return folder


@pytest.fixture
def copy(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "run"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", ["1e308", "-1e308", "1.7e308", "1e16", "nan", "inf", "-inf"])
@pytest.mark.parametrize("every", [7, 1], ids=["some", "all"])
def test_numbers_that_no_robot_has_are_left_out_of_the_figure_without_a_word(
    copy: Path, value: str, every: int, capfd: pytest.CaptureFixture[str]
) -> None:
    for table in ("robot", "controller"):
        path = copy / "signals" / f"{table}.csv"
        head, *rows = path.read_text().splitlines()
        for place in range(0, len(rows), every):
            cycle, time_s, *values = rows[place].split(",")
            rows[place] = ",".join((cycle, time_s, *("-" * (place % 2 and value[0] != "-") + value for _ in values)))
        path.write_text("\n".join((head, *rows)) + "\n")
    picture = ET.fromstring(open_run(copy).plot())
    numbers = [line.get("points", "") for line in picture.iter(f"{SVG}polyline")]
    if every > 1:
        assert len(numbers) == 2 * (3 + 1 + 2)
        assert all(numbers), "all others are drawn"
    else:
        assert not any(numbers)
    assert capfd.readouterr().err == ""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("time_s", ["1e308", "inf", "nan"])
def test_a_time_that_no_run_has_takes_its_row_alone_out_of_the_figure(copy: Path, time_s: str) -> None:
    path = copy / "signals" / "robot.csv"
    head, *rows = path.read_text().splitlines()
    place = head.split(",").index("power_on_s")
    values = rows[50].split(",")
    rows[50] = ",".join((*values[:place], time_s, *values[place + 1 :]))
    path.write_text("\n".join((head, *rows)) + "\n")
    lines = [each.get("points", "").split() for each in ET.fromstring(open_run(copy).plot()).iter(f"{SVG}polyline")]
    assert len(lines[0]) == len(rows) - 1
    assert len({point.split(",")[0] for point in lines[0]}) > 100, "not all at one end of the axis"


def test_a_long_curve_keeps_its_spikes_beside_what_is_no_number() -> None:
    from canarm.rig.run_plot import _thinned

    values = np.sin(np.arange(5000.0))
    values[10], values[11] = np.nan, 50.0
    _, drawn = _thinned(np.arange(5000.0), values)
    assert np.nanmax(drawn) == 50.0
    assert not np.isnan(drawn).any()


def test_a_figure_is_saved_as_svg_and_png(recorded: Path, tmp_path: Path) -> None:
    picture = open_run(recorded).plot("50 $ of _it")
    svg = picture.save(tmp_path / "run.svg")
    assert svg.read_text(encoding="utf-8") == str(picture)
    pytest.importorskip("matplotlib")
    png = picture.save(str(tmp_path / "run.PNG"))
    data = png.read_bytes()
    # PNG specification, 5.2 and 11.2.2: the signature, and width and height in the first chunk.
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert width == 1350
    assert height > width, "six panels, one below the other"


def test_a_rigs_figure_with_faults_is_saved_too(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    with Rig(seed=1) as rig:
        rig.inject("joint2.tachometer", "stuck", at=0.1)
        rig.run(0.3)
        assert rig.plot().save(tmp_path / "rig.png").stat().st_size > 20_000


@pytest.mark.parametrize("path", ["run.pdf", "run", 5, None])
def test_what_no_figure_can_be_saved_as_is_said(path: Any) -> None:
    with Rig() as rig:
        rig.run(0.01)
        with pytest.raises(UsageError, match=r"must be the path of a file that ends in \.svg or \.png"):
            rig.plot().save(path)


def test_on_a_full_disk_a_figure_names_its_file_and_leaves_none(
    recorded: Path,
    tmp_path: Path,
    full_at: Callable[[int], AbstractContextManager[None]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    picture = open_run(recorded).plot()
    with full_at(1000), pytest.raises(OSError, match=r"run\.svg"):
        picture.save(tmp_path / "run.svg")
    pytest.importorskip("matplotlib.backends.backend_svg")  # its compiled file is not to be cut off on the full disk
    (tmp_path / "report.html").touch()
    from canarm.runs.report.figures_drawn import draw_figures
    from canarm.runs.report.page import charts_in_page

    with full_at(1000), pytest.raises(OSError, match=r"figures/01-.*\.svg"):
        draw_figures(charts_in_page([open_run(recorded)]), tmp_path / "figures")
    assert list((tmp_path / "figures").iterdir()) == []
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["report.html"]
    with full_at(0):
        assert canarm_here(["report", str(recorded), "--out", str(tmp_path / "page.html")]) != 0
    assert f"{tmp_path / 'page.html'}: " in capsys.readouterr().err


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_cycles_are_integers_in_every_table(recorded: Path, library: str) -> None:
    pytest.importorskip(library)
    run = open_run(recorded, library)
    for table in (run.signals, run.events):
        assert str(table["cycle"].dtype).lower() == "int64"
    assert list(run.signals["cycle"][:3]) == [0, 1, 2]
    with Rig(law="pd") as rig:
        rig.run(0.02)
        assert str(rig.to_dataframe(library)["cycle"].dtype).lower() == "int64"


def test_a_cycle_that_is_no_whole_number_stays_what_it_is(copy: Path) -> None:
    pytest.importorskip("pandas")
    path = copy / "signals" / "robot.csv"
    path.write_text(path.read_text().replace("\n5,", "\n5.5,", 1))
    assert 5.5 in open_run(copy).signals["cycle"].tolist()
