"""The parts of a log that has gone on in new files: NAME-0001 is the first, and NAME itself, if it is there, the last.

What stands in them is not known here.
"""

from pathlib import Path

LONGEST_PART = 9
"""Digits in the number of a part; at least four are written."""


def part_of(path: Path, number: int) -> Path:
    """The part of a log, from 1 on."""
    return path.with_name(f"{path.stem}-{number:04d}{path.suffix}")


def parts_of(path: Path, *others: str) -> list[Path]:
    """The parts of a log in their order, and the log itself. A part may have one of the suffixes `others` instead."""
    found: dict[int, Path] = {}
    for suffix in (path.suffix, *reversed(others)):
        for each in path.parent.glob(f"{path.stem}-[0-9][0-9][0-9][0-9]*{suffix}"):
            number = each.name[len(path.stem) + 1 : -len(suffix)]
            if number.isascii() and number.isdigit() and len(number) <= LONGEST_PART:
                found[int(number)] = each
    return [*(found[number] for number in sorted(found)), path]


def has_parts(table: Path) -> bool:
    """Whether there is a table of signals, or a part of one in any format."""
    return table.exists() or any(table.parent.glob(f"{table.stem}-[0-9][0-9][0-9][0-9]*"))
