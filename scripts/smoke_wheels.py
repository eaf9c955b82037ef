"""Builds the wheels of all five distributions, installs them together in a clean environment, and runs them there.

Everything happens in a temporary folder, away from the source tree, as for a user. Third-party
packages have the versions of uv.lock. Run it with the Python of the checkout's .venv.
"""

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Mapping
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory

from locked import ROOT

PACKAGES = {
    "canarm_protocol": ROOT / "protocol",
    "canarm_emulator": ROOT / "emulator",
    "canarm_controller": ROOT / "controller",
    "canarm_tui": ROOT / "tui",
    "canarm": ROOT,
}
"""Import package → folder of its pyproject.toml."""

DATA_FILES = ("canarm_protocol/cells/*.toml", "canarm_protocol/eds/*.eds")
"""What the wheels must contain beside Python, at least one file each."""

BUILD_LIMIT_S = 300
INSTALL_LIMIT_S = 900
RUN_LIMIT_S = 120


class SmokeError(Exception):
    """A wheel is incomplete, or does not work when installed."""


def build(folder: Path, target: Path) -> Path:
    """Build the wheel of the project in `folder` into `target`; returns its path."""
    before = set(target.glob("*.whl"))
    run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(target)], folder, BUILD_LIMIT_S)
    (wheel,) = set(target.glob("*.whl")) - before
    return wheel


def missing_files(package: str, folder: Path, wheel: Path) -> list[str]:
    """Files of the source tree's `package` that `wheel` lacks."""
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    sources = (path.relative_to(folder).as_posix() for path in (folder / package).rglob("*") if path.is_file())
    left_out = "__pycache__", ".so", ".pyd"  # make compiled puts libraries beside the sources
    return sorted(name for name in sources if not any(each in name for each in left_out) and name not in packed)


def check_contents(wheels: Mapping[str, Path]) -> None:
    """Raise `SmokeError` if a wheel lacks a file of its package, or all wheels lack the data files."""
    packed: list[str] = []
    for package, wheel in wheels.items():
        if missing := missing_files(package, PACKAGES[package], wheel):
            raise SmokeError(f"{wheel.name}: lacks {', '.join(missing)}")
        with zipfile.ZipFile(wheel) as archive:
            packed += archive.namelist()
    for pattern in DATA_FILES:
        if not any(fnmatch(name, pattern) for name in packed):
            raise SmokeError(f"no wheel contains {pattern}")


def install(wheels: Iterable[Path], environment: Path) -> None:
    """Make a virtual environment with just the wheels and their dependencies."""
    constraints = environment.with_suffix(".txt")
    constraints.write_text(run([sys.executable, str(ROOT / "scripts/locked.py"), "constraints"], ROOT, RUN_LIMIT_S))
    requirements = ["-c", str(constraints), *map(str, wheels)]
    python = str(environment / "bin/python")
    uv_path = ROOT / ".venv/uv.path"
    if uv_path.exists():
        uv = uv_path.read_text().strip()
        run([uv, "venv", "--quiet", "--python", sys.executable, str(environment)], ROOT, INSTALL_LIMIT_S)
        run([uv, "pip", "install", "--quiet", "--python", python, *requirements], environment, INSTALL_LIMIT_S)
    else:
        run([sys.executable, "-m", "venv", str(environment)], ROOT, INSTALL_LIMIT_S)
        run([python, "-m", "pip", "install", "--quiet", *requirements], environment, INSTALL_LIMIT_S)


def try_out(environment: Path, elsewhere: Path) -> None:
    """Import the packages and run `canarm` in `elsewhere`; raises `SmokeError` if anything is wrong."""
    imports = "; ".join(f"import {package}; print({package}.__file__)" for package in PACKAGES)
    for origin in run([str(environment / "bin/python"), "-c", imports], elsewhere, RUN_LIMIT_S).split():
        if not Path(origin).is_relative_to(environment):
            raise SmokeError(f"{origin} was imported; it should be under {environment}")
    canarm = str(environment / "bin/canarm")
    run([canarm, "--help"], elsewhere, RUN_LIMIT_S)
    run([canarm, "check", "--cell", "konkuk1"], elsewhere, RUN_LIMIT_S)
    demo = [canarm, "demo", "--clock", "sync", "--seconds", "1", "--no-tui", "--json"]
    check_summary(run(demo, elsewhere, RUN_LIMIT_S))


def check_summary(stdout: str) -> None:
    """Raise `SmokeError` unless the last line is the JSON summary of a completed run."""
    last = (stdout.splitlines() or [""])[-1]
    try:
        summary = json.loads(last)
    except ValueError:
        raise SmokeError(f"canarm demo: the last line of stdout is not JSON: {last!r}") from None
    if not isinstance(summary, dict) or summary.get("state") != "done":
        raise SmokeError(f'canarm demo: the summary should have "state": "done": {last}')


def run(command: list[str], folder: Path, limit_s: float) -> str:
    """Run `command` in `folder`; its stdout. Raises `SmokeError` with its output if it fails or takes too long."""
    shown = " ".join(Path(word).name if word.startswith("/") else word for word in command)
    print(f"smoke: {shown}", flush=True)
    clean = {key: value for key, value in os.environ.items() if key not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    try:
        done = subprocess.run(
            command, cwd=folder, env=clean, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=limit_s
        )
    except subprocess.TimeoutExpired:
        raise SmokeError(f"{shown}: not done after {limit_s} s") from None
    except OSError as error:
        raise SmokeError(f"{shown}: {error}") from None
    if done.returncode:
        raise SmokeError(f"{shown}: exit status {done.returncode}\n{done.stdout}{done.stderr}".rstrip())
    return done.stdout


def main() -> int:
    with TemporaryDirectory(prefix="canarm-smoke-") as name:
        work = Path(name).resolve()
        for folder in ("wheels", "elsewhere"):
            (work / folder).mkdir()
        try:
            wheels = {package: build(folder, work / "wheels") for package, folder in PACKAGES.items()}
            check_contents(wheels)
            install(wheels.values(), work / "environment")
            try_out(work / "environment", work / "elsewhere")
        except SmokeError as error:
            print(f"smoke: FAILED: {error}", file=sys.stderr)
            return 1
    print("smoke: the five wheels work together")
    return 0


if __name__ == "__main__":
    sys.exit(main())
