"""Libraries that are not part of an installed canarm: loaded when asked for, or named in an error."""

import importlib
from pathlib import Path
from typing import Any

from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import first_line, quoted

from .usage import UsageError

EXTRAS = {
    "pandas": "pandas",
    "polars": "polars",
    "pyarrow": "parquet",
    "mcap": "mcap",
    "asammdf": "mf4",
    "distributed": "dask",
    "scipy": "tune",
    "matplotlib": "figures",
    "textual_serve": "web",
}
"""Which extra of the distribution brings each."""
_CLONE_SCRIPT = Path(__file__).parents[1] / "scripts" / "extra.py"
"""There in a clone only."""
TABLES = ("pandas", "polars")


class MissingLibraryError(CanarmError):
    """An optional library is not installed, or does not load."""


def no_formula(text: str) -> str:
    """`text` for matplotlib, which sets what stands between dollars."""
    return text.replace("$", r"\$")


def load_library(name: str, what: str) -> Any:
    """The module `name`, for `what`. Raises `MissingLibraryError`."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != name.split(".")[0]:
            raise _broken(name, what, error) from None
        extra = EXTRAS[name.split(".")[0]]
        raise MissingLibraryError(f"{what} needs {name}, which is not installed: {how_to_get(extra)}") from None
    except Exception as error:  # a binary module for another processor, for example
        raise _broken(name, what, error) from None


def how_to_get(extra: str) -> str:
    """The command that brings the libraries of an extra to the Python that runs this: in a clone pip is another's."""
    installed = f"pip install 'canarm[{extra}]'"
    return f"make extra EXTRA={extra} (in this clone; elsewhere {installed})" if _CLONE_SCRIPT.is_file() else installed


def data_frame(columns: dict[str, Any], library: object) -> Any:
    """`columns` as a DataFrame of `library`, "pandas" or "polars".

    Raises `MissingLibraryError`, and `UsageError` for another library.
    """
    return load_library(check_library(library), "a DataFrame").DataFrame(columns)


def check_library(name: object) -> str:
    """The name of a library of DataFrames. Raises `UsageError` for any other."""
    if not isinstance(name, str) or name not in TABLES:
        raise UsageError(f"library {quoted(name)}: must be {' or '.join(TABLES)}")
    return name


def _broken(name: str, what: str, error: Exception) -> MissingLibraryError:
    return MissingLibraryError(f"{what} needs {name}, which does not load: {first_line(error)}")
