"""What the dashboard remembers: the theme, in a file that may be anything; and pictures, in the folder of the run."""

import json

import pytest

from canarm_tui import DashboardApp
from canarm_tui.remembered import config_file, remembered_theme


def app_with(cell, port, clock, config, **options):
    return DashboardApp(cell, lambda: port, clock_ns=clock, in_background=lambda job: job(), config=config, **options)


async def test_a_theme_is_remembered_from_one_time_to_the_next(cell, port, clock, tmp_path):
    config = tmp_path / "deeper" / "dashboard.json"
    app = app_with(cell, port, clock, config)
    async with app.run_test(size=(80, 24)) as pilot:
        app.theme = "okabe-ito"
        await pilot.pause()
    assert json.loads(config.read_text()) == {"theme": "okabe-ito"}
    async with app_with(cell, port, clock, config).run_test(size=(80, 24)) as pilot:
        assert pilot.app.theme == "okabe-ito"


@pytest.mark.parametrize("text", ["", "[]", '{"theme": 7}', '{"theme": "no such theme"}', "[" * 50_000, "x" * 100_000])
async def test_a_file_that_is_no_memory_changes_nothing(cell, port, clock, tmp_path, text):
    config = tmp_path / "dashboard.json"
    config.write_text(text)
    async with app_with(cell, port, clock, config).run_test(size=(80, 24)) as pilot:
        assert pilot.app.theme == DashboardApp(cell, lambda: port).theme


def test_the_file_is_where_the_system_keeps_such_files(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert config_file().name == "dashboard.json"
    assert remembered_theme(config_file().with_name("none")) is None


async def test_a_picture_goes_to_the_folder_where_one_is_and_says_so(cell, port, clock, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    app = app_with(cell, port, clock, None)
    async with app.run_test(size=(80, 24)) as pilot:
        app._take_picture()
        await pilot.pause()
        (picture,) = tmp_path.glob("*.svg")
        assert "<svg" in picture.read_text()
        assert picture.name in app.answer.text
