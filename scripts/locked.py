"""The contents of uv.lock and the root pyproject.toml in pip's format, for machines without uv.

`python scripts/locked.py constraints` prints the locked versions as a constraints file,
`python scripts/locked.py dev` the development tools as a requirements file.
`python scripts/locked.py check` reports packages locked from anywhere but the public index, which `uv lock
--check` lets pass: a path or a mirror of one machine is of no use on another.
"""

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
INDEX = "https://pypi.org/simple"
FILES = "https://files.pythonhosted.org/"


def constraints(lock: dict[str, Any]) -> Iterator[str]:
    """One line for each locked version that comes from a package index."""
    for package in lock["package"]:
        if "registry" in package["source"]:
            markers = " or ".join(f"({marker})" for marker in package.get("resolution-markers", []))
            yield f"{package['name']}=={package['version']}" + (f" ; {markers}" if markers else "")


def strangers(lock: dict[str, Any]) -> Iterator[str]:
    """One line for each package that comes neither from the public index nor from this workspace."""
    for package in lock["package"]:
        source = package["source"]
        if source.get("registry", INDEX) != INDEX or not source.keys() & {"registry", "editable", "virtual"}:
            yield f"uv.lock: {package['name']}: source is {source}; it should be {INDEX}: remove uv.lock, run make lock"
        files = [*package.get("wheels", []), *([package["sdist"]] if "sdist" in package else [])]
        for file in files:
            if not (location := file.get("url", file.get("path", "?"))).startswith(FILES):
                yield f"uv.lock: {package['name']}: file is {location}; it should be under {FILES}"


def dev_tools(project: dict[str, Any]) -> list[str]:
    """The requirements of the dependency group `dev`."""
    tools: list[str] = project["dependency-groups"]["dev"]
    return tools


def read(name: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / name).read_text(encoding="utf-8"))


def main(arguments: list[str]) -> int:
    match arguments:
        case ["constraints"]:
            print("\n".join(constraints(read("uv.lock"))))
        case ["dev"]:
            print("\n".join(dev_tools(read("pyproject.toml"))))
        case ["check"]:
            if found := list(strangers(read("uv.lock"))):
                print("\n".join(found), file=sys.stderr)
                return 1
        case _:
            print("usage: locked.py constraints|dev|check", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
