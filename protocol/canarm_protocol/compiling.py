"""What sources say to the compiler (mypyc), where there is one. Nothing here does anything at run time."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mypy_extensions import mypyc_attr as mypyc_attr
else:

    def _unheard(**flags: bool) -> object:
        """As `mypy_extensions.mypyc_attr`, which need not be installed to run."""
        return lambda of: of

    mypyc_attr = _unheard
