"""Mutation of the table: with a detector a scene of the rig is called by its name, and without that detector never.

Scenes are faults as users inject them. Who adds a detector adds a scene; none is exempt, for each can be switched off
separately.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import pytest

from canarm import Rig
from canarm.new_cell import Request, write_cell
from canarm.new_cell.arms import made_up_arm
from canarm_controller.supervision.detection import DETECTORS, Reaction
from tests.hooked_law import hook_law
from tests.resolutions import cell_of_encoders, homed

AT_S, CYCLE_S, AT = 3.25, 0.0025, 1300
"""Joint 2 accelerates at -2.1 rad/s² there, joint 3 turns at -1.7 rad/s."""
Fault = tuple[str, str, dict[str, object]]


def fault(tap: str, kind: str, **parameters: object) -> Fault:
    return tap, kind, parameters


@dataclass(frozen=True)
class Scene:
    """What happens at `AT_S`, what happens `apart_s` later, and within how many cycles it must have its name."""

    where: str | None
    within: int
    first: Fault | None = None
    then: Fault | None = None
    apart_s: float = 0.0
    by_hand: Callable[[Any], None] = lambda rig: None
    rig: dict[str, Any] = field(default_factory=dict)


def breaks_law(result: object) -> Callable[[Any], None]:
    def update(cycle: object) -> object:
        if isinstance(result, Exception):
            raise result
        return result

    return lambda rig: hook_law(rig.controller.loop, update)


def disk_full() -> NoReturn:
    raise OSError("no space left on device")


WIRE = {"wire": True}
ENCODERS = {"cell": cell_of_encoders()}
"""Of 0.044 degrees a count: 80 counts are 3.5 degrees, 3.3 steps of a potentiometer."""
ARM = write_cell(made_up_arm(2), Request(sensing=("encoder",)), Path())[1]
LIGHTER = fault("joint3.link", "payload-change", mass=0.6)
BLOW = fault("joint3.link", "collision", impulse=0.2)
ADC, LATCH = "0x14", "latch"
SCENES: dict[str, Scene] = {
    "foreign-master": Scene(None, 1, fault("can0.tx", "babbling-idiot", cob_id=0x701), rig=WIRE),
    "card-state": Scene(LATCH, 1, fault("node.0x13", "reset")),
    "card-emergency": Scene("adc", 4, fault("can0.wire", "bus-off"), rig=WIRE),
    "heartbeat-lost": Scene(LATCH, 48, fault("node.0x13", "heartbeat-lost")),
    "inputs-missing": Scene(None, 4, fault("can0.tx", "lost", cob_id=0x294)),
    "inputs-late": Scene(ADC, 40, fault("can0.tx", "delayed", cob_id=0x394, delay=2.0, probability=0.2)),
    "inputs-repeated": Scene(ADC, 1, fault("can0.tx", "repeated", cob_id=0x394)),
    "deadline-missed": Scene(None, 2, fault("bench.clock", "late-sync")),
    "impossible-position": Scene("joint2", 2, fault("joint2.potentiometer", "short-to-supply")),
    "impossible-motion": Scene("joint2", 2, fault("joint2.potentiometer", "open-load")),
    "homing-failed": Scene("joint2", 0, rig={"cell": homed(cell_of_encoders()), "truth": {"joint2.initial_deg": 21.5}}),
    "start-pose": Scene("shoulder", 0, rig={"cell": ARM, "truth": {"shoulder.initial_deg": -110}}),
    "law-output": Scene(None, 2, by_hand=breaks_law([float("nan"), 0.0])),
    "law-failed": Scene(None, 2, by_hand=breaks_law(ZeroDivisionError("of the law"))),
    "interrupted": Scene(None, 2, by_hand=lambda rig: rig.controller.interrupt("by the user")),
    "recording-failed": Scene(None, 2, by_hand=lambda rig: setattr(rig.controller, "on_tick", disk_full)),
    "potentiometer-range": Scene("joint2", 10, fault("joint2.potentiometer", "dropout")),
    "potentiometer-jump": Scene("joint2", 10, fault("joint2.potentiometer", "offset", value=0.12)),
    "potentiometer-spike": Scene("joint3", 10, fault("joint3.potentiometer", "spike", height=0.12, interval=10.0)),
    "potentiometer-stuck": Scene("joint3", 24, fault("joint3.potentiometer", "stuck")),
    "potentiometer-mismatch": Scene("joint2", 10, fault("joint2.potentiometer", "offset", value=0.06)),
    "encoder-jump": Scene("joint2", 10, fault("joint2.encoder", "offset", value=80), rig=ENCODERS),
    "encoder-spike": Scene("joint3", 10, fault("joint3.encoder", "spike", height=80, interval=10.0), rig=ENCODERS),
    "encoder-stuck": Scene("joint3", 24, fault("joint3.encoder", "stuck"), rig=ENCODERS),
    "encoder-mismatch": Scene("joint2", 10, fault("joint2.encoder", "offset", value=40), rig=ENCODERS),
    "tachometer-range": Scene("joint2", 10, fault("joint2.tachometer", "dropout")),
    "tachometer-jump": Scene("joint3", 10, fault("joint3.tachometer", "leakage")),
    "tachometer-spike": Scene("joint3", 10, fault("joint3.tachometer", "spike", interval=10.0)),
    "tachometer-stuck": Scene("joint2", 24, fault("joint2.tachometer", "stuck")),
    "tachometer-mismatch": Scene("joint3", 80, fault("joint3.tachometer", "offset")),
    "sensor-noise": Scene("joint2", 10, fault("joint2.tachometer", "noise")),
    "current-mismatch": Scene("joint2", 12, fault("joint2.dac.code", "gain")),
    "current-sense-mismatch": Scene("joint2", 10, fault("joint2.current_sense", "offset")),
    "current-sense-range": Scene("joint2", 10, fault("joint2.current_sense", "dropout")),
    "acceleration-mismatch": Scene("joint2", 12, LIGHTER),
    "wrong-direction": Scene("joint2", 12, fault("joint2.latch", "reversed-direction")),
    "following-error": Scene("joint3", 20, BLOW),
    "saturation": Scene("joint2", 0, rig={"truth": {"joint3.mass": 2.1}}),
    "drive-broken": Scene("joint3", 40, fault("joint3.wire", "wire-broken")),
    "overspeed": Scene("joint3", 40, LIGHTER, BLOW, 16 * CYCLE_S),
    "object-lost": Scene(None, 100, fault("object.slave", "grip-opens"), rig={"cell": "rhino-pair"}),
    "both-sensors": Scene(
        "joint2", 60, fault("joint2.tachometer", "dropout"),
        fault("joint2.potentiometer", "drift", rate=16.0), 10 * CYCLE_S,
    ),
}  # fmt: skip


def detections(scene: Scene, without: set[str]) -> list[Any]:
    with Rig(law="mras", **scene.rig) as rig:
        rig.controller.without = without
        for each, at_s in ((scene.first, AT_S), (scene.then, AT_S + scene.apart_s)):
            if each is not None:
                rig.inject(each[0], each[1], at=at_s, **each[2])
        rig.run(AT_S)
        scene.by_hand(rig)
        rig.run((scene.within + 10) * CYCLE_S)
        return list(rig.controller.detections)


def test_every_detector_has_a_scene() -> None:
    assert set(SCENES) == set(DETECTORS)


@pytest.mark.slow
@pytest.mark.parametrize("detector", SCENES)
def test_with_the_detector_the_scene_is_called_by_its_name_in_time_and_not_too_soon(detector: str) -> None:
    scene = SCENES[detector]
    found = [each for each in detections(scene, set()) if each.detector == detector]
    assert found, "not detected"
    at_once = [each.where for each in found if each.tick == found[0].tick]
    assert scene.where in at_once, "a payload that changes is felt by several joints in the same cycle"
    assert found[0].tick - AT <= scene.within
    begins = 0 if scene.rig.get("truth") else AT
    assert found[0].tick - begins + 1 >= DETECTORS[detector].debounce_cycles


@pytest.mark.slow
@pytest.mark.parametrize("detector", SCENES)
def test_without_the_detector_nothing_has_its_name(detector: str) -> None:
    assert detector not in {each.detector for each in detections(SCENES[detector], {detector})}


@pytest.mark.parametrize("tap", ["joint2.dac.code", "joint3.dac.code"])
@pytest.mark.parametrize("at_s", [2.8, 3.25])
def test_a_drive_that_follows_an_old_command_is_switched_off(tap: str, at_s: float) -> None:
    """50 ms late. From 2.8 s on joint 3 leaves its floor after 89 cycles; from then on there are 100 ms."""
    with Rig(law="mras") as rig:
        rig.inject(tap, "delayed", at=at_s)
        rig.run(at_s + 0.35)
        assert str(rig.reason).startswith(f"current-mismatch: {tap[:6]}")
        off = next(each for each in rig.controller.detections if each.reaction is Reaction.OFF)
        assert off.tick - round(at_s / CYCLE_S) <= 129


@pytest.mark.parametrize("tap", ["joint2.current_sense", "joint3.current_sense"])
@pytest.mark.parametrize("kind", ["offset", "gain"])
def test_a_wrong_offset_or_gain_of_the_current_sense_switches_nothing_off(tap: str, kind: str) -> None:
    with Rig(law="mras") as rig:
        rig.inject(tap, kind, at=2.8)
        rig.run(5.0)
        assert rig.reason is None
        assert rig.controller.detections[-1].detector == "current-sense-mismatch"


@pytest.mark.parametrize("delay_ms", [5, 20])
@pytest.mark.parametrize("law", ["mras", "pd"])
def test_a_late_sync_blames_neither_another_master_nor_a_sensor(law: str, delay_ms: int) -> None:
    with Rig(law=law) as rig:
        rig.inject("bench.clock", "late-sync", at=AT_S, delay=float(delay_ms))
        rig.run(7.0)
        assert [(each.detector, each.tick) for each in rig.controller.detections] == [("deadline-missed", AT + 1)]
        assert rig.reason is None
