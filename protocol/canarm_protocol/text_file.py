"""Reading text files that a user names: bounded, and regular files only, so that no path can fill memory or hang.

What the text means, and who is told of what is wrong, is the caller's.
"""

import stat
from pathlib import Path


def read_text(path: Path, largest_bytes: int, kind: str) -> str:
    """The text of the regular file `path` in UTF-8, with or without a byte order mark.

    `kind` says in errors what it was taken for, such as "a cell". Raises `OSError` where it cannot be read, and
    `ValueError`, with what is wrong in a few words, where it is no such file, too large or no text.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError(f"is no regular file; {kind} is a TOML file")
    with path.open("rb") as file:
        data = file.read(largest_bytes + 1)
    if len(data) > largest_bytes:
        raise ValueError(f"is larger than {largest_bytes} bytes; is it {kind}?")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"is not a text in UTF-8; {kind} is a TOML file") from None
