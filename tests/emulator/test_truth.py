"""The keys of `--truth`: what they set, and how a wrong one is answered."""

import dataclasses
from typing import Any

import pytest

from canarm_emulator.errors import EmulatorError, TruthError
from canarm_emulator.robot.truth import JointTruth, Truth, truth_keys
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")


def test_nothing_set_means_the_nominal_robot() -> None:
    truth = Truth.from_settings(CELL)
    assert [joint.mass_kg for joint in truth.joints] == [1.0, 0.6]
    assert [joint.coulomb_friction_nm for joint in truth.joints] == [0.15, 0.06]
    assert [joint.initial_deg for joint in truth.joints] == [20.0, 0.0]
    assert not any(joint.has_elastic_wire for joint in truth.joints)
    assert (truth.adc.offset_lsb, truth.adc.gain_error, truth.adc.nonlinearity_lsb, truth.dac.nonlinearity) == (0,) * 4


def test_what_only_faults_set_is_absent_from_a_sound_robot() -> None:
    for joint in Truth.from_settings(CELL).joints:
        of_faults = [field for field in dataclasses.fields(joint) if field.default is not dataclasses.MISSING]
        assert {"payload_kg", "is_jammed", "wire_dead_band_rad", "wire_is_broken"} <= {each.name for each in of_faults}
        assert not any(getattr(joint, field.name) for field in of_faults)


def test_every_key_takes_its_own_nominal_value_and_changes_nothing() -> None:
    settings = {key.name: repr(key.nominal) for key in truth_keys(CELL)}
    assert Truth.from_settings(CELL, settings) == Truth.from_settings(CELL)


def flat(table: dict[str, Any], path: str = "") -> dict[str, Any]:
    """Every number of a truth by its path."""
    numbers: dict[str, Any] = {}
    for name, value in table.items():
        parts = value if isinstance(value, dict) else dict(enumerate(value)) if isinstance(value, tuple) else None
        numbers |= {f"{path}.{name}": value} if parts is None else flat(parts, f"{path}.{name}")
    return numbers


def test_every_key_reaches_a_field_of_its_own_and_the_joints_noise_all_its_sensors() -> None:
    nominal = flat(dataclasses.asdict(Truth.from_settings(CELL)))
    reached: dict[str, list[str]] = {}
    for key in truth_keys(CELL):
        value = key.maximum if key.maximum != key.nominal else key.minimum
        table = flat(dataclasses.asdict(Truth.from_settings(CELL, {key.name: repr(value)})))
        reached[key.name] = [path for path in table if table[path] != nominal[path]]
    noises = [reached.pop(f"{joint}.noise_lsb") for joint in CELL.joint_names]
    assert noises == [
        [f".joints.{joint}.sensors.{kind}_noise_lsb" for kind in ("potentiometer", "tachometer", "current_sense")]
        for joint in (0, 1)
    ]
    fields = [path for paths in reached.values() for path in paths]
    of_faults = [field.name for field in dataclasses.fields(JointTruth) if field.default is not dataclasses.MISSING]
    assert len(fields) == len(reached)
    of_faults.append("object")  # this cell has none
    assert set(fields) == {path for path in nominal if path.rsplit(".", 1)[1] not in of_faults}


def test_a_sensors_own_noise_goes_before_that_of_its_joint() -> None:
    settings = {"joint3.tachometer_noise_lsb": "2", "joint3.noise_lsb": "1"}
    sensors = Truth.from_settings(CELL, settings).joints[1].sensors
    noise = [sensors[f"{kind}_noise_lsb"] for kind in ("potentiometer", "tachometer", "current_sense")]
    assert noise == [1.0, 2.0, 1.0]


def test_a_setting_changes_only_its_joint() -> None:
    truth = Truth.from_settings(CELL, {"joint3.mass": "0.9", "joint2.wire": "1", "adc.offset_lsb": "-2"})
    assert [joint.mass_kg for joint in truth.joints] == [1.0, 0.9]
    assert [joint.has_elastic_wire for joint in truth.joints] == [True, False]
    assert truth.adc.offset_lsb == -2


def test_keys_carry_unit_nominal_value_and_description() -> None:
    keys = {key.name: key for key in truth_keys(CELL)}
    assert (keys["joint3.mass"].unit, keys["joint3.mass"].nominal) == ("kg", 0.6)
    assert (keys["joint2.initial_deg"].minimum, keys["joint2.initial_deg"].maximum) == (-130.0, 130.0)
    assert all(key.description for key in keys.values())


@pytest.mark.parametrize(
    ("given", "nearest"),
    [("joint3.mas", "joint3.mass"), ("joint2.colomb", "joint2.coulomb"), ("adc.offset", "adc.offset_lsb")],
)
def test_an_unknown_key_is_refused_with_the_nearest_one(given: str, nearest: str) -> None:
    with pytest.raises(TruthError, match=rf"--truth {given}=1: no such key; did you mean '{nearest}'\?"):
        Truth.from_settings(CELL, {given: "1"})


def test_an_unknown_key_like_none_points_to_the_list() -> None:
    with pytest.raises(TruthError, match="see `canarm check --keys`"):
        Truth.from_settings(CELL, {"q": "1"})


@pytest.mark.parametrize("value", ["heavy", "", "nan", "inf", "-0.6", "0"])
def test_a_mass_that_is_no_positive_number_is_refused(value: str) -> None:
    with pytest.raises(TruthError, match=rf"--truth joint3\.mass={value}: must be a number from 0\.001 to 1000 kg"):
        Truth.from_settings(CELL, {"joint3.mass": value})


@pytest.mark.parametrize("value", ["2", "0.5", "yes", "nan"])
def test_the_wire_switch_takes_0_or_1_only(value: str) -> None:
    with pytest.raises(TruthError, match=rf"joint2\.wire={value}: must be 0 or 1"):
        Truth.from_settings(CELL, {"joint2.wire": value})


def test_the_arm_cannot_be_parked_beyond_its_stops() -> None:
    with pytest.raises(TruthError, match=r"joint2\.initial_deg=131: must be a number from -130 to 130 deg"):
        Truth.from_settings(CELL, {"joint2.initial_deg": "131"})


def test_all_problems_are_reported_at_once_a_line_each() -> None:
    with pytest.raises(EmulatorError) as caught:
        Truth.from_settings(CELL, {"joint3.mas": "1", "joint2.mass": "-1", "joint2.wire": "1"})
    assert len(str(caught.value).splitlines()) == 2
