"""Emulator and controller agree on when each input is sampled, however many inputs a card has."""

from pathlib import Path

import pytest

from canarm import Rig
from canarm.new_cell.arms import made_up_arm
from canarm.new_cell.request import Request
from canarm.new_cell.writing import write_cell
from canarm_protocol.cell.sensing import joint_sensors


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("joints", [1, 3, 5, 7])
def test_every_input_is_sampled_when_the_controller_thinks_it_is(joints: int, bits: int, tmp_path: Path) -> None:
    """Channel by channel, as the ADC0809's sequence runs; a card of five inputs needs two PDOs, in whatever order."""
    _, cell = write_cell(made_up_arm(joints), Request(bits=bits), tmp_path)
    with Rig(cell) as rig:
        rig.run(seconds=0.02)
        schedule = rig._bench.world._schedule
    assert schedule is not None
    sensors = joint_sensors(cell)
    assert len(schedule.sources) == 3 * joints
    for source, offset_ns in zip(schedule.sources, schedule.offsets_ns, strict=True):
        wired = sensors[source.joint_index].measuring(source.quantity)
        assert wired is not None
        assert offset_ns == round(wired.skew_s * 1e9), wired.signal
