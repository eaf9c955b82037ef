"""A wrong cell is answered with one line a problem: file, key, value, and what would be right."""

import math
import os
import re

import pytest

from canarm_protocol.cards import KINDS
from canarm_protocol.cell.cell_checks import MOST_JOINTS, problems
from canarm_protocol.cell.cell_file import load_cell, parse_cell, shipped_cells
from canarm_protocol.cell.robot_checks import joint_problems
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.errors import CellError, ProtocolError

MODELS = list(KINDS)
TEXT = shipped_cells()["konkuk1"]
LATCH_JOINT3 = '{ number = 2, signal = "joint3.direction" }'


def complaints(old: str, new: str) -> list[str]:
    """What is said of konkuk1 with the first `old` replaced by `new`."""
    assert old in TEXT
    with pytest.raises(CellError) as caught:
        parse_cell(TEXT.replace(old, new, 1), "my.toml")
    return str(caught.value).splitlines()


def test_every_shipped_cell_is_valid_and_named_as_its_file() -> None:
    for name in shipped_cells():
        assert load_cell(name).name == name


def test_konkuk1_has_the_nominal_parameters_of_the_paper() -> None:
    cell = load_cell("konkuk1")
    assert cell.bus.cycle_ns == 2_500_000
    assert cell.bus.cycle_s == 2.5e-3
    assert [joint.motor.torque_per_ampere for joint in cell.joints] == pytest.approx([4.08, 2.72])
    assert [joint.motor.reflected_inertia_kg_m2 for joint in cell.joints] == pytest.approx([0.054, 0.024])
    assert [card.node_id for card in cell.card] == [0x12, 0x13, 0x14]


def test_a_cell_is_read_from_a_file(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace("cycle_us = 2500", "cycle_us = 5000"), encoding="utf-8")
    assert load_cell(str(path)).bus.cycle_us == 5000


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("bitrate = 1_000_000", "", "bus.bitrate: is missing"),
        (
            "bitrate = 1_000_000",
            "bitrate = 300_000",
            "bus.bitrate = 300000: must be 10000, 20000, 50000, 125000, 250000, 500000, 800000 or 1000000",
        ),
        ("cycle_us = 2500", 'cycle_us = "2500"', 'bus.cycle_us = "2500": must be a whole number'),
        ("cycle_us = 2500", "cycle_us = 2500.5", "bus.cycle_us = 2500.5: must be a whole number"),
        ("cycle_us = 2500", "cycle_us = true", "bus.cycle_us = true: must be a whole number"),
        ("cycle_us = 2500", "cycle_us = 10", "bus.cycle_us = 10: must be at least 500"),
        ("slot = 3", "slot = 8", "card 'latch'.slot = 8: must be at most 7"),
        ("node_id = 0x13", "node_id = 200", "card 'latch'.node_id = 0xC8: node-IDs are 0x01 to 0x7F"),
        ("node_id = 0x13", "node_id = 0", "card 'latch'.node_id = 0x00: node-IDs are 0x01 to 0x7F"),
        (
            "mass_kg = 1.0",
            "mass_kg = -1.0",
            "robot 'konkuk1'.joint 'joint2'.link.mass_kg = -1.0: must be greater than 0",
        ),
        ("mass_kg = 1.0", 'mass_kg = "1"', "robot 'konkuk1'.joint 'joint2'.link.mass_kg = \"1\": must be a number"),
        ("home_deg = 20.0", "home_deg = nan", "robot 'konkuk1'.joint 'joint2'.home_deg = nan: must be a finite number"),
        (
            "[0.0, 2.7e-3, 2.7e-3]",
            "[0.0, 2.7e-3]",
            "robot 'konkuk1'.joint 'joint2'.link.inertia_kg_m2 = [0.0, 0.0027]: element 3 is missing",
        ),
        (
            "[0.0, 2.7e-3, 2.7e-3]",
            "3.0",
            "robot 'konkuk1'.joint 'joint2'.link.inertia_kg_m2 = 3.0: must be an array, [...]",
        ),
        ("[bus]", "[[bus]]", "bus = [{...}]: must be a table"),
        (
            'name = "konkuk1"',
            'name = "Konkuk 1"',
            "name = \"Konkuk 1\": must be lower-case letters, digits, '-' and '_', beginning with a letter, at most 32",
        ),
        ('title = "KON', 'title = 5 # "KON', 'title = 5: must be text in "quotes"'),
        (
            'model = "sc300"',
            'model = "sc30"',
            f"card 'latch'.model = \"sc30\": must be {', '.join(map(repr, MODELS[:-1]))} or {MODELS[-1]!r}",
        ),
        (
            "joint3.direction",
            "Joint 3",
            "card 'latch'.channel 2.signal = \"Joint 3\": "
            'must be "<joint>.<command or sensor>", such as "joint2.potentiometer"',
        ),
    ],
)
def test_a_wrong_value_is_named_with_its_key_and_what_would_be_right(old: str, new: str, complaint: str) -> None:
    assert complaints(old, new) == [f"my.toml: {complaint}"]


