"""Keys of a cell that the command line sets: what they reach, and what is said of wrong ones."""

import pytest

from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.cell.control import (
    JointMrasGains,
    JointMrasLyapunovGains,
    JointSlotineLiGains,
    MrasGains,
    MrasLyapunovGains,
    SlotineLiGains,
)
from canarm_protocol.cell.settings import setting_keys
from canarm_protocol.errors import CellError

TEXT = shipped_cells()["konkuk1"]


def setting_complaint(key: str, value: str) -> str:
    with pytest.raises(CellError) as caught:
        load_cell("konkuk1", {key: value})
    return str(caught.value)


def test_keys_of_the_command_line_are_laid_over_the_file() -> None:
    cell = load_cell("konkuk1", {"control.mras.gamma_bias": "10", "supervision.missing_cycles": "5"})
    assert cell.control.mras.gamma_bias == 10.0
    assert isinstance(cell.control.mras.gamma_bias, float)
    assert cell.supervision.missing_cycles == 5


def test_every_key_that_set_takes_is_listed_with_its_nominal_value() -> None:
    keys = setting_keys(load_cell("konkuk1"))
    assert keys["control.natural_frequency_rad_s"] == 12.0
    assert keys["supervision.missing_cycles"] == 16
    for key, value in keys.items():
        load_cell("konkuk1", {key: str(value).lower()})


OWN_GAINS = """[[control.joint]]
name = "joint3"
damping_ratio = 0.8
mras = { gamma_bias = 25.0 }
slotine_li = { error_rate_rad_s = 15.0 }

[supervision]"""


def test_a_single_gain_of_a_joint_leaves_its_others_as_in_the_cell() -> None:
    cell = parse_cell(TEXT.replace("[supervision]", OWN_GAINS, 1), "my.toml")
    whole, own = cell.control, cell.control.of_joint("joint3")
    assert cell.control.of_joint("joint2") == whole
    assert own.damping_ratio == 0.8
    assert own.mras == whole.mras.model_copy(update={"gamma_bias": 25.0})
    assert whole.slotine_li is not None
    assert own.slotine_li == whole.slotine_li.model_copy(update={"error_rate_rad_s": 15.0})
    assert own.mras_lyapunov == whole.mras_lyapunov


def test_set_reaches_the_gains_of_a_joint_whether_its_table_is_there_or_not() -> None:
    settings = {"control.joint3.mras.gamma_alpha": "0.01", "control.joint2.natural_frequency_rad_s": "9"}
    cell = parse_cell(TEXT.replace("[supervision]", OWN_GAINS, 1), "my.toml", settings)
    own = cell.control.of_joint("joint3")
    assert (own.mras.gamma_alpha, own.mras.gamma_bias, own.damping_ratio) == (0.01, 25.0, 0.8)
    assert cell.control.of_joint("joint2").natural_frequency_rad_s == 9.0
    assert setting_keys(cell)["control.joint3.mras.gamma_alpha"] == 0.01


def test_joints_of_several_robots_go_by_their_names_in_the_whole_cell() -> None:
    name = load_cell("rhino-pair").joint_names[-1]
    cell = load_cell("rhino-pair", {f"control.{name}.damping_ratio": "0.9"})
    assert [each.name for each in cell.control.joint] == [name]


def test_gains_of_a_joint_have_the_names_and_limits_of_the_cells() -> None:
    tables = ((JointMrasGains, MrasGains), (JointMrasLyapunovGains, MrasLyapunovGains))
    for own, whole in tables:
        assert list(own.model_fields) == list(whole.model_fields)
    assert set(JointSlotineLiGains.model_fields) < set(SlotineLiGains.model_fields)


