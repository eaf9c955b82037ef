"""Compiles the packages that can be compiled, beside their sources; and takes that back.

`build` builds the wheels as they are built for users, through the build backend's hook, from a copy of each package
below build/compiled/, and puts the libraries in them beside the sources: Python takes a library before a source of the
same name. `plain` removes them. `fresh` fails if a source has changed since. Run it with the checkout's .venv.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {"canarm_protocol": "protocol", "canarm_emulator": "emulator", "canarm_controller": "controller"}
"""Import package → folder of its pyproject.toml, in the order of their dependencies."""
WORK = ROOT / "build" / "compiled"
LIBRARIES = ("*.so", "*.pyd")
BUILD_LIMIT_S = 3600
NEEDED = "make compiled needs a C compiler (Debian, Ubuntu: apt install gcc libc6-dev) and Python's headers"


class CompileError(Exception):
    """A package cannot be compiled."""


def included(folder: Path) -> list[str]:
    """The modules that the hook compiles, as in the package's pyproject.toml."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    hook = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["mypyc"]
    return [str(name) for name in hook["include"]]


def libraries(root: Path = ROOT) -> Iterator[Path]:
    """Every compiled library beside the sources."""
    for package, folder in PACKAGES.items():
        for pattern in LIBRARIES:
            yield from (root / folder).glob(f"{package}__mypyc.{pattern}")
            yield from (root / folder / package).rglob(pattern)


def remove(root: Path = ROOT) -> int:
    """Remove them, so that the sources run; how many there were."""
    found = list(libraries(root))
    for path in found:
        path.unlink()
    return len(found)


def digests(folder: Path) -> dict[str, str]:
    """Of each module that is compiled, the sha256 of its source."""
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in included(folder)}


def stale(root: Path = ROOT) -> list[str]:
    """The compiled modules whose source has changed since, or that are not to be compiled any more."""
    found = []
    for package, folder in PACKAGES.items():
        if not any(path.is_relative_to(root / folder) for path in libraries(root)):
            continue
        record = root / "build" / "compiled" / f"{package}.json"
        then: dict[str, str] = json.loads(record.read_text(encoding="utf-8")) if record.exists() else {}
        now = digests(root / folder)
        found += [f"{folder}/{name}" for name in sorted(then.keys() | now.keys()) if then.get(name) != now.get(name)]
    return found


def compiler_problem() -> str | None:
    """What is missing to compile anything, found by compiling a line; None if nothing is."""
    words = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "").split()
    if os.name == "nt":
        return None  # setuptools finds Visual C++, or says that there is none
    if not words or shutil.which(words[0]) is None:
        return f"there is no {words[0] if words else 'C compiler'}"
    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "line.c"
        source.write_text("#include <Python.h>\n")
        command = [*words, "-fsyntax-only", f"-I{sysconfig.get_path('include')}", str(source)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return None if done.returncode == 0 else next(iter(done.stderr.splitlines()), "it fails")


def build_wheel(package: str, root: Path = ROOT) -> Path:
    """The compiled wheel of `package`, built from a copy of its sources. Raises `CompileError`."""
    folder, copy = root / PACKAGES[package], WORK / PACKAGES[package]
    target = copy / "dist"
    shutil.rmtree(target, ignore_errors=True)
    shutil.rmtree(copy / package, ignore_errors=True)
    left_out = shutil.ignore_patterns("__pycache__", *LIBRARIES)
    shutil.copytree(folder / package, copy / package, ignore=left_out)
    shutil.copy(folder / "pyproject.toml", copy)
    others = [str(root / other) for name, other in PACKAGES.items() if name != package]
    environment = {**os.environ, "HATCH_BUILD_HOOKS_ENABLE": "1", "MYPYPATH": os.pathsep.join(others)}
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(target)]
    done = subprocess.run(
        command, cwd=copy, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, timeout=BUILD_LIMIT_S,
    )  # fmt: skip
    if done.returncode:
        raise CompileError(f"{package}: {done.stdout.strip()}")
    return next(target.glob("*.whl"))


def place(package: str, wheel: Path, root: Path = ROOT) -> int:
    """Put the libraries of `wheel` beside the sources; how many there are."""
    folder, count = root / PACKAGES[package], 0
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            if any(Path(name).match(pattern) for pattern in LIBRARIES):
                archive.extract(name, folder)
                count += 1
    return count


def build(packages: Sequence[str] = tuple(PACKAGES)) -> None:
    """Compile `packages` in place. Raises `CompileError`."""
    if (problem := compiler_problem()) is not None:
        raise CompileError(f"{problem}. {NEEDED}; the plain sources run as before")
    remove()
    WORK.mkdir(parents=True, exist_ok=True)
    for package in packages:
        known = digests(ROOT / PACKAGES[package])
        print(f"compiled: {package}: {len(known)} modules", flush=True)
        place(package, build_wheel(package))
        (WORK / f"{package}.json").write_text(json.dumps(known, indent=1), encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("build", "plain", "fresh"))
    what = parser.parse_args().what
    try:
        if what == "build":
            build()
            print("compiled: the compiled modules run from now on; make plain takes that back")
        elif what == "plain":
            print(f"plain: {remove()} libraries removed; the sources run")
        elif changed := stale():
            named = changed[0] if len(changed) == 1 else f"{changed[0]} and {len(changed) - 1} more"
            raise CompileError(f"{named}: not the source that was compiled. make compiled, or make plain")
    except (CompileError, subprocess.TimeoutExpired) as error:
        remove() if what == "build" else None
        print(f"compiled: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
