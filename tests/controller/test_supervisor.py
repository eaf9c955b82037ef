"""What the supervisor makes of messages, silence, measurements and commands."""

import math
from collections.abc import Sequence
from decimal import Decimal

import numpy as np
import pytest

from canarm_controller.supervision.supervisor import Supervisor
from canarm_protocol.canopen.frames import Emergency, Frame, time_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.wiring import card_nodes

DAC, LATCH, ADC = 0x12, 0x13, 0x14
OPERATIONAL, PRE_OPERATIONAL, STOPPED, BOOT_UP = b"\x05", b"\x7f", b"\x04", b"\x00"  # CiA 301, heartbeat
TIMEOUT_CYCLES = 40  # 100 ms of 2.5 ms


@pytest.fixture
def supervisor() -> Supervisor:
    cell = load_cell("konkuk1")
    return Supervisor(cell, card_nodes(cell))


def beat(node_id: int, state: bytes) -> Frame:
    return Frame(0x700 + node_id, state)


def all_beat(supervisor: Supervisor, tick: int) -> None:
    for node_id in (DAC, LATCH, ADC):
        assert supervisor.message(beat(node_id, OPERATIONAL), tick) is None


def test_heartbeats_in_operational_keep_it_quiet(supervisor: Supervisor) -> None:
    for tick in range(0, 400, 8):
        all_beat(supervisor, tick)
        assert supervisor.begin_cycle(tick) is None


def test_a_heartbeat_is_lost_after_its_timeout_and_not_before(supervisor: Supervisor) -> None:
    all_beat(supervisor, 100)
    assert supervisor.begin_cycle(100 + TIMEOUT_CYCLES) is None
    verdict = supervisor.begin_cycle(101 + TIMEOUT_CYCLES)
    assert str(verdict) == "heartbeat-lost: card 'dac' (node 0x12) silent for 100 ms"


def test_a_card_that_is_silent_while_others_are_heard_is_missed_within_20_ms() -> None:
    """Cards of the pair say every 7 ms that they are there: every third cycle at the most."""
    cell = load_cell("rhino-pair")
    supervisor = Supervisor(cell, card_nodes(cell))
    nodes = [card.node_id for card in cell.card]
    silent = nodes.index(0x21)

    def heard(tick: int, each: list[int]) -> None:
        for node_id in each:
            assert supervisor.message(beat(node_id, OPERATIONAL), tick) is None

    for tick in (0, 3, 6):
        assert supervisor.begin_cycle(tick) is None
        heard(tick, nodes)
    for tick in (9, 12):
        assert supervisor.begin_cycle(tick) is None
        heard(tick, nodes[:silent] + nodes[silent + 1 :])
    verdict = supervisor.begin_cycle(13)
    assert str(verdict) == (
        "heartbeat-lost: card 'slave-dac1' (node 0x21) silent for 15 ms, while other cards are heard"
    )
    assert (13 - 6) * cell.bus.cycle_s <= 0.02


def test_cards_that_are_all_silent_have_the_whole_time() -> None:
    """A busy machine: they are heard again one after the other, each once."""
    cell = load_cell("rhino-pair")
    supervisor = Supervisor(cell, card_nodes(cell))
    nodes = [card.node_id for card in cell.card]
    for tick in (0, 3, 6):
        for node_id in nodes:
            supervisor.message(beat(node_id, OPERATIONAL), tick)
    for tick in range(7, 7 + TIMEOUT_CYCLES):
        assert supervisor.begin_cycle(tick) is None
    for node_id in nodes[1:]:
        supervisor.message(beat(node_id, OPERATIONAL), 46)
        assert supervisor.begin_cycle(46) is None


@pytest.mark.parametrize(
    ("state", "name"),
    [(BOOT_UP, "BOOT_UP"), (STOPPED, "STOPPED"), (PRE_OPERATIONAL, "PRE_OPERATIONAL"), (b"\x42", "0x42")],
)
def test_a_card_that_has_run_must_stay_operational(supervisor: Supervisor, state: bytes, name: str) -> None:
    all_beat(supervisor, 0)
    verdict = supervisor.message(beat(LATCH, state), 8)
    assert str(verdict) == f"card-state: card 'latch' (node 0x13) is in {name}, not OPERATIONAL"


def test_a_boot_up_counts_even_before_the_first_heartbeat(supervisor: Supervisor) -> None:
    assert supervisor.message(beat(LATCH, BOOT_UP), 1) is not None


def test_pre_operational_from_before_the_start_passes_but_is_no_sign_of_life(supervisor: Supervisor) -> None:
    for tick in range(TIMEOUT_CYCLES + 1):
        assert supervisor.message(beat(ADC, PRE_OPERATIONAL), tick) is None
        assert supervisor.begin_cycle(tick) is None
        for node_id in (DAC, LATCH):
            supervisor.message(beat(node_id, OPERATIONAL), tick)
    verdict = supervisor.begin_cycle(TIMEOUT_CYCLES + 1)
    assert str(verdict) == "heartbeat-lost: card 'adc' (node 0x14) not in OPERATIONAL after NMT start for 100 ms"


