"""What uv.lock and the root pyproject.toml say, in the form that pip reads; for machines without uv.

`python scripts/locked.py constraints` prints the locked versions as a constraints file,
`python scripts/locked.py dev` the development tools as a requirements file.
"""

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent


def constraints(lock: dict[str, Any]) -> Iterator[str]:
    """One line for each locked version that comes from a package index."""
    for package in lock["package"]:
        if "registry" in package["source"]:
            markers = " or ".join(f"({marker})" for marker in package.get("resolution-markers", []))
            yield f"{package['name']}=={package['version']}" + (f" ; {markers}" if markers else "")


def dev_tools(project: dict[str, Any]) -> list[str]:
    """The requirements of the dependency group `dev`."""
    tools: list[str] = project["dependency-groups"]["dev"]
    return tools


def main(arguments: list[str]) -> int:
    match arguments:
        case ["constraints"]:
            lines = constraints(tomllib.loads((ROOT / "uv.lock").read_text(encoding="utf-8")))
        case ["dev"]:
            lines = iter(dev_tools(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))))
        case _:
            print("usage: locked.py constraints|dev", file=sys.stderr)
            return 2
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