@pytest.mark.parametrize(
    ("old", "new", "lines"),
    [
        (
            "cycle_us = 2500",
            "cycle_uss = 2500",
            ["bus.cycle_us: is missing", "bus.cycle_uss: unknown key; did you mean 'cycle_us'?"],
        ),
        ("[physics]", "[fysics]", ["physics: is missing", "fysics: unknown table; did you mean 'physics'?"]),
        (
            "max_step_us = 650",
            "max_step_us = 650\nqq = 1",
            ["physics.qq: unknown key; known are max_step_us"],
        ),
        (
            "node_id = 0x13",
            "node_id = 0x13\nspeed = 1",
            [
                "card 'latch'.speed: unknown key; known are name, model, robot, slot, node_id, channel",
            ],
        ),
        (
            "node_id = 0x14",
            "node_id = 0x14\nbits = 12",
            ["card 'adc'.bits: unknown key of this model; a card of model 'adc' has it"],
        ),
    ],
)
def test_an_unknown_key_comes_with_the_nearest_known_one(old: str, new: str, lines: list[str]) -> None:
    assert complaints(old, new) == [f"my.toml: {line}" for line in lines]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (
            "node_id = 0x13",
            "node_id = 0x12",
            "card 'latch'.node_id = 0x12: card 'dac' has it already; by slot it would be 0x13",
        ),
        (
            "node_id = 0x13",
            "node_id = 1",
            "card 'latch'.node_id = 0x01: is bus.controller_node_id; by slot it would be 0x13",
        ),
        ("slot = 3", "slot = 2", "card 'latch'.slot = 2: card 'dac' of the same robot is there; slots are 1 to 7"),
        ('name = "latch"', 'name = "dac"', "card.name = 'dac': is used 2 times; each must be unique"),
        (
            'robot = "konkuk1"\nslot = 3',
            'robot = "konkuk2"\nslot = 3',
            "card 'latch'.robot = \"konkuk2\": no such robot; this cell has konkuk1",
        ),
        (
            '"joint3.current_command"',
            '"joint2.current_command"',
            "card 'dac'.channel 2.signal = \"joint2.current_command\": "
            "is wired to card 'dac'.channel 1 already; wire it once",
        ),
        (
            LATCH_JOINT3 + ",",
            "",
            'card.channel: "joint3.direction" is not wired; a channel of card model sc300 takes it',
        ),
        (
            "joint3.direction",
            "joint4.direction",
            "card 'latch'.channel 2.signal = \"joint4.direction\": robot 'konkuk1' has no joint 'joint4'; "
            "it has joint2, joint3",
        ),
        (
            "joint3.direction",
            "joint3.directions",
            "card 'latch'.channel 2.signal = \"joint3.directions\": card model sc300 takes <joint>.direction or grip",
        ),
        (
            LATCH_JOINT3,
            '{ number = 5, signal = "joint3.direction" }',
            "card 'latch'.channel 5: card model sc300 has channels 1 to 4",
        ),
        (
            LATCH_JOINT3,
            '{ number = 1, signal = "joint3.direction" }',
            "card 'latch'.channel 1: is listed twice; give each wire its own channel",
        ),
        (
            "heartbeat_timeout_ms = 100",
            "heartbeat_timeout_ms = 39",
            "bus.heartbeat_timeout_ms = 39: must be at least twice heartbeat_ms = 20, "
            "or one late heartbeat stops the robot",
        ),
        (
            "cycle_us = 2500",
            "cycle_us = 60_000",
            "bus.heartbeat_timeout_ms = 100: must be at least two cycles (cycle_us = 60000), "
            "the controller sends no more often than that",
        ),
        ("bench_node_id = 0x70", "bench_node_id = 0x6F", "bus.bench_node_id = 0x6F: must be 0x70 to 0x7F"),
        (
            "controller_node_id = 1",
            "controller_node_id = 0x70",
            "bus.controller_node_id = 0x70: is bench_node_id; on the bench bus they meet",
        ),
        (
            "[-130.0, 130.0]",
            "[130.0, -130.0]",
            "joint 'joint2'.limits_deg = [130, -130]: must be [lower, upper] with lower < upper",
        ),
        (
            "[-130.0, 130.0]",
            "[-130.0, 140.0]",
            "joint 'joint2'.limits_deg = [-130, 140]: the potentiometer with zero_v = 2.5 sees -135 to 135 "
            "degrees; stay within",
        ),
        (
            "home_deg = 20.0",
            "home_deg = 131.0",
            "joint 'joint2'.home_deg = 131: must lie within limits_deg = [-130, 130]",
        ),
        (
            "joint speed, either way\nzero_v = 2.5",
            "joint speed, either way\nzero_v = 5.0",
            "joint 'joint2'.sensors.tachometer.zero_v = 5: must lie between 0 and full_scale_v = 5",
        ),
        (
            "zero_v = 2.5                         # at",
            "zero_v = 5.5                         # at",
            "joint 'joint2'.limits_deg = [-130, 130]: the potentiometer with zero_v = 5.5 sees -297 to -27 degrees; "
            "stay within",
        ),
        (
            "conversion_us = 100",
            "conversion_us = 334",
            "card 'adc'.conversion_us = 334: a scan of 6 channels and bus.compute_delay_us = 500 "
            "do not fit into bus.cycle_us = 2500",
        ),
    ],
)
def test_parts_that_do_not_fit_together_are_named(old: str, new: str, complaint: str) -> None:
    assert complaints(old, new) == [f"my.toml: {complaint}"]


