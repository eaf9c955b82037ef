"""An answer that comes late is owed; only one that is owed by nobody is a repetition."""

import pytest

from canarm_controller.supervision.arrivals import Arrivals
from canarm_controller.supervision.detection import Reaction

ADC, OTHER = 0x294, 0x394


class Told:
    """What is reported, in order."""

    def __init__(self, owed_cycles: int) -> None:
        self.names: list[str] = []
        self.arrivals = Arrivals((ADC, OTHER), self._take, owed_cycles)

    def _take(self, detector: str, node_id: int, detail: str, reaction: Reaction | None) -> bool:
        assert (node_id, f"0x{ADC:03X}" in detail) == (0x14, True)
        self.names.append(detector)
        return True

    def cycles(self, count: int, *missing: int) -> None:
        for _ in range(count):
            self.arrivals.open_cycle(missing)


def test_answers_that_queued_up_while_the_machine_stood_are_late_and_none_is_a_repetition() -> None:
    told = Told(owed_cycles=40)
    told.cycles(3, ADC, OTHER)
    for _ in range(3):
        told.arrivals.extra(ADC)
    assert told.names == ["inputs-late"] * 3
    told.arrivals.extra(ADC)
    assert told.names[3:] == ["inputs-repeated"]


@pytest.mark.parametrize("owed_cycles", [1, 40])
def test_a_lost_answer_excuses_no_repetition_later(owed_cycles: int) -> None:
    told = Told(owed_cycles)
    told.cycles(1, ADC)
    told.cycles(owed_cycles)
    told.arrivals.extra(ADC)
    assert told.names == ["inputs-repeated"]


def test_in_lockstep_only_the_last_cycles_answer_can_be_late() -> None:
    told = Told(owed_cycles=1)
    told.cycles(5, ADC)
    told.arrivals.extra(ADC)
    told.arrivals.extra(ADC)
    assert told.names == ["inputs-late", "inputs-repeated"]
    told.cycles(1, OTHER)
    told.arrivals.extra(ADC)
    assert told.names[2:] == ["inputs-repeated"]
