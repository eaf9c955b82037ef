"""The control loop by itself: codes in, DAC codes and direction bits out, and laws that fail."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from canarm_controller.errors import ControllerError, LawError, TrajectoryError
from canarm_controller.laws import ControlLaw, Cycle, load_law
from canarm_controller.reference.trajectory import make_trajectory
from canarm_controller.run.loop import ControlLoop
from canarm_controller.run.state import State
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import CARD_TYPES, Cell
from canarm_protocol.cell.wiring import card_nodes, input_slots

# Places of konkuk1's codes: potentiometers 2 and 3, tachometers 2 and 3, current senses 2 and 3.
HOME = [146, 128]
STEP_DEG, STEP_RAD_S, STEP_A = 270 / 255, 5 / 255, 1.5 / 255
CONVERSION_S = 100e-6
K2, K3 = 0.08 * 60 * 0.85, 0.08 * 40 * 0.85


class Asks(ControlLaw):
    """Asks for what the test says."""

    name = "asks"
    wanted: Sequence[float] = (0.0, 0.0)

    def __init__(self, arm: object, control: object, period_s: float) -> None:
        self.started: tuple[object, ...] = ()

    def start(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
    ) -> None:
        self.started = (position_rad, velocity_rad_s, amplitude_rad)

    def update(self, cycle: Cycle) -> Sequence[float]:
        return self.wanted


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell("konkuk1")


def make_loop(
    cell: Cell, law: type[ControlLaw] = Asks, feedforward: str | None = None, trajectory: str = "sine"
) -> ControlLoop:
    slots = input_slots(cell, card_nodes(cell))
    return ControlLoop(cell, slots, law, make_trajectory(trajectory, cell), feedforward)


@pytest.fixture
def loop(cell: Cell) -> ControlLoop:
    return make_loop(cell)


def test_codes_become_angles_speeds_and_currents(loop: ControlLoop) -> None:
    loop.measure([146, 100, 128, 102, 255, 51], 0)
    cycle = loop.cycle
    # 2.5 V of 5 V is 0 degrees and 0 rad/s: code 127.5.
    assert cycle.velocity_rad_s == pytest.approx([0.5 * STEP_RAD_S, -0.5])
    assert cycle.position_rad == pytest.approx(
        [math.radians(18.5 * STEP_DEG), math.radians(-27.5 * STEP_DEG) + CONVERSION_S * 0.5]
    )


def test_positions_are_led_back_to_the_sync_by_the_measured_speed(loop: ControlLoop) -> None:
    loop.measure([128, 128, 255, 0, 0, 0], 0)
    cycle = loop.cycle
    assert cycle.velocity_rad_s == pytest.approx([2.5, -2.5])
    # Channel 1 is converted at SYNC itself, channel 2 a conversion of 100 us later.
    at_sync = math.radians(0.5 * STEP_DEG)
    assert cycle.position_rad == pytest.approx([at_sync, at_sync + CONVERSION_S * 2.5])


def test_the_sense_measures_a_magnitude_and_the_last_command_gives_its_sign(loop: ControlLoop) -> None:
    loop.outputs([-1.0, 1.0])
    loop.measure([128, 128, 128, 128, 100, 50], 0)
    assert loop.cycle.current_a == pytest.approx([-100 * STEP_A, 50 * STEP_A])


@pytest.mark.parametrize(
    ("torque", "codes", "directions"),
    [
        ([0.0, 0.0], [0, 0], [0b00, 0b00]),
        ([K2 * 0.75, -K3 * 0.3], [round(0.75 / STEP_A), 51], [0b10, 0b01]),
        ([K2 * 1.5, -K3 * 1.5], [255, 255], [0b10, 0b01]),
        ([1e9, -1e9], [255, 255], [0b10, 0b01]),
        ([K2 * STEP_A * 0.49, -K3 * STEP_A * 0.49], [0, 0], [0b00, 0b00]),
        ([K2 * STEP_A * 0.51, -K3 * STEP_A * 0.51], [1, 1], [0b10, 0b01]),
    ],
)
def test_torques_become_codes_of_1_5_a_on_255_steps_and_directions(
    loop: ControlLoop, torque: list[float], codes: list[int], directions: list[int]
) -> None:
    # Table 1: 00 off, 01 clockwise (negative), 10 counter-clockwise.
    assert loop.outputs(torque) == (codes, directions)


def test_a_torque_beyond_the_amplifier_is_limited_counted_and_told_to_the_law(loop: ControlLoop) -> None:
    loop.outputs([K2 * 1.5, K3 * 1.0])
    assert (loop.saturated_cycles, list(loop.cycle.saturated)) == ([0, 0], [False, False])
    loop.outputs([K2 * 1.6, K3 * -1.6])
    loop.outputs([K2 * -5.0, K3 * 0.1])
    assert (loop.saturated_cycles, list(loop.cycle.saturated)) == ([2, 1], [True, False])
    assert loop.cycle.applied_nm == pytest.approx([K2 * -1.5, K3 * 0.1])


def test_the_law_starts_at_rest_at_the_measured_pose_and_so_does_the_reference(loop: ControlLoop) -> None:
    loop.begin(HOME)
    measured = [math.radians((146 - 127.5) * STEP_DEG), math.radians(0.5 * STEP_DEG)]
    position, velocity, amplitude = loop.law.started
    assert position == pytest.approx(measured)
    assert tuple(velocity) == (0.0, 0.0)
    assert amplitude == pytest.approx([math.radians(35), math.radians(30)])
    loop.look_up(0)
    assert loop.cycle.reference_rad == pytest.approx(measured)
    assert loop.cycle.reference_rad_s == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("tick", [0, 1, 63, 64, 800, 4095, 4096, 4097, 8191, 8192, 100_000])
def test_the_reference_of_any_tick_is_the_trajectory_there(loop: ControlLoop, tick: int) -> None:
    loop.begin(HOME)
    loop.look_up(tick)
    cycle, time_s = loop.cycle, tick * 0.0025
    if time_s >= 2.0:  # blended in
        expected = [
            math.radians(20 + 35 * math.sin(2 * math.pi * time_s / 2.56)),
            math.radians(30 * math.sin(2 * math.pi * time_s / 1.7)),
        ]
        assert cycle.reference_rad == pytest.approx(expected, abs=1e-9)
    row = loop.trajectory.sample(tick, 1, 0.0025)
    assert cycle.reference_rad == tuple(row.position_rad[0].tolist())
    assert cycle.reference_rad_s == tuple(row.velocity_rad_s[0].tolist())
    assert cycle.reference_rad_s2 == tuple(row.acceleration_rad_s2[0].tolist())


def test_ticks_may_be_looked_up_in_any_order(loop: ControlLoop) -> None:
    loop.begin(HOME)
    expected = {tick: loop.trajectory.sample(tick, 1, 0.0025).position_rad[0].tolist() for tick in (5000, 70, 4095, 0)}
    for tick, position in expected.items():
        loop.look_up(tick)
        assert list(loop.cycle.reference_rad) == position


def test_feed_forward_is_what_the_nominal_arm_needs_when_the_command_acts(cell: Cell) -> None:
    torques = {}
    for kind in ("none", "table", "online"):
        loop = make_loop(cell, feedforward=kind)
        loop.begin(HOME)
        rows = []
        for tick in range(1000, 1400):
            loop.look_up(tick)
            loop.torque_nm()
            rows.append(loop.cycle.feedforward_nm)
        torques[kind] = np.array(rows)
    assert not torques["none"].any()
    # A table byte resolves two steps of the DAC; the rest is rounding.
    step_nm = 2 * STEP_A * np.array([K2, K3])
    assert (np.abs(torques["table"] - torques["online"]) <= 0.5 * step_nm + 1e-9).all()
    # A command computed in cycle k acts from k+1 to k+2: on the sine's long legs that is the torque 1.5 cycles later.
    later = loop.trajectory.sample(1000, 400, 0.0025)
    plain = loop.arm.torque_batch_nm(later.position_rad, later.velocity_rad_s, later.acceleration_rad_s2)
    lead = 0.5 * (plain[1:-1] + plain[2:])
    calm = (np.abs(later.velocity_rad_s[1:-1]) > 0.2).all(axis=1)  # away from the jump of Coulomb friction
    without_lead_nm = np.abs(plain[:-2] - lead)[calm].max()
    assert np.abs(torques["online"][:-2] - lead)[calm].max() < 0.5 * without_lead_nm


def test_an_unknown_feed_forward_is_refused(cell: Cell) -> None:
    with pytest.raises(ControllerError, match="tabel"):
        make_loop(cell, feedforward="tabel")


@pytest.mark.parametrize(("codes", "pose"), [([255, 128], "135"), ([146, 0], "-135")])
def test_a_start_beyond_the_limits_is_refused(loop: ControlLoop, codes: list[int], pose: str) -> None:
    with pytest.raises(TrajectoryError, match=rf"start from .*{pose}.*outside limits_deg"):
        loop.begin(codes)


@pytest.mark.parametrize(
    ("pose_deg", "blend_s"), [((20, 0), 2.0), ((-90, 0), 2.0), ((20, 120), 3.0), ((20, -130), 4.5)]
)
def test_a_start_far_off_is_blended_in_slower_and_stays_within_the_tachometer(
    loop: ControlLoop, pose_deg: tuple[float, float], blend_s: float
) -> None:
    loop.begin([round(127.5 + degrees / STEP_DEG) for degrees in pose_deg])
    block = loop.trajectory.sample(0, 4096, 0.0025)
    assert np.abs(block.velocity_rad_s).max() <= 2.5
    plain = make_trajectory("sine", load_cell("konkuk1")).sample(0, 4096, 0.0025).position_rad
    joined_s = 0.0025 * (np.flatnonzero(np.abs(block.position_rad - plain).max(axis=1) > 1e-12)[-1] + 1)
    assert joined_s == pytest.approx(blend_s, abs=0.1)


# A user's law that fails

LAW = """\
from canarm_controller.laws import ControlLaw

