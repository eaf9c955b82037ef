"""The table that draws only what is visible: columns that fit, a cursor that stays, rows that are many."""

import pytest
from textual.app import App

from canarm_tui.grid import Column, Grid
from canarm_tui.texts import Tone, Word
from tests.tui.screens import screen_lines

COLUMNS = (Column("n", 4, is_right=True), Column("name", 0), Column("wide", 6, from_width=40))


class Table(App):
    """A table of (number, name), which notes what it is asked to put into words."""

    def __init__(self, **options):
        super().__init__()
        self.asked = []
        self.chosen = []
        self.grid = Grid(COLUMNS, self.cells, lambda row: row[0], id="grid", **options)

    def compose(self):
        yield self.grid

    def cells(self, row):
        self.asked.append(row[0])
        return (Word(str(row[0])),), (Word(row[1], Tone.BAD), Word("!")), (Word("here"),)

    def on_grid_chosen(self, event):
        self.chosen.append(event.row)


def rows(count, first=0):
    return [(number, f"row {number}") for number in range(first, first + count)]


async def shown(app, pilot, given):
    app.grid.show(given)
    await pilot.pause()
    return screen_lines(app)


async def test_only_visible_rows_are_put_into_words():
    app = Table()
    async with app.run_test(size=(60, 10)) as pilot:
        await shown(app, pilot, rows(100_000))
        assert set(app.asked) <= set(range(10))
        app.asked.clear()
        await pilot.press("end")
        await pilot.pause()
        assert min(app.asked) >= 100_000 - 10


@pytest.mark.parametrize(
    ("name", "width", "line"),
    [
        ("row", 20, "    7 row!"),
        ("a name that is long", 20, "    7 a name that …"),
        # Wide characters take two columns each: what is left of one is filled.
        ("漢字漢字漢字漢字", 21, "    7 漢字漢字漢字 …"),
        ("\x1b[2J[red]", 20, "    7 \\x1b[2J[red]!"),
        ("row", 44, "    7 row!                           here"),
    ],
)
async def test_a_cell_is_as_wide_as_its_column(name, width, line):
    app = Table()
    async with app.run_test(size=(width, 5)) as pilot:
        lines = await shown(app, pilot, [(7, name)])
        assert lines[1].startswith(line[: width - 2].rstrip())


async def test_the_cursor_stays_with_its_row_and_goes_where_that_is_gone():
    app = Table()
    async with app.run_test(size=(60, 10)) as pilot:
        await shown(app, pilot, rows(20))
        await pilot.press("down", "down", "down")
        assert app.grid.chosen == (3, "row 3")
        await shown(app, pilot, rows(20, first=-5))
        assert app.grid.chosen == (3, "row 3")
        await shown(app, pilot, rows(2))
        assert app.grid.chosen == (1, "row 1")
        await shown(app, pilot, [])
        assert app.grid.chosen is None
        await pilot.press("enter", "up", "pagedown", "end")
        assert app.chosen == []


async def test_keys_page_and_choose():
    app = Table()
    async with app.run_test(size=(60, 11)) as pilot:
        await shown(app, pilot, rows(100))
        await pilot.press("pagedown", "enter", "end", "enter", "home", "enter")
        assert [number for number, _ in app.chosen] == [9, 99, 0]


async def test_an_empty_table_says_why():
    app = Table(empty="nothing fits")
    async with app.run_test(size=(60, 10)) as pilot:
        assert (await shown(app, pilot, []))[1].strip() == "nothing fits"
