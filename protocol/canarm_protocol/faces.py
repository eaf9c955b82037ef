"""Light public faces: a package names what it offers, and loads a module when one of its names is used.

Thus neither the command line nor the dashboard waits for what it does not use, and the rooms of a package can import
each other's modules without a cycle through the faces.
"""

import importlib
from collections.abc import Callable, Collection
from typing import Any


def loader(package: str, names: Collection[str], *modules: str) -> Callable[[str], Any]:
    """The `__getattr__` of `package`, which offers `names`.

    They are looked up in `modules`, one after the other: put the cheapest to load first. A leading dot stands for the
    package.
    """

    def load(name: str) -> Any:
        if name in names:
            for module in modules:
                loaded = importlib.import_module(module, package)
                if hasattr(loaded, name):
                    return getattr(loaded, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return load