def test_gains_of_a_law_without_a_table_of_the_cell_are_refused() -> None:
    begin, end = TEXT.index("[control.slotine_li]"), TEXT.index("[control.observer]")
    text = (TEXT[:begin] + TEXT[end:]).replace("[supervision]", OWN_GAINS, 1)
    with pytest.raises(CellError, match=r"control.joint 'joint3'.slotine_li: the cell has no \[control.slotine_li\]"):
        parse_cell(text, "my.toml")


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        (
            "control.joint4.damping_ratio",
            "1",
            "--set control.joint4.damping_ratio=1: no such key (see `canarm check --keys`); did you mean 'joint3'?",
        ),
        (
            "control.joint3.slotine_li.adaptation",
            "1",
            "--set control.joint3.slotine_li.adaptation=1: no such key (see `canarm check --keys`); "
            "known are error_rate_rad_s, sliding_rate_rad_s",
        ),
        (
            "control.joint3",
            "1",
            "--set control.joint3=1: is a table; set one of its keys, natural_frequency_rad_s, damping_ratio, mras, "
            "mras_lyapunov, slotine_li",
        ),
        (
            "control.joint3.damping_ratio",
            "-1",
            "cell konkuk1 with --set: control.joint 'joint3'.damping_ratio = -1: must be greater than 0",
        ),
        (
            "control.joint.damping_ratio",
            "1",
            "--set control.joint.damping_ratio=1: no such key (see `canarm check --keys`); did you mean 'joint3'?",
        ),
        (
            "control.natural_freq",
            "3",
            "--set control.natural_freq=3: no such key (see `canarm check --keys`); "
            "did you mean 'natural_frequency_rad_s'?",
        ),
        (
            "control.mras.gamma",
            "3",
            "--set control.mras.gamma=3: no such key (see `canarm check --keys`); did you mean 'gamma_bias'?",
        ),
        (
            "bus.cycle_us",
            "3",
            "--set bus.cycle_us=3: keys begin with 'control.', 'supervision.' or 'object.'; see `canarm check --keys`",
        ),
        (
            "control",
            "3",
            "--set control=3: keys begin with 'control.', 'supervision.' or 'object.'; see `canarm check --keys`",
        ),
        ("control.damping_ratio", "abc", "--set control.damping_ratio=abc: 'abc' is not a value such as 1.0"),
        ("control.damping_ratio", "1,5", "--set control.damping_ratio=1,5: '1,5' is not a value such as 1.0"),
        (
            "control.damping_ratio",
            "1\nx = 2",
            r"--set control.damping_ratio=1\nx = 2: '1\nx = 2' is not a value such as 1.0",
        ),
        ("supervision.missing_cycles", "", "--set supervision.missing_cycles=: '' is not a value such as 16"),
        (
            "control.damping_ratio",
            "-1",
            "cell konkuk1 with --set: control.damping_ratio = -1: must be greater than 0",
        ),
        (
            "supervision.missing_cycles",
            "2.5",
            "cell konkuk1 with --set: supervision.missing_cycles = 2.5: must be a whole number",
        ),
        ("control.damping_ratio", "true", "cell konkuk1 with --set: control.damping_ratio = true: must be a number"),
    ],
)
def test_a_wrong_key_of_the_command_line_is_named(key: str, value: str, complaint: str) -> None:
    assert setting_complaint(key, value) == complaint


def test_a_table_cannot_be_set_whole() -> None:
    complaint = setting_complaint("control.mras", "3")
    assert complaint.startswith("--set control.mras=3: is a table; set one of its keys, gamma_alpha, gamma_beta,")


@pytest.mark.parametrize(
    ("written", "meant"), [("True", True), ("true", True), ("1", True), ("False", False), ("0", False)]
)
def test_a_switch_of_the_controller_may_be_written_in_any_way(written: str, meant: bool) -> None:
    key = next(name for name, value in setting_keys(load_cell("konkuk1")).items() if isinstance(value, bool))
    cell = load_cell("konkuk1", {key: written})
    assert setting_keys(cell)[key] is meant


PAIR = load_cell("rhino-pair").joint_names


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("elbow", "'master_elbow' or 'slave_elbow'"),
        ("slave.elbow", "'slave_elbow'"),
        ("slave-elbow", "'slave_elbow'"),
        ("elbow_slave", "'slave_elbow'"),
        ("slave_elbo", "'slave_elbow'"),
        ("slaev_elbow", "'slave_elbow'"),
        ("Master_Elbow", "'master_elbow'"),
    ],
)
def test_a_joint_of_two_robots_is_suggested_for_the_robot_that_was_named_or_for_both(word: str, meant: str) -> None:
    assert nearest(word, PAIR) == f"; did you mean {meant}?"
    taps = [f"{joint}.{leaf}" for joint in PAIR for leaf in ("motor", "link", "encoder")]
    with_leaf = meant.replace("elbow'", "elbow.motor'")
    assert nearest(f"{word}.motor", taps) == f"; did you mean {with_leaf}?"


def test_set_suggests_the_joint_of_the_robot_that_was_named() -> None:
    with pytest.raises(CellError, match="did you mean 'slave_elbow'"):
        load_cell("rhino-pair", {"control.slave.elbow.damping_ratio": "1"})
    with pytest.raises(CellError, match="did you mean 'master_elbow' or 'slave_elbow'"):
        load_cell("rhino-pair", {"control.elbow.damping_ratio": "1"})
