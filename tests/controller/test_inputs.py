"""From codes to angles, speeds and currents, whatever sensors a joint has; figures by arithmetic on the cell file."""

import math

import numpy as np
import pytest

from canarm_controller.cycle import Cycle
from canarm_controller.dynamics import cell_arm
from canarm_controller.estimation.observer import stationary_gain
from canarm_controller.estimation.speed_observer import SpeedObserver
from canarm_controller.run.inputs import JointInputs
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensors import Quantity
from canarm_protocol.cell.wiring import card_nodes, input_slots

KONKUK = load_cell("konkuk1")
STEP_RAD, STEP_RAD_S, STEP_A = math.radians(270 / 255), 5 / 255, 1.5 / 255
ONWARD = (1.0, 1.0)


def cell_without(*kinds: str, joints: tuple[int, ...] = (0, 1), sign: int = 1) -> Cell:
    """konkuk1 less some sensors of some joints; `sign` is that of the position sensors."""
    changed = []
    for index, joint in enumerate(KONKUK.joints):
        sensors = joint.sensors
        if index in joints:
            potentiometer = sensors.potentiometer
            assert potentiometer is not None
            update = {"potentiometer": potentiometer.model_copy(update={"sign": sign})}
            sensors = sensors.model_copy(update=update | dict.fromkeys(kinds))
        changed.append(joint.model_copy(update={"sensors": sensors}))
    gone = {f"{KONKUK.joint_names[joint]}.{kind}" for joint in joints for kind in kinds}
    cards = tuple(
        card.model_copy(update={"channel": tuple(each for each in card.channel if each.signal not in gone)})
        for card in KONKUK.card
    )
    robot = KONKUK.robot[0].model_copy(update={"joint": tuple(changed)})
    return KONKUK.model_copy(update={"robot": (robot,), "card": cards})


def inputs_of(cell: Cell) -> JointInputs:
    return JointInputs(cell, input_slots(cell, card_nodes(cell)), cell_arm(cell.robot, cell.joint_names))


def test_a_missing_current_sense_reads_as_the_current_that_is_commanded() -> None:
    inputs, cycle = inputs_of(cell_without("current_sense", joints=(1,))), Cycle(2)
    cycle.applied_nm = (4.08, -1.36)
    inputs.take([128, 128, 128, 128, 102], cycle, (-1.0, -1.0))
    assert cycle.current_a == pytest.approx([-102 * STEP_A, -0.5])  # 1.36 N m / 2.72 N m/A
    assert inputs.current_codes == [102, 0]
    assert inputs.skew_s(1, Quantity.CURRENT) == 0.0


def test_a_missing_tachometer_is_replaced_by_an_observer_and_logs_nothing() -> None:
    inputs, cycle = inputs_of(cell_without("tachometer", joints=(0,))), Cycle(2)
    inputs.start((128, 128))
    inputs.take([128, 128, 128, 0, 0], cycle, ONWARD)
    assert cycle.velocity_rad_s == pytest.approx([0.0, 0.5 * STEP_RAD_S])
    assert inputs.speed_codes == [0, 128]
    angles, speeds = inputs.log_bytes()
    assert (list(angles), list(speeds)) == ([128, 128], [0, 128])


def test_a_sensor_that_is_mounted_the_other_way_round_counts_backwards() -> None:
    inputs, cycle = inputs_of(cell_without(sign=-1)), Cycle(2)
    assert inputs.start((137, 118)) == pytest.approx([-9.5 * STEP_RAD, 9.5 * STEP_RAD])
    inputs.take([137, 118, 127, 127, 0, 0], cycle, ONWARD)
    slow = 0.5 * STEP_RAD_S  # 127 is half a step below rest; joint 3 is sampled 100 us later
    assert cycle.position_rad == pytest.approx([-9.5 * STEP_RAD, 9.5 * STEP_RAD + 100e-6 * slow])


def test_two_cards_sample_at_the_same_time() -> None:
    """Of two ADC cards each converts its own channels from SYNC on."""
    (adc,) = (card for card in KONKUK.card if card.name == "adc")
    others = [card for card in KONKUK.card if card.name != "adc"]
    renumbered = [
        tuple(channel.model_copy(update={"number": number + 1}) for number, channel in enumerate(part))
        for part in (adc.channel[:2], adc.channel[2:])
    ]
    split = (
        adc.model_copy(update={"channel": renumbered[0]}),
        adc.model_copy(update={"name": "adc2", "slot": 5, "node_id": 0x15, "channel": renumbered[1]}),
    )
    inputs = inputs_of(KONKUK.model_copy(update={"card": (*others, *split)}))
    skews = [inputs.skew_s(joint, quantity) for quantity in Quantity for joint in (0, 1)]
    assert skews == pytest.approx([0.0, 100e-6, 0.0, 100e-6, 200e-6, 300e-6])


def test_the_stationary_gain_is_where_the_filter_over_time_ends() -> None:
    """Kalman's recursion, carried out 20000 times."""
    period = 2.5e-3
    transition = np.array([[1.0, period, period**2 / 2], [0.0, 1.0, period], [0.0, 0.0, 1.0]])
    by = np.array([period**2 / 2, period, 0.0])
    process = 0.03**2 / period * np.outer(by, by) + period * np.diag([0.0, 0.0, 9.0])
    output, noise = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0077**2]])
    covariance = np.eye(3)
    for _ in range(20_000):
        gain = covariance @ output.T / (output @ covariance @ output.T + noise)
        covariance = transition @ (covariance - gain @ output @ covariance) @ transition.T + process
    np.testing.assert_allclose(stationary_gain(transition, process, output, noise), gain, rtol=1e-6)


def test_the_observer_follows_a_joint_that_its_model_does_not_explain() -> None:
    """Constant acceleration of 3 rad/s² that no torque accounts for, seen in steps of 1.06 degrees: the speed after a
    second is 3 rad/s.
    """
    arm = cell_arm(KONKUK.robot, KONKUK.joint_names)
    observer = SpeedObserver(arm, (1,), (0.0077, 0.0077), None, 2.5e-3)
    observer.start((-math.pi / 2, 0.0))
    for tick in range(401):
        true = 1.5 * (tick * 2.5e-3) ** 2
        seen = (-math.pi / 2, round(true / STEP_RAD) * STEP_RAD)
        hold_nm = arm.torque_nm(seen, (0.0, 0.0), (0.0, 0.0))
        found = observer.update(seen, observer.predicted((0.0, 9.9)), hold_nm)
    assert found[0] == 0.0
    assert found[1] == pytest.approx(3.0, abs=0.15)
