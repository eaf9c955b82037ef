"""Faults while two robots carry an object: both stop together, and no hand loses it. Drawn cases of the campaign."""

import importlib
import sys
from pathlib import Path

import pytest

from canarm import Rig, State
from canarm.cli import run
from canarm.matrix.judgement import judge
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.reasons import why
from canarm.matrix.rig_run import AtOnset
from canarm.open_cell import open_cell
from canarm.soundness import unsound
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.cell_file import shipped_cells
from canarm_protocol.cell.model import Cell

CELL = load_cell("rhino-pair")
SLAVE = CELL.robot[1]
sys.path.append(str(Path(__file__).parent.parent.parent / "scripts"))
script = importlib.import_module("carrying_faults")


@pytest.mark.parametrize("seed", ["test/0", pytest.param("test/1", marks=pytest.mark.slow)])
@pytest.mark.parametrize("robot", [pytest.param("master", marks=pytest.mark.slow), "slave"])
def test_when_a_robots_cards_fall_silent_both_stop_within_20_ms_and_hold_the_object(robot: str, seed: str) -> None:
    rig, at_s, draw = script.drawn_rig(CELL, seed)
    rig.run(seconds=at_s)
    assert rig.state is State.RUNNING, rig.reason
    (injected,) = (each for group, name, each in script.faults(CELL, "silent") if name == robot and "cut" in group)
    found = script.outcome(rig, "", robot, injected, draw)
    assert found.detector == "inputs-missing"
    assert found.stop_ms <= 20.0
    assert not found.is_lost
    assert found.grip_n < rig.object.slip_force_n


@pytest.mark.parametrize("seed", [pytest.param(each, marks=pytest.mark.slow) for each in ("test/2", "test/3")])
def test_when_the_controller_dies_the_cards_carry_the_arms(seed: str) -> None:
    rig, at_s, draw = script.drawn_rig(CELL, seed)
    rig.run(seconds=at_s)
    found = script.outcome(rig, "", "", [], draw)
    assert not found.is_lost
    assert found.grip_n < rig.object.slip_force_n / 2


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["500/17", "500/32"])
def test_far_from_home_arms_stand_by_error_values_of_the_present_pose_alone(seed: str) -> None:
    """Two of 64 drawn moments in which what carries at home is too much or too little for friction to hold."""
    rig, at_s, draw = script.drawn_rig(CELL, seed)
    rig.run(seconds=at_s)
    rig._bench.load()
    stands, creeps = (
        script.in_copy(lambda group=group: script.outcome(rig, group, "", [], draw))
        for group in ("", script.AS_AT_HOME)
    )
    assert not stands.is_lost
    assert stands.turned_deg <= script.STANDS_DEG
    assert creeps.is_lost


def shoulder_a(rig: Rig) -> float:
    """The current of the slave's shoulder."""
    return abs(rig._bench.world.state()[CELL.joint_names.index("slave_shoulder")].current_a)


def lost_as(policy: str) -> Cell:
    """The pair, with another policy of its slave; one that holds, and one that is switched off, has no error values."""
    slave = SLAVE.model_copy(update={"when_lost": policy})
    cards = tuple(
        card.model_copy(update={"channel": tuple(each.model_copy(update={"error_value": 0}) for each in card.channel)})
        if card.robot == "slave" and policy != "carry"
        else card
        for card in CELL.card
    )
    return CELL.model_copy(update={"robot": (CELL.robot[0], slave), "card": cards})


@pytest.mark.parametrize("policy", ["off", "carry", "hold"])
def test_each_robot_has_its_own_policy_for_cards_that_have_lost_the_controller(policy: str) -> None:
    """The shoulder that bears most: no current, what carries it at home (136 of 255 steps), or what it had."""
    with Rig(lost_as(policy)) as rig:
        rig.run(seconds=0.5)
        before_a = shoulder_a(rig)
        bench = rig._bench
        goal_ns = bench.time_ns + 1_000_000 * (CELL.bus.heartbeat_timeout_ms + 20)
        while bench.time_ns < goal_ns:
            bench.advance(bench.time_ns + 2_500_000)
            bench.catch_up()
        after_a = shoulder_a(rig)
    carried_a = 136 / 255 * 1.5
    assert before_a != pytest.approx(carried_a, abs=0.01)
    assert after_a == pytest.approx({"off": 0.0, "carry": carried_a, "hold": before_a}[policy], abs=0.01)


def test_the_page_says_what_each_cell_with_an_object_decides() -> None:
    page = (Path(__file__).parent.parent.parent / "docs" / "carrying.md").read_text()
    for name in shipped_cells():
        cell = load_cell(name)
        if cell.object is not None:
            assert {robot.when_lost for robot in cell.robot} == {"carry"}
            assert f'| `"carry"`, `{name}` |' in page


