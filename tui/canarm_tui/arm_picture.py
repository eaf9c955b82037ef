"""The picture of the arms as a widget: true pose over reference, the tip's trail. Draws what it is given."""

import itertools
from typing import ClassVar

import numpy as np
from rich.segment import Segment
from textual.strip import Strip

from canarm_protocol.cell.model import Cell

from . import texts
from .arm_drawing import Layer, Pose, drawing, projections
from .braille import BLANK
from .drawn import Drawn
from .kinematics import joint_places
from .styles import title_of
from .texts import Tone, Word


class ArmPicture(Drawn):
    """The arms of `cell`; `turn` goes to the next view."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"arm--blank", *(f"arm--{layer.name.lower()}" for layer in Layer)}
    DEFAULT_CSS = """
    ArmPicture { min-height: 5; margin: 0 0 0 1; }
    ArmPicture .arm--ground { color: $foreground 50%; }
    ArmPicture .arm--trail { color: $foreground 60%; }
    ArmPicture .arm--reference { color: $text-warning; }
    ArmPicture .arm--object { color: $text-success; }
    ArmPicture .arm--true { color: $text-primary; }
    """

    def __init__(self, cell: Cell) -> None:
        super().__init__(id="arm")
        self._cell, self._views, self._turned = cell, projections(cell), 0
        self._pose: Pose | None = None

    @property
    def view_name(self) -> str:
        """Of the view that is shown."""
        return self._views[self._turned].name

    def show(self, pose: Pose) -> None:
        """Show `pose`, unless it is shown."""
        before = self._pose
        if before is None or not all(
            np.array_equal(getattr(before, name), getattr(pose, name), equal_nan=True)
            for name in ("true_rad", "reference_rad", "trail_rad")
        ):
            self._pose = pose
            self.redraw()

    def turn(self) -> None:
        """The next view: from the other side, from above."""
        self._turned = (self._turned + 1) % len(self._views)
        self.redraw()

    def words(self) -> tuple[Word, ...]:
        """The title: the view, what the lines are, where the first robot's tip is."""
        words = [Word(self.view_name), Word("━ true ┄ reference", Tone.DIM)]
        if self._pose is not None and np.isfinite(self._pose.true_rad).all():
            tip = joint_places(self._cell, self._pose.true_rad[np.newaxis])[0][0, -1]
            right, up = self._views[self._turned].flat(tip)
            words.insert(1, Word(f"tip {texts.number(float(right), 3)} {texts.number(float(up), 3)} m"))
        return tuple(words)

    def draw(self, width: int, height: int) -> list[Strip]:
        """The title, and the arms below it."""
        blank = self.style_of("arm--blank")
        title = Strip(title_of(self.words(), width).render_segments(self.visual_style)).adjust_cell_length(width, blank)
        if self._pose is None or height < 2 or width < 1:
            return [title]
        bits, top = drawing(self._cell, self._views[self._turned], self._pose, height - 1, width)
        styles = [self.style_of(f"arm--{layer.name.lower()}") for layer in Layer] + [blank]  # -1 is the last one
        strips = [title]
        for row, layers in zip(bits, top, strict=True):
            text = "".join(map(chr, (BLANK + row.astype(np.int32)).tolist())).replace(chr(BLANK), " ")
            cuts = [0, *(np.flatnonzero(np.diff(layers)) + 1).tolist(), len(text)]
            parts = [Segment(text[start:end], styles[layers[start]]) for start, end in itertools.pairwise(cuts)]
            strips.append(Strip(parts, width))
        return strips
