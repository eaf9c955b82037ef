"""Screens as text: what a view looked like is kept in `screens/`, so that a change of it is seen in a diff.

CANARM_WRITE_SCREENS=1 writes them again. That a text is there proves nothing of its numbers; other tests do.
"""

import os
from pathlib import Path

FOLDER = Path(__file__).with_name("screens")
SIZES = [(80, 24), (120, 35), (160, 48), (200, 60)]
"""Terminals that every view is looked at in."""
MOST_LOOKS = 20


def screen_lines(app) -> list[str]:
    """The characters of the screen, line by line, without blanks at the end."""
    strips = app.screen._compositor.render_strips()
    return ["".join(segment.text for segment in strip).rstrip() for strip in strips]


def check_screen(app, name: str, part: str | None = None) -> None:
    """Compare the screen, or the lines of the widget `part` of it, with what is kept as `name`."""
    width, height = app.size
    path = FOLDER / f"{name}-{width}x{height}.txt"
    lines = screen_lines(app)
    if part is not None:
        region = app.query_one(part).region
        lines = lines[region.y : region.bottom]
    shown = "\n".join(lines) + "\n"
    if os.environ.get("CANARM_WRITE_SCREENS"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(shown, encoding="utf-8")
    assert shown == path.read_text(encoding="utf-8"), (
        f"{path.name}: see the diff; CANARM_WRITE_SCREENS=1 keeps the new one"
    )


async def at_every_size(app, pilot, name: str, part: str | None = None) -> None:
    """`check_screen` in each of `SIZES`, one after the other."""
    for size in SIZES:
        await pilot.resize_terminal(*size)
        await _settled(app, pilot)
        check_screen(app, name, part)


async def _settled(app, pilot) -> None:
    """Until it is drawn alike twice: what a size brings with it may be laid out one after the other."""
    before: list[str] = []
    for _ in range(MOST_LOOKS):
        app.redraw()
        await pilot.pause()
        lines = screen_lines(app)
        if lines == before:
            return
        before = lines