class Mine(ControlLaw):
    name = "mine"
    def __init__(self, arm, control, period_s):
        {init}
    def start(self, position_rad, velocity_rad_s, amplitude_rad):
        {start}
    def update(self, cycle):
        {update}
        return [0.0, 0.0]
    def internals(self):
        return {internals}
"""


def write_law(
    folder: Path, init: str = "pass", start: str = "pass", update: str = "pass", internals: str = "{}"
) -> type[ControlLaw]:
    path = folder / "mine.py"
    path.write_text(LAW.format(init=init, start=start, update=update, internals=internals))
    return load_law(f"{path}:Mine")


def test_a_law_that_cannot_be_made_is_told_with_its_line(cell: Cell, tmp_path: Path) -> None:
    law = write_law(tmp_path, init="self.gain = 1 / 0")
    with pytest.raises(LawError, match=r"law Mine: __init__ .* fails at mine\.py, line 6: ZeroDivisionError: division"):
        make_loop(cell, law)


def test_a_law_that_cannot_start_is_told_with_its_line(cell: Cell, tmp_path: Path) -> None:
    loop = make_loop(cell, write_law(tmp_path, start="self.no_such_thing"))
    with pytest.raises(
        LawError, match=r"law Mine: start\(\) fails at mine\.py, line 8: AttributeError: .*no_such_thing"
    ):
        loop.begin(HOME)


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("raise ValueError('two\\nlines')", "ValueError: two lines"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("assert False", "AssertionError"),
        ("raise GeneratorExit", "GeneratorExit"),
        ("raise type('Own', (BaseException,), {})('x\\x1b')", r"Own: x\\x1b"),
        (
            "raise type('Mute', (Exception,), {'__str__': None})",
            "Mute: .*cannot be had: TypeError.*",
        ),
        ("import math; math.sqrt('x')", "TypeError: must be real number, not str"),
        ("import json; json.loads('{')", "JSONDecodeError: Expecting property name.*"),
    ],
)
def test_a_law_that_fails_in_a_cycle_is_told_with_the_line_of_its_own_file(
    cell: Cell, tmp_path: Path, statement: str, message: str
) -> None:
    loop = make_loop(cell, write_law(tmp_path, update=statement))
    loop.begin(HOME)
    loop.look_up(0)
    with pytest.raises(LawError, match=rf"^law Mine: update\(\) fails at mine\.py, line 10: {message}$"):
        loop.torque_nm()


def test_an_error_of_our_own_passes_as_it_is(cell: Cell, tmp_path: Path) -> None:
    error = "from canarm_controller.errors import ControllerError; raise ControllerError('needs 3 joints')"
    with pytest.raises(ControllerError, match=r"^needs 3 joints$"):
        make_loop(cell, write_law(tmp_path, init=error))


@pytest.mark.parametrize(
    "later",
    [{"a": [1.0]}, {"a": [1.0, 2.0, 3.0]}, {"b": [1.0, 2.0]}, {}, {"a": ["x", "y"]}, {"a": None}, {"a": 1.0}],
    ids=str,
)
def test_internals_that_do_not_fit_are_refused(cell: Cell, tmp_path: Path, later: Mapping[str, object]) -> None:
    loop = make_loop(cell, write_law(tmp_path, internals="{'a': [0.0, 0.0]}"))
    assert loop.internal_names == ("a",)
    loop.law.internals = lambda: later
    with pytest.raises(LawError, match=r"law Mine: internals\(\)"):
        loop.internals()


@pytest.mark.parametrize(
    ("text", "detector", "detail"),
    [
        ("return [float('nan'), 0.0]", "law-output", "the law asks for nan N m at joint2"),
        ("return [0.0]", "law-output", "1 torques for 2 joints"),
        ("return None", "law-output", "the law returned None"),
        ("return {0: 0.0, 1: 0.0}", "law-output", "the law returned {0: 0.0, 1: 0.0}; must be 2 torques"),
        ("return (0.0 for _ in range(2))", "law-output", "the law returned <generator object"),
        ("return '12'", "law-output", "the law returned '12'"),
        ("return [type('Mute', (), {'__repr__': None})(), 0.0]", "law-output", "(a list whose text cannot be had"),
        ("raise ValueError('no')", "law-failed", "law Mine: update() fails at mine.py, line 10: ValueError: no"),
        ("raise GeneratorExit", "law-failed", "law Mine: update() fails at mine.py, line 10: GeneratorExit"),
        ("raise KeyboardInterrupt", "interrupted", "KeyboardInterrupt in update() of law Mine"),
    ],
)
def test_a_law_that_fails_in_a_run_ends_in_a_safe_stop(
    make_pair, tmp_path: Path, text: str, detector: str, detail: str
) -> None:
    write_law(tmp_path, init="self.n = 0", update=f"self.n += 1\n        if self.n > 100: {text}")
    detail = detail.replace("line 10", "line 11")
    pair = make_pair(law=f"{tmp_path / 'mine.py'}:Mine")
    pair.run_to_end()
    verdict = pair.controller.verdict
    assert (verdict.detector, pair.controller.controlled_ticks) == (detector, 100)
    assert detail in verdict.detail
    assert [joint.command_a for joint in pair.bench.world.state()] == [0.0, 0.0]


def test_internals_that_fail_in_a_run_end_in_a_safe_stop(make_pair, tmp_path: Path) -> None:
    write_law(tmp_path, internals="{'a': [0.0, 0.0]}")
    pair = make_pair(law=f"{tmp_path / 'mine.py'}:Mine")
    loop = pair.controller.loop

    def tell() -> None:
        if pair.controller.tick == 50:
            loop.law.internals = lambda: 1 / 0
        loop.internals()

    pair.controller.on_tick = tell
    pair.run_to_end()
    assert pair.controller.verdict.detector == "law-failed"
    assert "internals() fails" in pair.controller.verdict.detail


def test_a_law_with_a_model_of_its_own_takes_no_feed_forward(cell: Cell) -> None:
    with pytest.raises(ControllerError, match="'slotine-li' supplies the torque of the model itself"):
        make_loop(cell, load_law("slotine-li"), "table")


@pytest.mark.parametrize("name", ["1", "'a,b'", "'a\"b'", "'a\\nb'", "'α'", "''", "'a b'"])
def test_names_of_internals_are_ascii_identifiers(cell: Cell, tmp_path: Path, name: str) -> None:
    law = write_law(tmp_path, internals=f"{{{name}: [0.0, 0.0]}}")
    with pytest.raises(
        LawError, match=r"^law Mine: internals\(\) names a value .*; names must be ASCII letters"
    ) as caught:
        make_loop(cell, law)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("given", ["None", "['bias_a']", "5"])
def test_internals_that_are_no_dict_are_told_to_be_one(cell: Cell, tmp_path: Path, given: str) -> None:
    law = write_law(tmp_path, internals=given)
    with pytest.raises(LawError) as caught:
        make_loop(cell, law)
    assert str(caught.value).startswith(f"law Mine: internals() returned {given}; must be a dict")


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("raise GeneratorExit", r"^law Mine: start\(\) fails at mine\.py, line 8: GeneratorExit$"),
        ("raise KeyboardInterrupt", r"^KeyboardInterrupt in start\(\) of law Mine$"),
    ],
)
def test_a_law_that_cannot_start_ends_the_bring_up(make_pair, tmp_path: Path, statement: str, message: str) -> None:
    write_law(tmp_path, start=statement)
    pair = make_pair(law=f"{tmp_path / 'mine.py'}:Mine")
    pair.run_to_end()
    assert re.search(message, pair.controller.reason)
    assert [frame.can_id for frame in pair.sent[-6:]] == [0] * 6


CYCLE_VALUES = [
    *("reference_rad", "reference_rad_s", "reference_rad_s2", "position_rad", "velocity_rad_s"),
    *("current_a", "feedforward_nm", "applied_nm", "saturated"),
]


def test_a_law_cannot_change_what_it_is_judged_by(make_pair, tmp_path: Path) -> None:
    spoil = f"""for name in {CYCLE_VALUES}:
            assert type(getattr(cycle, name)) is tuple, name
            setattr(cycle, name, (9.0, 9.0))
        cycle.tick = 7"""
    write_law(tmp_path, update=spoil)
    spoilt, honest = make_pair(law=f"{tmp_path / 'mine.py'}:Mine"), make_pair(law=f"{tmp_path / 'mine.py'}:Mine")
    honest.controller.loop.law.update = lambda cycle: [0.0, 0.0]
    rows: list[list[object]] = []
    for pair in (spoilt, honest):
        cycle, seen = pair.controller.loop.cycle, []
        rows.append(seen)
        pair.controller.on_tick = lambda cycle=cycle, seen=seen: seen.append(
            (cycle.tick, *[getattr(cycle, name) for name in CYCLE_VALUES])
        )
        pair.run_to_tick(60)
    assert spoilt.controller.state is State.RUNNING, spoilt.controller.reason
    assert rows[0] == rows[1]
    assert rows[0][59][0] == 59


def test_a_table_of_bytes_is_not_what_a_finer_dac_is_fed_from(cell: Cell) -> None:
    """Unless somebody asks for it: 7 bits of magnitude, where a 12-bit DAC has 12."""
    cards = tuple(
        CARD_TYPES["dac"].model_validate({**card.model_dump(exclude_unset=True), "model": "dac", "bits": 12})
        if card.name == "dac"
        else card
        for card in cell.card
    )
    fine = cell.model_copy(update={"card": cards})
    assert make_loop(cell, load_law("mras")).feedforward_kind == "table"
    assert make_loop(fine, load_law("mras")).feedforward_kind == "online"
    assert make_loop(fine, load_law("mras"), "table").feedforward_kind == "table"
    assert make_loop(fine, load_law("pd")).feedforward_kind == "none"
