"""Brings the libraries of an extra of canarm (`mf4`, `web`, …) into the environment of the Python that runs this.

A clone's environment may have no pip: then uv does it, which `make setup` has found. What is brought stays until the
environment is made again, as after a change of uv.lock.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def requirements(name: str) -> list[str]:
    """What the extra `name` needs; ends the program for a name that is none."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras: dict[str, list[str]] = tomllib.load(file)["project"]["optional-dependencies"]
    if name not in extras:
        sys.exit(f"extra: {name or 'none named'}: name one, as EXTRA=mf4; there are {', '.join(extras)}")
    return extras[name]


def command(needed: list[str], uv: str | None) -> list[str]:
    """The command that installs them, with the program `uv` or with pip."""
    own = [sys.executable, "-m", "pip", "install"] if uv is None else [uv, "pip", "install", "--python", sys.executable]
    return [*own, *needed]


def main() -> int:
    """Install what the extra on the command line needs; the exit status is the installer's."""
    wanted = [need for name in "".join(sys.argv[1:2]).split(",") for need in requirements(name)]
    noted = ROOT / ".venv" / "uv.path"
    return subprocess.run(
        command(wanted, noted.read_text().strip() if noted.is_file() else None), check=False
    ).returncode


if __name__ == "__main__":
    sys.exit(main())
