"""What the figures were measured with: processor, system, Python and how it was built, canarm and how it runs."""

import os
import platform
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from canarm.compiled import how_it_runs


def machine() -> str:
    """Processor, cores and system, in a line."""
    cpu = next(
        (line.split(":")[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")),
        platform.processor() or "unknown processor",
    )
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}"


def python() -> dict[str, Any]:
    """The interpreter: implementation, version, how it was optimised, and whether canarm is compiled."""
    return {
        "implementation": platform.python_implementation(),
        "version": platform.python_version(),
        "optimisation": optimisation(sysconfig.get_config_var("CONFIG_ARGS")),
        "asserts": not sys.flags.optimize,
        "canarm": how_it_runs(),
    }


def python_text(known: dict[str, Any]) -> str:
    """What `python` says, in a line."""
    asserts = "" if known["asserts"] else ", without asserts"
    head = f"{known['implementation']} {known['version']}, {known['optimisation']}{asserts}"
    return f"{head}; canarm: {known['canarm']}"


def optimisation(configured: str | None) -> str:
    """How an interpreter was optimised that was built with these options of `configure`; None if nobody knows."""
    if configured is None:
        return "optimisation not known"
    found = [
        name
        for option, name in (
            ("--enable-optimizations", "profile-guided"),
            ("--with-lto", "link-time"),
            ("--enable-experimental-jit", "JIT"),
            ("--with-pydebug", "debug build"),
        )
        if option in configured
    ]
    return " and ".join(found) if found else "not optimised by profile"


def commit() -> str:
    """The commit that is checked out."""
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return described.stdout.strip()


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text().splitlines()
    except OSError:
        return []
