"""A word on the command line that stands where none belongs: the option whose value it must be.

The file is looked into only where its name does not tell.
"""

from collections.abc import Collection, Iterable
from pathlib import Path

from canarm_protocol.cell.cell_file import shipped_cells
from canarm_protocol.shown import printable
from canarm_protocol.text_file import read_text

OPTIONS = {".toml": "--cell", ".csv": "--trajectory", ".py": "--law", ".urdf": "--urdf", ".xml": "--urdf"}
FAULT_SET = "[[set"
LARGEST_BYTES = 1_000_000


def hint(words: Iterable[str], known: Collection[str]) -> str:
    """A question such as "Did you mean --cell my.toml?", for the first word that is the value of a `known` option."""
    for word in words:
        option = _option_of(word)
        if option in known:
            return f" Did you mean {option} {printable(word)}?"
    return ""


def _option_of(word: str) -> str | None:
    """The option that takes a file of such a name, with `:CLASS` or `:samples` behind it, or a shipped cell."""
    if word in shipped_cells():
        return "--cell"
    for name in (word, word.rpartition(":")[0]):
        option = OPTIONS.get(Path(name).suffix.lower())
        if option is not None:
            return "--faults" if option == "--cell" and _is_of_faults(Path(name)) else option
    return None


def _is_of_faults(path: Path) -> bool:
    try:
        return FAULT_SET in read_text(path, LARGEST_BYTES, "a file")
    except (OSError, ValueError):
        return False
