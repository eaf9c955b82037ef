"""Detects missing, late and repeated TPDOs. Their data are not used: equal data do not prove a repetition."""

from collections.abc import Callable, Collection

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID

from .detection import Reaction


class Arrivals:
    """Counts arrivals of each cyclic TPDO between one SYNC and the next."""

    def __init__(self, cob_ids: Collection[int], report: Callable[[str, int, str, Reaction | None], bool]) -> None:
        self._report = report
        self._was_missing: dict[int, bool] = dict.fromkeys(cob_ids, False)
        self._is_any_missing = False

    def open_cycle(self, missing: Collection[int]) -> None:
        """SYNC is sent; `missing` did not arrive in the cycle that ends."""
        if not missing and not self._is_any_missing:
            return
        self._is_any_missing = bool(missing)
        was_missing = self._was_missing
        for cob_id in was_missing:
            was_missing[cob_id] = cob_id in missing

    def extra(self, cob_id: int) -> None:
        """A TPDO arrived a second time in this cycle: the last cycle's, or one too many."""
        node_id = cob_id & HIGHEST_NODE_ID
        if self._was_missing[cob_id]:
            self._was_missing[cob_id] = False
            self._report("inputs-late", node_id, f"TPDO 0x{cob_id:03X} came a cycle late", None)
        else:
            self._report("inputs-repeated", node_id, f"TPDO 0x{cob_id:03X} came twice in a cycle", None)
