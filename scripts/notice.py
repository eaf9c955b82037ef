"""Write NOTICE: the licences of all dependencies of an installed canarm, from the packages' own metadata.

`--check` writes nothing and fails if NOTICE lacks a package or has another licence for it. Which packages are needed
depends on platform and Python; a line not needed here is no mistake. Development dependencies are left out.
"""

import re
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

NOTICE = Path(__file__).resolve().parent.parent / "NOTICE"
OURS = ("canarm", "canarm-controller", "canarm-emulator", "canarm-protocol", "canarm-tui")
HEAD = """canarm is published under the MIT licence (LICENSE). It copies no code of others; installed, it uses these
packages, each under its own licence:

"""
COPYLEFT = """
python-can (LGPL-3.0-only) is imported as it is published, unchanged, and can be
replaced by another version of it; who passes canarm on together with it has to pass on its licence as well, and must
not stand in the way of such a replacement.
"""


def normal(name: str) -> str:
    """The normalized name of a distribution (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def brought_along() -> dict[str, str]:
    """Every distribution that ours need on this platform, with its licence."""
    found: dict[str, str] = {}
    waiting = [(name, "") for name in OURS]
    done = set()
    while waiting:
        name, extra = waiting.pop()
        if (name, extra) in done:
            continue
        done.add((name, extra))
        try:
            metadata = distribution(name)
        except PackageNotFoundError:
            continue
        if name not in OURS:
            found[name] = licence(metadata.metadata)
        for text in metadata.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                waiting += [(normal(requirement.name), each) for each in ("", *requirement.extras)]
    return found


def licence(metadata) -> str:
    """The licence of one distribution: its SPDX expression, its classifiers, or the first line of its licence field."""
    if expression := metadata.get("License-Expression"):
        return expression
    names = [each.split(" :: ")[-1] for each in metadata.get_all("Classifier", []) if each.startswith("License ::")]
    if names := [name for name in names if name != "OSI Approved"]:
        return ", ".join(names)
    return (metadata.get("License") or "not stated").strip().splitlines()[0]


def text() -> str:
    """What NOTICE says."""
    found = brought_along()
    width = max(map(len, found)) + 2
    return HEAD + "".join(f"  {name:<{width}}{found[name]}\n" for name in sorted(found)) + COPYLEFT


def main() -> int:
    if "--check" not in sys.argv[1:]:
        NOTICE.write_text(text(), encoding="utf-8")
        return 0
    there = {tuple(line.split(maxsplit=1)) for line in NOTICE.read_text(encoding="utf-8").splitlines()}
    missing = [item for item in sorted(brought_along().items()) if item not in there]
    for name, words in missing:
        print(f"NOTICE: {name} is {words}, which it does not say; write it again: make notice", file=sys.stderr)
    return bool(missing)


if __name__ == "__main__":
    sys.exit(main())
