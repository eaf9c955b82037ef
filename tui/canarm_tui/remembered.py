"""What the dashboard remembers of its user from one time to the next: the theme. A small file in the system's place.

Without the file, or with one that cannot be read or written, everything works as ever.
"""

import json
from pathlib import Path

from platformdirs import user_config_path

FILE = "dashboard.json"
LARGEST = 1 << 16


def config_file() -> Path:
    """Where it is kept: on Linux ~/.config/canarm, or where XDG_CONFIG_HOME says."""
    return user_config_path("canarm") / FILE


def remembered_theme(path: Path) -> str | None:
    """The theme, or None."""
    try:
        if path.stat().st_size > LARGEST:
            return None
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    theme = kept.get("theme") if isinstance(kept, dict) else None
    return theme if isinstance(theme, str) else None


def remember_theme(path: Path, theme: str) -> None:
    """Keep it; a file that cannot be written is left as it is."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"theme": theme}) + "\n", encoding="utf-8")
    except OSError:
        return