def test_emergencies_name_card_and_code(supervisor: Supervisor) -> None:
    verdict = supervisor.message(Emergency(0x8130, 0x11).frame(ADC), 0)
    assert str(verdict).startswith("card-emergency: card 'adc' (node 0x14) reports error 0x8130, it missed this")
    assert supervisor.message(Emergency(0, 0).frame(ADC), 0) is None
    assert supervisor.message(Frame(0x80 + ADC, bytes(7)), 0) is None


@pytest.mark.parametrize("can_id", [0x080, 0x701])
def test_sync_or_our_own_heartbeat_is_another_controller(supervisor: Supervisor, can_id: int) -> None:
    verdict = supervisor.message(Frame(can_id, OPERATIONAL), 0)
    assert verdict is not None
    assert verdict.detector == "foreign-master"


def test_inputs_may_miss_fifteen_cycles_in_a_row_but_not_sixteen(supervisor: Supervisor) -> None:
    for _ in range(3):
        assert [supervisor.missing("TPDO 0x294 of node 0x14", is_timed=False) for _ in range(15)] == [None] * 15
        assert supervisor.measurement([0.0, 0.0]) is None
    verdicts = [supervisor.missing("TPDO 0x294 of node 0x14", is_timed=False) for _ in range(16)]
    assert verdicts[:15] == [None] * 15
    assert str(verdicts[15]) == "inputs-missing: no TPDO 0x294 of node 0x14 for 16 cycles"


@pytest.mark.parametrize(("degrees", "is_possible"), [(132.9, True), (133.1, False), (-132.9, True), (-133.1, False)])
def test_a_joint_cannot_be_beyond_its_stops(supervisor: Supervisor, degrees: float, is_possible: bool) -> None:
    verdict = supervisor.measurement([0.0, math.radians(degrees)])
    assert (verdict is None) is is_possible
    assert verdict is None or verdict.detail.startswith("joint3 measured at")


def test_after_cycles_without_a_measurement_a_joint_may_have_gone_further(supervisor: Supervisor) -> None:
    supervisor.measurement([0.0, 0.0])
    supervisor.missing("TPDO 0x294 of node 0x14", is_timed=False)
    assert supervisor.measurement([math.radians(15.9), 0.0]) is None
    assert supervisor.measurement([math.radians(15.9 + 8.1), 0.0]) is not None


@pytest.mark.parametrize(("degrees", "is_possible"), [(7.9, True), (8.1, False), (-7.9, True), (-8.1, False)])
def test_a_joint_cannot_jump(supervisor: Supervisor, degrees: float, is_possible: bool) -> None:
    start = [0.5, -0.5]
    assert supervisor.measurement(start) is None
    verdict = supervisor.measurement([0.5 + math.radians(degrees), -0.5])
    assert (verdict is None) is is_possible
    assert verdict is None or verdict.detail.startswith("joint2 measured 28.6 deg, then")


def test_the_first_measurement_is_no_jump(supervisor: Supervisor) -> None:
    assert supervisor.measurement([2.0, -2.0]) is None


@pytest.mark.parametrize("torque", [[0.0, -3.5], (1, 2), np.array([0.5, 1e9])])
def test_finite_torques_for_every_joint_pass(supervisor: Supervisor, torque: Sequence[float]) -> None:
    assert supervisor.command(torque) is None


@pytest.mark.parametrize(
    ("torque", "detail"),
    [
        ([math.nan, 0.0], "the law asks for nan N m at joint2"),
        ([0.0, -math.inf], "the law asks for -inf N m at joint3"),
        ([0.0], "the law returned 1 torques for 2 joints"),
        (np.zeros(3), "the law returned 3 torques for 2 joints"),
        (None, "the law returned None; must be 2 torques in N m"),
        (1.0, "the law returned 1.0; must be 2 torques in N m"),
        ({0: 1.0, 1: 2.0}, "the law returned {0: 1.0, 1: 2.0}; must be 2 torques in N m"),
        (b"12", "the law returned b'12'; must be 2 torques in N m"),
        ([Decimal(1), Decimal(2)], "the law returned [Decimal('1'), Decimal('2')]; must be 2 torques in N m"),
        (["1", "2"], "the law returned ['1', '2']; must be 2 torques in N m"),
        ([1j, 0.0], "the law returned [1j, 0.0]; must be 2 torques in N m"),
        (np.zeros((2, 2)), "the law returned array([[0., 0.], [0., 0.]]); must be 2 torques in N m"),
        ([10**400, 0.0], f"the law returned [1{'0' * 78}; must be 2 torques in N m"),
    ],
)
def test_anything_else_that_a_law_returns_is_told_in_one_line(
    supervisor: Supervisor, torque: Sequence[float], detail: str
) -> None:
    verdict = supervisor.command(torque)
    assert verdict is not None
    assert (verdict.detector, verdict.detail) == ("law-output", detail)


