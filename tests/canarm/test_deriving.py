"""What docs/ and CONTRIBUTING.md have users derive from can be derived from, compiled or not, and theirs is called."""

from collections.abc import Sequence
from dataclasses import dataclass

import pytest

from canarm import Rig
from canarm_controller.errors import LawError
from canarm_controller.laws.base import ControlLaw, Cycle
from canarm_controller.laws.loading import LAWS
from canarm_emulator.cards.converters import NO_ERRORS, Converter
from canarm_emulator.cards.dac_converters import DacConverters
from canarm_emulator.robot.scan_schedule import ScanSchedule
from canarm_emulator.robot.sensors import DistortedSource, Moment
from canarm_emulator.robot.sensors.base import AnalogueSource, Source
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import World
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Quantity


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_a_law_derived_from_one_of_canarms_is_asked_and_may_keep_what_it_likes(law: type[ControlLaw]) -> None:
    class Mine(law):  # type: ignore[misc, valid-type]
        def update(self, cycle: Cycle) -> Sequence[float]:
            self.last_tick = cycle.tick
            return super().update(cycle)

    with Rig("konkuk1", law=Mine) as mine, Rig("konkuk1", law=law) as own:
        for rig in (mine, own):
            rig.run(0.1)
        assert mine.controller.loop.law.last_tick == mine.controller.loop.cycle.tick
        assert mine.frames == own.frames


def test_what_a_law_lacks_is_named() -> None:
    class Half(ControlLaw):
        def start(
            self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], amplitude_rad: Sequence[float]
        ) -> None:
            """It has no `update`."""

    with pytest.raises(LawError, match=r"missing or wrong: __init__\(\), update\(\), name"):
        Rig("konkuk1", law=Half)


@dataclass(frozen=True, slots=True)
class Steady(AnalogueSource):
    """Always gives the same, whatever it measures: through what it inherits."""

    value: float = 0.0

    def read(self, moment: Moment, within: float, deviate: float) -> float:
        return self.volts(self.value, 0.0)


def test_a_sensor_derived_from_a_wire_to_an_adc_is_read() -> None:
    cell = load_cell("konkuk1")
    world = World(cell, Truth.from_settings(cell, {}), seed=0)
    steady: Source = Steady(0, Quantity.POSITION, 5.0, 2.0, 0.5, 0.1, value=1.25)
    twice = DistortedSource.of(steady, lambda volts: 1.5 * volts)
    assert [world.sample(each) for each in (steady, twice)] == [3.0, 4.5]
    assert world.scan(ScanSchedule.merged([([steady, twice], 100_000)])) == [3.0, 4.5]


def test_a_converter_derived_from_canarms_gives_its_own_codes() -> None:
    class Constant(Converter):
        def code(self, volts: float) -> int:
            return 7

    converter = Constant(8, 5.0, 1000, NO_ERRORS)
    converter.start(2.5, 0)
    assert converter.result(1000) == 7


def test_d_a_converters_derived_from_canarms_put_out_their_own_codes() -> None:
    class Full(DacConverters):
        def code(self, channel: int) -> int:
            return 255

    put_out: list[tuple[int, float]] = []
    Full(8, lambda channel, fraction: put_out.append((channel, fraction)), 0.0).refresh(2)
    assert put_out == [(2, 255 / 256)]
