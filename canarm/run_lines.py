"""Command lines that make a run: options in, text that a shell takes out. Whose run it is, is not known here."""

import shlex
from collections.abc import Iterable, Sequence

from .usage import DEFAULT_CELL, DEFAULT_LAW

Pairs = Iterable[tuple[str, str]]
"""Keys and values of `--set` or `--truth`."""


def demo_line(
    *,
    seconds: float,
    cell: str = DEFAULT_CELL,
    law: str = DEFAULT_LAW,
    trajectory: str | None = None,
    feedforward: str | None = None,
    seed: int = 0,
    faults: str | None = None,
    wire: bool = False,
    settings: Pairs = (),
    truth: Pairs = (),
    clock: str = "sync",
) -> str:
    """The `canarm demo` of a run; what is usual is left out."""
    words = ["canarm", "demo", "--no-tui", "--clock", clock, *(["--pace", "max"] if clock == "sync" else [])]
    words += ["--seconds", f"{seconds:.9g}"]
    own = (("--law", law, DEFAULT_LAW), ("--trajectory", trajectory, None), ("--feedforward", feedforward, None))
    return shlex.join([*words, *_options(own, cell, seed, faults, wire, settings, truth)])


def emulator_line(
    *,
    cell: str = DEFAULT_CELL,
    seed: int = 0,
    faults: str | None = None,
    wire: bool = False,
    settings: Pairs = (),
    truth: Pairs = (),
    clock: str = "sync",
) -> str:
    """The `canarm emulator` of a run, to which any master may be attached."""
    words = ["canarm", "emulator", "--clock", clock]
    return shlex.join([*words, *_options((), cell, seed, faults, wire, settings, truth)])


def _options(
    own: Sequence[tuple[str, str | None, str | None]],
    cell: str,
    seed: int,
    faults: str | None,
    wire: bool,
    settings: Pairs,
    truth: Pairs,
) -> Iterable[str]:
    for option, value, usual in (
        ("--cell", cell, DEFAULT_CELL),
        *own,
        ("--seed", str(seed), "0"),
        ("--faults", faults, None),
    ):
        if value is not None and value != usual:
            yield from (option, value)
    if wire:
        yield "--wire"
    for option, pairs in (("--set", settings), ("--truth", truth)):
        for key, text in pairs:
            yield from (option, f"{key}={text}")
