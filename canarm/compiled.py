"""Which of the packages run compiled, and which as the plain Python that is always there.

A compiled package has one library with the machine code of its modules beside it; each of these modules has a small
one of its own, which Python takes instead of the source. Nothing is imported here.
"""

from importlib.util import find_spec

PACKAGES = ("canarm_protocol", "canarm_emulator", "canarm_controller")
"""Those that can be compiled; commands and dashboard are plain always."""


def compiled_packages() -> list[str]:
    """Those of `PACKAGES` that run compiled."""
    return [name for name in PACKAGES if find_spec(f"{name}__mypyc") is not None]


def how_it_runs() -> str:
    """In words: "plain Python", "compiled", or "compiled in part: canarm_protocol"."""
    compiled = compiled_packages()
    if not compiled:
        return "plain Python"
    return "compiled" if len(compiled) == len(PACKAGES) else f"compiled in part: {', '.join(compiled)}"
