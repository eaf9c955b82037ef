"""What sources say to the compiler (mypyc), where there is one. Nothing here does anything at run time."""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from mypy_extensions import mypyc_attr as mypyc_attr
else:
    _Class = TypeVar("_Class")

    def mypyc_attr(**flags: bool) -> Callable[[_Class], _Class]:
        """As `mypy_extensions.mypyc_attr`, which need not be installed to run."""
        return lambda of: of