def test_an_adc_that_just_fits_into_the_cycle_is_accepted() -> None:
    assert parse_cell(TEXT.replace("conversion_us = 100", "conversion_us = 333"), "my.toml")


def test_joints_on_one_adc_share_its_reference_voltage() -> None:
    joint2, joint3 = TEXT.split('name = "joint3"')
    joint3 = joint3.replace("full_scale_v = 5.0", "full_scale_v = 5.5")
    text = joint2 + 'name = "joint3"' + joint3.replace("\nzero_v = 2.5", "\nzero_v = 2.75")
    with pytest.raises(CellError) as caught:
        parse_cell(text, "my.toml")
    assert str(caught.value) == (
        "my.toml: card 'adc': its sensors' full_scale_v must be the same; "
        "they are 5 (joint2.potentiometer), 5.5 (joint3.potentiometer)"
    )


def test_several_problems_are_told_at_once() -> None:
    lines = complaints("node_id = 0x14\nconversion_us = 100", "node_id = 0x13\nconversion_us = 0")
    assert lines == ["my.toml: card 'adc'.conversion_us = 0: must be at least 1"]  # values first, then what they share
    text = TEXT.replace("node_id = 0x13", "node_id = 0x12").replace("slot = 4", "slot = 3")
    with pytest.raises(CellError) as caught:
        parse_cell(text, "my.toml")
    assert len(str(caught.value).splitlines()) == 2


def test_more_joints_than_the_bench_node_has_objects_for_are_refused() -> None:
    cell = load_cell("konkuk1")
    joints = tuple(cell.joints[0].model_copy(update={"name": f"j{number}"}) for number in range(MOST_JOINTS + 1))
    crowded = cell.model_copy(update={"robot": (cell.robot[0].model_copy(update={"joint": joints}),)})
    assert "robot.joint: 33 joints; a cell has at most 32" in list(problems(crowded))


