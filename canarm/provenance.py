"""Where a run comes from: command line, versions and machine; and what of that is another when it is run again."""

import importlib.metadata
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from canarm_protocol.shown import printable

LONGEST = 60
"""Characters of what a run folder says that are shown."""
_CPUINFO = Path("/proc/cpuinfo")
_PACKAGES = (
    "canarm",
    "canarm-protocol",
    "canarm-emulator",
    "canarm-controller",
    "mujoco",
    "numpy",
    "python-can",
    "canopen",
)


def provenance() -> dict[str, Any]:
    """The origin of a run, for its record: versions, machine and command line."""
    return {
        "command_line": sys.argv,
        "python": platform.python_version(),
        "machine": platform.platform(),
        "processor": _processor(),
        "versions": {name: importlib.metadata.version(name) for name in _PACKAGES},
    }


def differences(recorded: Mapping[str, Any]) -> list[str]:
    """What may round numbers otherwise here than where `recorded` was made, as "numpy 2.2.0 (here 2.3.1)"."""
    here = provenance()
    versions = recorded.get("versions")
    then = dict(versions) if isinstance(versions, Mapping) else {}
    pairs = [
        ("processor", recorded.get("processor"), here["processor"]),
        ("Python", recorded.get("python"), here["python"]),
    ]
    pairs += [(name, then.get(name), version) for name, version in here["versions"].items()]
    return [
        f"{name} {printable(str(before))[:LONGEST]} (here {now})"
        for name, before, now in pairs
        if before is not None and before != now
    ]


def _processor() -> str:
    """The processor's name where the system tells it; libraries choose their arithmetic by what it can do."""
    try:
        lines = _CPUINFO.read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    names = (value.strip() for key, _, value in (line.partition(":") for line in lines) if key.strip() == "model name")
    return next(names, platform.processor() or platform.machine())
