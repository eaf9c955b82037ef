"""What a drawn widget hands out for a frame is what textual itself makes of its rows."""

import pytest
from rich.segment import Segment
from rich.style import Style
from textual.app import App, ComposeResult
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from canarm_tui.drawn import Drawn

SIZE = (24, 8)
RED = Style.parse("red on #102030")


class _Words(Drawn):
    words = ("one", "two", "three")

    def draw(self, width: int, height: int) -> list[Strip]:
        return [Strip([Segment(word, RED)]) for word in self.words]


class _App(App[None]):
    def __init__(self, css: str, is_ansi: bool) -> None:
        super().__init__(ansi_color=is_ansi)
        self._look = css

    def compose(self) -> ComposeResult:
        words = _Words(id="words")
        words.set_styles(self._look)
        yield words


def _as_segments(strips: list[Strip]) -> list[list[tuple[str, Style | None]]]:
    """Of each row, character by character: how it is cut into segments does not matter."""
    return [[(char, each.style) for each in strip for char in each.text] for strip in strips]


@pytest.mark.parametrize("is_ansi", [False, True], ids=["truecolor", "ansi"])
@pytest.mark.parametrize("css", ["", "border: solid red;", "padding: 1 2;", "opacity: 50%;"])
async def test_rows_are_those_that_textual_makes(css: str, is_ansi: bool) -> None:
    app = _App(css, is_ansi)
    async with app.run_test(size=SIZE) as pilot:
        words = app.query_one(_Words)
        for said in (("one", "two", "three"), ("one", "2", "three"), (), ("x" * 40,), ("a",) * 20):
            words.words = said
            words.redraw()
            await pilot.pause()
            for crop in (Region(0, 0, *SIZE), Region(3, 1, 9, 4)):
                assert _as_segments(words.render_lines(crop)) == _as_segments(Widget.render_lines(words, crop))


@pytest.mark.parametrize("is_grey", [False, True])
async def test_no_color_is_heeded(is_grey: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    if is_grey:
        monkeypatch.setenv("NO_COLOR", "1")
    app = _App("", False)
    async with app.run_test(size=SIZE):
        (first, *_), *_ = app.query_one(_Words).render_lines(Region(0, 0, *SIZE))
        assert first.style is not None
        assert first.style.color is not None
        red, green, blue = first.style.color.get_truecolor()
        assert (red == green == blue) == is_grey


async def test_rows_follow_another_theme_and_size() -> None:
    app = _App("", False)
    async with app.run_test(size=SIZE) as pilot:
        words = app.query_one(_Words)
        for change in (
            lambda: setattr(app, "theme", "textual-light"),
            lambda: words.set_styles("width: 10; height: 3;"),
        ):
            change()
            await pilot.pause()
            crop = words.size.region
            assert _as_segments(words.render_lines(crop)) == _as_segments(Widget.render_lines(words, crop))
