"""What a study runs: the settings of each run, by its number. Nothing runs here, and no file is read.

Those of a grid are found from the number alone, so that a million runs take no more memory than ten.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import overload

from ..draws import Choice, Span, Value, Whole, hypercube
from ..run_lines import demo_line
from ..usage import DEFAULT_CELL, DEFAULT_LAW

Axis = Span | Choice | Whole
SET, TRUTH = "set.", "truth."
"""Beginnings of the names of axes that are keys of `--set` and `--truth`; the other names are those of `Settings`."""
NONE = "none"
"""The value of an axis of fault files that stands for no fault."""

LARGEST_WHOLE = 2**63 - 1
"""What a table's column of whole numbers holds."""


class Sample(Enum):
    """How settings are chosen from the axes."""

    GRID = "grid"
    RANDOM = "random"
    LATIN_HYPERCUBE = "latin-hypercube"


@dataclass(frozen=True, slots=True)
class Settings:
    """One run, as `canarm demo` has it; values of `settings` (`--set`) and `truth` are texts. Names are its options."""

    cell: str = DEFAULT_CELL
    law: str = DEFAULT_LAW
    trajectory: str | None = None
    feedforward: str | None = None
    seed: int = 0
    seconds: float = 10.24
    faults: str | None = None
    wire: bool = False
    settings: tuple[tuple[str, str], ...] = ()
    truth: tuple[tuple[str, str], ...] = ()

    def changed(self, values: Mapping[str, Value]) -> "Settings":
        """The run with other values, by the names of axes."""
        plain: dict[str, object] = {}
        keys = {SET: dict(self.settings), TRUTH: dict(self.truth)}
        for name, value in values.items():
            for prefix, pairs in keys.items():
                if name.startswith(prefix):
                    pairs[name.removeprefix(prefix)] = text_of(value)
                    break
            else:
                plain[name] = None if name == "faults" and value == NONE else value
        own = {each: getattr(self, each) for each in self.__dataclass_fields__}
        return Settings(**own | plain | {"settings": tuple(keys[SET].items()), "truth": tuple(keys[TRUTH].items())})

    @property
    def command(self) -> str:
        """The command line that repeats it."""
        return demo_line(**{name: getattr(self, name) for name in self.__dataclass_fields__})


@dataclass(frozen=True)
class Study(Sequence[dict[str, Value]]):
    """A study: `study[n]` has the values of run `n`, by the names of `axes`; `settings(n)` is the whole run.

    A grid takes every combination, the last axis fastest. The others take `draws` from the axes, the same ones for the
    same `draw_seed`.
    """

    title: str
    base: Settings
    axes: tuple[Axis, ...]
    steps: tuple[int, ...]
    """Of a grid, how many values each axis takes."""
    sample: Sample = Sample.GRID
    draws: int = 0
    draw_seed: int = 0
    _drawn: list[dict[str, Value]] = field(init=False, repr=False, compare=False, default_factory=list)

    def __post_init__(self) -> None:
        drawn = self._drawn
        if self.sample is Sample.RANDOM:
            sources = [(axis, random.Random(f"{self.draw_seed}/{axis.name}")) for axis in self.axes]
            drawn += [{axis.name: axis.at(chance.random()) for axis, chance in sources} for _ in range(self.draws)]
        elif self.sample is Sample.LATIN_HYPERCUBE:
            drawn += hypercube(self.axes, self.draws, self.draw_seed)

    def __len__(self) -> int:
        if self.sample is not Sample.GRID:
            return self.draws
        count = 1
        for steps in self.steps:
            count *= steps
        return count

    @overload
    def __getitem__(self, number: int) -> dict[str, Value]: ...
    @overload
    def __getitem__(self, number: slice) -> list[dict[str, Value]]: ...
    def __getitem__(self, number: int | slice) -> dict[str, Value] | list[dict[str, Value]]:
        if isinstance(number, slice):
            return [self[each] for each in range(*number.indices(len(self)))]
        if not 0 <= number < len(self):
            raise IndexError(number)
        if self.sample is not Sample.GRID:
            return self._drawn[number]
        places = []
        for steps in reversed(self.steps):
            number, place = divmod(number, steps)
            places.append(place)
        rows = zip(self.axes, reversed(places), self.steps, strict=True)
        return {axis.name: grid_value(axis, place, steps) for axis, place, steps in rows}

    def settings(self, number: int) -> Settings:
        """Run `number`, from 0."""
        return self.base.changed(self[number])


def grid_value(axis: Axis, place: int, steps: int) -> Value:
    """The value of an axis at one of the `steps` of a grid: both ends are among them."""
    if isinstance(axis, Choice):
        return axis.values[place]
    if isinstance(axis, Whole):
        return axis.low + (axis.high - axis.low) * place // max(steps - 1, 1)
    return axis.at(place / max(steps - 1, 1))


def text_of(value: Value) -> str:
    """A value as `--set` and `--truth` take it, to 9 digits."""
    return f"{value:.9g}" if isinstance(value, float) else str(value)