@pytest.mark.parametrize(
    ("tap", "fault", "parameters", "detector", "within_ms"),
    [
        pytest.param("slave_elbow.encoder", "offset", {"value": -4}, "encoder-jump", 20.0, marks=pytest.mark.slow),
        pytest.param("master_shoulder.encoder", "offset", {"value": -2}, "encoder-jump", 20.0, marks=pytest.mark.slow),
        ("slave_elbow.link", "joint-jam", {}, "encoder-stuck", 45.0),
        pytest.param("slave_elbow.encoder", "stuck", {}, "encoder-stuck", 45.0, marks=pytest.mark.slow),
        pytest.param("node.0x21", "line-broken", {}, "heartbeat-lost", 20.0, marks=pytest.mark.slow),
        pytest.param("node.0x14", "hang", {}, "heartbeat-lost", 20.0, marks=pytest.mark.slow),
    ],
)
def test_what_shows_within_20_ms_stops_both_robots_by_then(
    tap: str, fault: str, parameters: dict[str, float], detector: str, within_ms: float
) -> None:
    """Of a jam only the next count can tell, here within 25 ms (the elbow makes 41 a second), and that it is late."""
    with Rig(CELL, seed=3) as rig:
        rig.run(seconds=5.0)
        found = script.outcome(rig, "", "", [(tap, fault, parameters)], "")
        assert found.detector == detector
        assert found.stop_ms <= within_ms
        assert not found.is_lost
        assert found.grip_n < rig.object.slip_force_n / 2


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("jam", "test/4"), ("encoder", "test/5"), ("jam", "test/6")])
def test_no_jam_and_no_encoder_makes_a_hand_lose_the_object(kind: str, seed: str) -> None:
    """But for the blow of a fast joint, which is over before any count could tell (docs/carrying.md)."""
    rig, at_s, draw = script.drawn_rig(CELL, seed)
    rig.run(seconds=at_s)
    rig._bench.load()
    rows = [script.in_copy(lambda what=what: script.outcome(rig, *what, draw)) for what in script.faults(CELL, kind)]
    lost = [each for each in rows if each.is_lost and (each.lost_ms is None or each.lost_ms > script.BLOW_MS)]
    assert len(lost) <= len(rows) // 20, lost


def test_a_run_that_ends_leaves_the_object_in_both_hands() -> None:
    """As planned, or because somebody stops it: amplifiers keep their currents, and nothing falls."""
    with Rig("rhino-pair") as rig:
        rig.run(seconds=0.5)
        rig.finish()
        assert rig.state is State.DONE
        rig._bench.run_on()
        assert not rig.torque_is_off
        assert rig.object.is_held
    with Rig("rhino-pair") as rig:
        rig.run(seconds=0.5)
        rig.controller.interrupt("by the user")
        rig.run(seconds=1.0)
        assert [str(each.reaction) for each in rig.detections] == ["safe-stop-hold"]
        rig._bench.run_on()
        assert rig.summary().object is not None
        assert rig.summary().object["lost_by"] == []


def test_a_hand_that_opens_is_noticed_by_how_the_hands_move() -> None:
    """Nobody tells the controller: the master sags under the whole object, the slave rises."""
    with Rig("rhino-pair", truth={"object.mass": 0.6}) as rig:
        rig.run(seconds=2.5)
        assert not rig.detections
        rig.inject("object.slave", "grip-opens")
        rig.run(seconds=1.0)
        (found,) = rig.detections
        assert (found.detector, found.where) == ("object-lost", None)
        assert "against each other" in found.detail
        assert rig.object.state.lost == ("slave",)


@pytest.mark.slow
def test_the_matrix_judges_whether_a_hand_has_lost_the_object() -> None:
    scenario = Scenario(cell="rhino-pair", trajectory="circle", at_s=1.5)
    (crash,) = cells_of(CELL, ["node.0x21 crash"])
    twin = AtOnset(scenario, CELL).observe(None)
    run = AtOnset(scenario, CELL).observe(crash)
    found = judge(CELL, run, twin, crash.is_dangerous, crash.may_mislead, crash.lets_go)
    assert twin.lost_by == ()
    assert twin.grip_n is not None
    assert twin.grip_n < 10.0
    assert (not found.is_safe) == bool(run.lost_by)
    assert ("the object is lost by" in why(found)) == bool(run.lost_by)
    assert judge(CELL, run, run, False).lost_by == ()


def test_check_says_what_the_hands_may_seem_to_move(capsys: pytest.CaptureFixture[str]) -> None:
    """Half a count of every joint: 1.95, 1.66 and 1.60 mm along the axes, 3.02 mm together."""
    assert run(["check", "--detectors", "--cell", "rhino-pair"]) == 0
    assert "object-lost              4.53 mm" in capsys.readouterr().out
    assert run(["check", "--detectors"]) == 0
    assert "object-lost              does not apply" in capsys.readouterr().out


def test_error_values_that_do_not_carry_are_told_and_another_object_has_its_own() -> None:
    assert not [line for line in unsound(CELL) if "when_lost" in line]
    cards = tuple(
        card.model_copy(update={"channel": tuple(each.model_copy(update={"error_value": 0}) for each in card.channel)})
        for card in CELL.card
    )
    lines = [line for line in unsound(CELL.model_copy(update={"card": cards})) if "when_lost" in line]
    assert [line.split("joint '")[1].split("'")[0] for line in lines] == [
        "master_shoulder", "master_elbow", "slave_shoulder", "slave_elbow", "slave_pitch",
    ]  # fmt: skip
    assert "must be 136 and 1" in lines[2]
    heavier = open_cell("rhino-pair", {"object.length_m": "0.8", "object.mass_kg": "0.8"})
    assert not [line for line in unsound(heavier) if "when_lost" in line]
    assert heavier.card != CELL.card
