"""Install canarm as in the README, in an empty environment of each supported Python on this machine, and run it.

The command is read from the README, so that users' instructions are tested: by pip with the Python that runs this,
and for the others by uv, if installed, which takes a tenth of the time.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
LINE = re.compile(r"^pip (install \./.+)$", re.MULTILINE)
INSTALL_LIMIT_S, RUN_LIMIT_S = 900, 180
UV_PATH = ROOT / ".venv" / "uv.path"
UV = UV_PATH.read_text().strip() if UV_PATH.exists() else None
IS_VERSION = "import sys; print('%d.%d' % sys.version_info[:2])"


def interpreter(version: str) -> str | None:
    """A working Python of this version, or None. Version managers may put broken names on PATH; uv knows theirs."""
    found = [sys.executable, shutil.which(f"python{version}")]
    if UV:
        asked = [UV, "python", "find", "--no-project", "--no-python-downloads", version]
        found.append(subprocess.run(asked, cwd="/", capture_output=True, text=True).stdout.strip())
    for name in filter(None, found):
        if subprocess.run([name, "-c", IS_VERSION], capture_output=True, text=True).stdout.strip() == version:
            return name
    return None


def run(command: list[str], folder: Path, limit_s: float) -> None:
    """Raises `CalledProcessError` or `TimeoutExpired`."""
    ours = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    clean = {key: value for key, value in os.environ.items() if key not in ours}
    subprocess.run(command, cwd=folder, env=clean, stdin=subprocess.DEVNULL, timeout=limit_s, check=True)


def try_out(python: str, line: str) -> None:
    """Install a copy of the tracked files into an empty environment, and run a short demo from elsewhere."""
    with tempfile.TemporaryDirectory(prefix="canarm-install-") as name:
        work = Path(name)
        clone, environment = work / "clone", work / "environment"
        run(["git", "clone", "--quiet", str(ROOT), str(clone)], work, RUN_LIMIT_S)
        run([python, "-m", "venv", str(environment)], work, RUN_LIMIT_S)
        bin_folder = environment / ("Scripts" if os.name == "nt" else "bin")
        inside = str(bin_folder / "python")
        install, *packages = line.split()
        if python == sys.executable or UV is None:
            command = [inside, "-m", "pip", install, "--quiet", *packages]
        else:
            command = [UV, "pip", install, "--quiet", "--python", inside, *packages]
        run(command, clone, INSTALL_LIMIT_S)
        canarm = str(bin_folder / "canarm")
        run([canarm, "check", "--cell", "konkuk1"], work, RUN_LIMIT_S)
        run([canarm, "demo", "--clock", "sync", "--seconds", "0.5", "--no-tui", "--json"], work, RUN_LIMIT_S)


def main() -> int:
    found = LINE.search((ROOT / "README.md").read_text(encoding="utf-8"))
    if found is None:
        print("README.md: no line begins with 'pip install ./'", file=sys.stderr)
        return 1
    for version in VERSIONS:
        python = interpreter(version)
        if python is None:
            print(f"install: Python {version} is not on this machine: not tried", flush=True)
            continue
        print(f"install: Python {version}: pip {found.group(1)}", flush=True)
        try:
            try_out(python, found.group(1))
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            print(f"install: FAILED with Python {version}: {error}", file=sys.stderr)
            return 1
    print("install: works as the README says")
    return 0


if __name__ == "__main__":
    sys.exit(main())
