"""Detects missing, late and repeated TPDOs. Their data are not used: equal data do not prove a repetition."""

from collections.abc import Callable, Collection

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID

from .detection import Reaction

OWED_NS = 100_000_000
"""On the wall clock an answer may come so long after its cycle, when the machine has kept its sender or us waiting."""


class Arrivals:
    """Counts arrivals of each cyclic TPDO between one SYNC and the next.

    One that did not come in its cycle may still come, for `owed_cycles` after the last such cycle: then it is late. One
    that nothing is owed of is a repetition.
    """

    def __init__(
        self, cob_ids: Collection[int], report: Callable[[str, int, str, Reaction | None], bool], owed_cycles: int = 1
    ) -> None:
        self._report, self._owed_cycles = report, owed_cycles
        self._owed = dict.fromkeys(cob_ids, 0)
        """How many are owed, and in `_left` for how many cycles more."""
        self._left = dict.fromkeys(cob_ids, 0)
        self._is_any_owed = False

    def open_cycle(self, missing: Collection[int]) -> None:
        """SYNC is sent; `missing` did not arrive in the cycle that ends."""
        if not missing and not self._is_any_owed:
            return
        self._is_any_owed = False
        for cob_id, left in self._left.items():
            if cob_id in missing:
                self._is_any_owed = True
                self._left[cob_id] = self._owed_cycles
                self._owed[cob_id] = min(self._owed[cob_id] + 1, self._owed_cycles)
            elif left:
                self._is_any_owed = True
                self._left[cob_id] = left - 1
                if left == 1:
                    self._owed[cob_id] = 0

    def extra(self, cob_id: int) -> None:
        """A TPDO arrived a second time in this cycle: one of an earlier cycle, or one too many."""
        node_id = cob_id & HIGHEST_NODE_ID
        if self._owed[cob_id]:
            self._owed[cob_id] -= 1
            self._report("inputs-late", node_id, f"TPDO 0x{cob_id:03X} came after its cycle", None)
        else:
            self._report("inputs-repeated", node_id, f"TPDO 0x{cob_id:03X} came twice in a cycle", None)