CYCLE_NS, MS = 2_500_000, 1_000_000


def judge_times(supervisor: Supervisor, times_ns: Sequence[int]) -> list[str]:
    verdicts = [supervisor.time(time_frame(time_ns).data) for time_ns in times_ns]
    return [verdict.detector for verdict in verdicts if verdict is not None]


def test_times_a_cycle_apart_keep_it_quiet_over_midnight_too(supervisor: Supervisor) -> None:
    start_ns = 86_399_000 * MS + 600_000
    assert judge_times(supervisor, [start_ns + cycle * CYCLE_NS for cycle in range(800)]) == []


def test_the_end_of_a_cycle_may_wander_as_on_a_wire(supervisor: Supervisor) -> None:
    # Scan and two TPDOs take 0.8 ms; other traffic may delay them to the end of the cycle.
    ends_ns = np.random.default_rng(1).integers(800_000, CYCLE_NS, 2000).tolist()
    assert judge_times(supervisor, [800_000] + [n * CYCLE_NS + end for n, end in enumerate(ends_ns, 1)]) == []


@pytest.mark.parametrize("step_ms", [-1000, -1, 1004, 5000])
def test_a_time_far_from_the_next_cycle_is_foreign(supervisor: Supervisor, step_ms: int) -> None:
    times_ns = [2000 * MS + cycle * CYCLE_NS for cycle in range(101)]
    assert judge_times(supervisor, times_ns) == []
    verdict = supervisor.time(time_frame(times_ns[-1] + step_ms * MS).data)
    assert verdict is not None
    assert verdict.detector == "foreign-master"
    assert "TIME that does not belong to this cycle" in verdict.detail


@pytest.mark.parametrize("step_ms", [6, 600, 1002])
def test_a_time_ahead_of_the_cycles_says_by_how_much_its_sync_was_late(supervisor: Supervisor, step_ms: int) -> None:
    times_ns = [2000 * MS + cycle * CYCLE_NS for cycle in range(101)]
    late_ns = times_ns[-1] + step_ms * MS
    assert judge_times(supervisor, [*times_ns, late_ns]) == []
    assert supervisor.late_ns == step_ms * MS - CYCLE_NS
    assert judge_times(supervisor, [late_ns + cycle * CYCLE_NS for cycle in range(1, 100)]) == []
    assert supervisor.late_ns == 0


@pytest.mark.parametrize("ahead_ms", [6, 600])
def test_a_time_ahead_that_the_emulators_next_one_belies_was_foreign(supervisor: Supervisor, ahead_ms: int) -> None:
    times_ns = [2000 * MS + cycle * CYCLE_NS for cycle in range(101)]
    assert judge_times(supervisor, [*times_ns, times_ns[-1] + ahead_ms * MS]) == []
    assert judge_times(supervisor, [times_ns[-1] + CYCLE_NS]) == ["foreign-master"]


def test_a_time_too_many_is_found_after_a_late_one_as_well(supervisor: Supervisor) -> None:
    times_ns = [cycle * CYCLE_NS for cycle in range(11)]
    late_ns = times_ns[-1] + 20 * MS
    assert judge_times(supervisor, [*times_ns, late_ns]) == []
    assert set(judge_times(supervisor, [late_ns + cycle * CYCLE_NS for cycle in (0, 1, 2, 3)])) == {"foreign-master"}


def test_fifteen_late_cycles_in_a_row_pass_but_not_sixteen(supervisor: Supervisor) -> None:
    times_ns = [cycle * 10 * MS for cycle in range(17)]
    assert judge_times(supervisor, times_ns[:16]) == []
    verdict = supervisor.time(time_frame(times_ns[16]).data)
    assert str(verdict) == "deadline-missed: SYNC late in 16 cycles in a row"


@pytest.mark.parametrize("early_ms", [0, 1, 2, 3])
def test_a_time_too_many_is_found_within_three_cycles_even_if_it_fits(supervisor: Supervisor, early_ms: int) -> None:
    times_ns = [cycle * CYCLE_NS for cycle in range(101)]
    assert judge_times(supervisor, times_ns) == []
    after_ns = [times_ns[-1] + early_ms * MS, *(times_ns[-1] + cycle * CYCLE_NS for cycle in (1, 2, 3))]
    assert set(judge_times(supervisor, after_ns)) == {"foreign-master"}


def test_a_time_of_another_length_is_foreign(supervisor: Supervisor) -> None:
    verdict = supervisor.time(b"")
    assert verdict is not None
    assert "(0 bytes)" in verdict.detail