def test_what_is_not_toml_is_said_with_its_line() -> None:
    (line,) = complaints("[bus]", "[bus")
    assert line.startswith("my.toml: not valid TOML:")
    assert f"line {1 + TEXT[: TEXT.index('[bus]')].count(chr(10))}," in line


def test_an_empty_file_is_told_every_table_that_it_lacks() -> None:
    with pytest.raises(CellError) as caught:
        parse_cell("", "my.toml")
    lines = str(caught.value).splitlines()
    tables = ("name", "title", "bus", "physics", "robot", "card", "control")
    assert lines == [f"my.toml: {table}: is missing" for table in tables]


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("konkuk", "konkuk: no such file, and no cell of that name; did you mean 'konkuk1'?"),
        ("zzz.toml", "zzz.toml: no such file, and no cell of that name; known are konkuk1, konkuk1-brakes, rhino-pair"),
    ],
)
def test_a_cell_that_is_not_there_is_said_with_those_that_are(monkeypatch, tmp_path, name: str, complaint: str) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CellError) as caught:
        load_cell(name)
    assert str(caught.value) == complaint
    assert isinstance(caught.value, ProtocolError)


def test_what_cannot_be_read_as_text_is_no_cell(tmp_path) -> None:
    with pytest.raises(CellError, match=r"is no regular file; a cell is a TOML file$"):
        load_cell(str(tmp_path))
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(CellError, match=r"binary\.toml: is not a text in UTF-8; a cell is a TOML file$"):
        load_cell(str(path))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (f"a = {'[' * 5000}{']' * 5000}", "brackets are nested too deep"),
        (f"a = {'[' * 50}{']' * 50}", "nested more than 20 deep"),
        (f"{'.'.join('a' * 25)} = 1", "nested more than 20 deep"),
        (f"{'.'.join('a' * 40_000)} = 1", "a key of 40000 parts between dots; must have at most 32"),
        (f"a = {'9' * 5000}", "a whole number is too long; must have at most 600 digits"),
        (f"a = 0x{'f' * 100}", "an integer of 400 bits; TOML's have at most 64"),
    ],
    ids=["arrays", "some arrays", "key", "long key", "integer", "hexadecimal integer"],
)
def test_what_no_cell_can_hold_is_refused_in_one_line(text: str, complaint: str) -> None:
    with pytest.raises(CellError) as caught:
        parse_cell(text, "my.toml")
    assert str(caught.value).startswith("my.toml: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_no_part_of_a_cell(tmp_path) -> None:
    path = tmp_path / "marked.toml"
    path.write_text(TEXT, encoding="utf-8-sig")
    assert load_cell(str(path)) == load_cell("konkuk1")


def test_what_is_no_regular_file_is_no_cell(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, "/dev/zero", ""):
        with pytest.raises(CellError, match="is no regular file; a cell is a TOML file"):
            load_cell(str(path))


@pytest.mark.skipif(not os.access("/proc/kmsg", os.R_OK), reason="nobody but root reads the kernel's messages")
def test_a_regular_file_without_an_end_is_not_waited_for() -> None:
    with pytest.raises(CellError, match=r"has no end: more of it is to come|cannot be read"):
        load_cell("/proc/kmsg")


def test_a_file_too_large_for_a_cell_is_refused(tmp_path) -> None:
    path = tmp_path / "large.toml"
    path.write_text(TEXT + "#" * 1_000_000)
    with pytest.raises(CellError, match="is larger than 1000000 bytes; is it a cell"):
        load_cell(str(path))


def test_of_many_problems_the_first_are_told() -> None:
    lines = complaints("[bus]", "".join(f"key{number} = 0\n" for number in range(1000)) + "[bus]")
    assert len(lines) == 21
    assert lines[-1] == "my.toml: and 980 more"


def test_a_line_end_in_a_name_is_written_as_an_escape() -> None:
    assert complaints("[bus]", r'"a\nb" = 1' + "\n[bus]")[0].startswith(r"my.toml: a\nb: unknown key")
    with pytest.raises(CellError) as caught:
        load_cell("a\nb\x1b[2J")
    assert str(caught.value).startswith(r"a\nb\x1b[2J: no such file")


OLD_JOINT = TEXT.replace("[robot.joint.drive]\nkind", "[robot.joint.amplifier]\nkind", 1)


def test_a_cell_written_the_old_way_is_told_how_it_is_written_now() -> None:
    with pytest.raises(CellError) as caught:
        parse_cell(OLD_JOINT, "my.toml")
    (line,) = str(caught.value).splitlines()
    assert line.startswith(
        "my.toml: joint 'joint2'.amplifier: is written the old way; a drive is now [robot.joint.drive]"
    )
    assert "[robot.joint.sensors.potentiometer] range_deg" in line


def test_joints_of_two_robots_that_share_a_name_carry_their_robots() -> None:
    cell = parse_cell(TEXT, "my.toml")
    (one,) = cell.robot
    two = one.model_copy(update={"name": "other", "number": 2, "joint": one.joint[:1]})
    both = cell.model_copy(update={"robot": (one, two)})
    assert both.joint_names == ("konkuk1_joint2", "joint3", "other_joint2")
    assert both.joint_index("other", "joint2") == 2


def test_a_sensor_that_is_mounted_the_other_way_falls_as_the_joint_turns() -> None:
    cell = parse_cell(TEXT.replace("range_deg = 270.0 ", "sign = -1\nrange_deg = 270.0 "), "my.toml")
    scale = joint_sensors(cell)[0].position.scale
    assert (scale(0), scale(255)) == pytest.approx((math.radians(135), math.radians(-135)))


def test_a_joint_needs_a_position_sensor_and_exactly_one_of_link_and_body() -> None:
    cell = parse_cell(TEXT, "my.toml")
    joint = cell.joints[0]
    blind = joint.model_copy(update={"link": None, "sensors": joint.sensors.model_copy(update={"potentiometer": None})})
    assert list(joint_problems("joint2", blind)) == [
        "joint 'joint2': has neither [robot.joint.link] nor [robot.joint.body]; give one",
        "joint 'joint2'.sensors: none measures position; a joint needs one, "
        "such as [robot.joint.sensors.potentiometer]",
    ]


def with_brake(line: str) -> str:
    return TEXT.replace("home_deg = 20.0\n", f"home_deg = 20.0\n{line}\n", 1)


@pytest.mark.parametrize(
    ("line", "kind", "delay_ms"),
    [
        ("", None, None),
        ('brake = "none"', None, None),
        ('brake = { kind = "none" }', None, None),
        ('brake = "dynamic"', "dynamic", 10.0),
        ('brake = { kind = "dynamic", resistor_ohm = 3.9 }', "dynamic", 10.0),
        ('brake = "spring"', "spring", 20.0),
        ('brake = { kind = "spring", torque_nm = 5.0, delay_ms = 15.0 }', "spring", 15.0),
    ],
)
def test_a_joint_has_the_brake_that_its_cell_says(line: str, kind: str | None, delay_ms: float | None) -> None:
    brake = parse_cell(with_brake(line), "a test").joints[0].brake
    assert (getattr(brake, "kind", None), getattr(brake, "delay_ms", None)) == (kind, delay_ms)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ('brake = "drum"', '.brake = "drum": must be one of "none", "dynamic", "spring", or a table with its kind'),
        ("brake = 3", ".brake = 3: must be"),
        ("brake = {}", "or a table with its kind"),
        ('brake = { kind = "spring", torque_nm = -1.0 }', ".brake.torque_nm = -1.0: must be greater than 0"),
        ('brake = { kind = "dynamic", torque_nm = 3.0 }', "known are kind, delay_ms, resistor_ohm"),
        ('brake = { kind = "dynamic", delay_ms = 1e4 }', ".brake.delay_ms = 10000.0: must be at most 1000"),
    ],
)
def test_a_brake_that_cannot_be_is_refused_with_what_would_be_right(line: str, complaint: str) -> None:
    with pytest.raises(CellError, match=re.escape(complaint)) as caught:
        parse_cell(with_brake(line), "a test")
    assert str(caught.value).startswith("a test: robot 'konkuk1'.joint 'joint2'.brake")
    assert "\n" not in str(caught.value)
