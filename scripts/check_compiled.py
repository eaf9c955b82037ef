"""Compiles in place, and checks that nothing but the speed has changed; the sources run again afterwards.

The frames and the memory of some runs in lockstep must be the same to the byte, plain and compiled. Then the tests of
the compiled modules run; the rest, which is plain Python in any case, is left to `make test`: together with the
compilation it would take longer than everything else.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import compiled
from compiled import ROOT, CompileError

CONTROLLER = (
    "arrivals",
    "computed_torque",
    "controller_states",
    "detectors",
    "encoder_alarms",
    "feedforward",
    "inputs",
    "law_loading",
    "laws",
    "loop",
    "mras_lyapunov",
    "observer",
    "overdue",
    "supervisor",
)
TESTS = (
    "tests/emulator",
    *(f"tests/controller/test_{name}.py" for name in CONTROLLER),
    "tests/protocol/test_pdo.py",
    "tests/protocol/test_wiring.py",
    "tests/canarm/test_deriving.py",
    "tests/canarm/test_garbage.py",
)
"""All of the emulator, what of the controller runs in every cycle, and what users derive from."""
FILES = ("can0.log", "memory.bin")
RUNS = {
    "mras, sine": ["--seconds", "3"],
    "slotine-li": ["--seconds", "3", "--law", "slotine-li", "--seed", "3"],
    "mras-lyapunov, trapezoid": ["--seconds", "2", "--law", "mras-lyapunov", "--trajectory", "trapezoid"],
    "computed-torque, heavier": ["--seconds", "3", "--law", "computed-torque", "--truth", "joint3.mass=0.9"],
    "with the wire": ["--seconds", "2", "--law", "pd", "--wire"],
    "rhino-pair": ["--seconds", "1", "--cell", "rhino-pair"],
}
"""Runs that are compared, with their options."""
RUN_LIMIT_S, TEST_LIMIT_S = 300, 1800


class Different(Exception):
    """Compiled code does something else."""


def recorded(folder: Path) -> dict[str, dict[str, bytes]]:
    """Of each of `RUNS`, the contents of `FILES`, run below `folder`. Raises `Different` if one does not run."""
    found = {}
    for number, (name, options) in enumerate(RUNS.items()):
        out = folder / str(number)
        command = [sys.executable, "-m", "canarm", "demo", "--no-tui", "--clock", "sync", "--out", str(out), *options]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=RUN_LIMIT_S)
        if done.returncode:
            raise Different(f"{name}: exit status {done.returncode}\n{done.stdout}{done.stderr}".rstrip())
        found[name] = {path.name: path.read_bytes() for path in sorted(out.rglob("*")) if path.name in FILES}
    return found


def compare(plain: dict[str, dict[str, bytes]], other: dict[str, dict[str, bytes]]) -> None:
    """Raise `Different` for the first file that is another."""
    for name, files in plain.items():
        for file, content in files.items():
            if other[name].get(file) != content:
                raise Different(f"{name}: {file} is another when compiled")
        print(f"compiled: {name}: {', '.join(files)} the same", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", default="2", help="test processes")
    parser.add_argument("tests", nargs="*", default=TESTS, help=f"which tests; {' '.join(TESTS)} unless given")
    given = parser.parse_args()
    try:
        with TemporaryDirectory(prefix="canarm-compiled-") as name:
            folders = [Path(name, each) for each in ("plain", "compiled")]
            for folder in folders:
                folder.mkdir()
            compiled.remove()
            plain = recorded(folders[0])
            begun = time.monotonic()
            compiled.build()
            print(f"compiled: built in {time.monotonic() - begun:.0f} s", flush=True)
            compare(plain, recorded(folders[1]))
        command = [sys.executable, "-m", "pytest", "-q", "-n", given.jobs, "-m", "not slow", *given.tests]
        return subprocess.run(command, cwd=ROOT, timeout=TEST_LIMIT_S).returncode
    except (CompileError, Different, subprocess.TimeoutExpired) as error:
        print(f"compiled: FAILED: {error}", file=sys.stderr)
        return 1
    finally:
        compiled.remove()


if __name__ == "__main__":
    sys.exit(main())
