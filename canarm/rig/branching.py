"""Several futures of one rig: each is lived by an exact copy of it, in a process of its own.

What a rig is, and how a copy of a process is made, is not known here.
"""

import pickle
from collections.abc import Callable
from typing import Any, Self, TypeVar, cast

from canarm_protocol.shown import named_error, quoted

from ..usage import UsageError
from ..workers.forking import CAN_FORK, in_copy
from .turns import Turns

_Result = TypeVar("_Result")


class Branching:
    """What a rig in one process adds: `branch`."""

    _recorders: Any
    _turns: Turns

    def branch(self, do: Callable[[Self], _Result]) -> _Result:
        """What `do` returns for an exact copy of this rig; this one stays as it is, and may branch again.

        The copy is bit for bit the same, laws, faults and noise included: in it a run goes on as it would here. It has
        no folder, and nothing of it comes back but the result, which must be picklable. What `do` raises is raised
        here. Raises `UsageError` where the system has no fork (Linux has), or for a result that cannot be pickled, and
        `LostWorkerError` if the copy is killed.
        """
        __tracebackhide__ = True
        if not callable(do):
            raise UsageError(f"branch: {quoted(do)}: must be a function, which is given the copy")
        self._turns.check("branch")
        if not CAN_FORK:
            raise UsageError("branch: this system cannot copy a process (fork); make two rigs, and run both up to here")

        def live() -> tuple[bool, bytes]:
            self._recorders = None
            try:
                result = do(self)
            except BaseException as error:
                return False, _as_bytes(error)
            try:
                return True, pickle.dumps(result)
            except Exception as error:
                return False, pickle.dumps(_unfit(error))

        is_result, said = in_copy(live)
        try:
            given = pickle.loads(said)
        except Exception as error:
            raise _unfit(error) from None
        if is_result:
            return cast(_Result, given)
        raise given


def _unfit(error: Exception) -> UsageError:
    return UsageError(
        "branch: what the function returned cannot be handed over: return numbers, arrays or a DataFrame, not the rig "
        f"or its parts ({named_error(error)})"
    )


def _as_bytes(error: BaseException) -> bytes:
    """An exception that is raised elsewhere: itself, or one that says what it said."""
    try:
        said = pickle.dumps(error)
        pickle.loads(said)
        return said
    except Exception:
        return pickle.dumps(UsageError(f"branch: {named_error(error)}"))
