"""The cards of a cell, plugged in: their analogue wires to the world on one side, CiA 401 devices on the other.

Owns which channel drives or measures which joint. Knows no frames, no states and no order of events.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from canarm_protocol.canopen.dictionary import ANALOGUE_INPUT, ANALOGUE_INPUT_8
from canarm_protocol.canopen.pdo import MappedObject
from canarm_protocol.cell.model import SENSOR_KINDS, Card, CardModel, Cell, Quantity
from canarm_protocol.cell.sensing import fitted_sensor
from canarm_protocol.cell.sensors import AnalogueSensor

from ..node.io_device import IoDevice
from ..robot.scan_schedule import ScanSchedule
from ..robot.sensors import DistortedSource
from ..robot.truth import Truth
from ..robot.world import Source, World
from ..signals import Distortion
from .adc0809 import Adc0809Card
from .dac0808 import Dac0808Card
from .device import AdcDevice, DacDevice, LatchDevice
from .sc300 import Sc300Card


@dataclass(frozen=True, slots=True)
class _Converter:
    """An ADC card with the sensors at its channels (from 0)."""

    node_id: int
    device: AdcDevice
    sources: dict[int, Source]
    """By channel, as they are now; `sound` is how they are with nothing broken."""
    sound: dict[int, Source]
    conversion_ns: int


Mapped = tuple[tuple[int, MappedObject], ...]
"""Objects of the cards' TPDOs, each with its node-ID."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """A scan: its samples in order of time, where each goes, and when each card is done after its start."""

    schedule: ScanSchedule
    stores: tuple[tuple[AdcDevice, int], ...]
    """Device and channel (from 0) of each sample."""
    durations_ns: dict[int, int]
    """By node-ID; cards that convert nothing are not among them."""


def _measured(converter: _Converter, mapped: Mapped) -> list[int]:
    """The channels (from 0) of a converter among these objects, in their order."""
    return [
        each.subindex - 1
        for node_id, each in mapped
        if node_id == converter.node_id
        and each.index in (ANALOGUE_INPUT, ANALOGUE_INPUT_8)
        and each.subindex - 1 in converter.sources
    ]


def _plan(converters: list[_Converter], mapped: Mapped) -> _Plan:
    """All converters begin at once, each converts its channels one after the other."""
    busy = [(each, channels) for each in converters if (channels := _measured(each, mapped))]
    sequences = [([each.sources[channel] for channel in channels], each.conversion_ns) for each, channels in busy]
    schedule = ScanSchedule.merged(sequences)
    stores = tuple((busy[number][0].device, busy[number][1][place]) for number, place in schedule.places)
    durations_ns = {each.node_id: len(channels) * each.conversion_ns for each, channels in busy}
    return _Plan(schedule, stores, durations_ns)


class Rack:
    """Every card of `cell` as a device, by node-ID."""

    def __init__(self, cell: Cell, world: World, truth: Truth) -> None:
        self._cell, self._world, self._truth = cell, world, truth
        self._converters: list[_Converter] = []
        self._mapped: Mapped | None = None
        self._plan = _plan([], ())
        """Of the last scan: nearly always the next one's too."""
        self._dacs: dict[int, tuple[Dac0808Card, int]] = {}
        """By joint: the card that drives it, and the channel."""
        self._latches: dict[int, tuple[Sc300Card, int]] = {}
        self.devices: dict[int, IoDevice] = {card.node_id: self._plug_in(card) for card in cell.card}

    def convert(self, mapped: Mapped) -> Mapping[int, int]:
        """Scan the analogue inputs among these objects, all cards at once; the world moves on to the end meanwhile.

        Returns how long each card takes, in ns by node-ID; those that convert nothing are not among them.
        """
        if mapped is not self._mapped:
            self._mapped, self._plan = mapped, _plan(self._converters, mapped)
        plan = self._plan
        for (device, channel), volts in zip(plan.stores, self._world.scan(plan.schedule), strict=True):
            device.store(channel, volts)
        return plan.durations_ns

    def spare(self, card: Card) -> IoDevice:
        """Another card of the same kind, wired to nothing."""
        if card.model is CardModel.DAC0808:
            return DacDevice(Dac0808Card(lambda channel, fraction: None))
        if card.model is CardModel.LATCH:
            return LatchDevice(Sc300Card(lambda channel, bits: None))
        full_scale_v = self._reference_v(card)
        return AdcDevice(Adc0809Card(lambda channel: 0.0, full_scale_v, card.conversion_us * 1000), lambda channel: 0.0)

    def distort_input(self, joint: int, quantity: Quantity, distortion: Distortion | None) -> None:
        """Change a sensor's voltage on its way to the ADC, or no longer (None)."""
        for converter in self._converters:
            for channel, source in converter.sound.items():
                if (source.joint_index, source.quantity) == (joint, quantity):
                    broken = None if distortion is None else DistortedSource.of(source, distortion)
                    converter.sources[channel] = broken or source
        self._mapped = None

    def distort_conversion(self, node_id: int, channel: int, distortion: Distortion | None) -> None:
        """Change the code of an ADC's channel (from 0)."""
        for converter in self._converters:
            if converter.node_id == node_id:
                converter.device.distort(channel, distortion)

    def distort_code(self, joint: int, distortion: Distortion | None) -> None:
        """Change the code that a joint's DAC converts."""
        card, channel = self._dacs[joint]
        card.distort(channel, distortion)

    def refresh_code(self, joint: int) -> None:
        """Let the joint's DAC convert anew."""
        card, channel = self._dacs[joint]
        card.refresh(channel)

    def distort_latch(self, joint: int, distortion: Distortion | None) -> None:
        """Change a joint's direction bits behind the latch."""
        card, channel = self._latches[joint]
        card.distort(channel, distortion)

    def refresh_latch(self, joint: int) -> None:
        """Let the joint's latch put out its bits anew."""
        card, channel = self._latches[joint]
        card.refresh(channel)

    def _plug_in(self, card: Card) -> IoDevice:
        joints = {channel.number - 1: self._cell.far_joint(card, channel) for channel in card.channel}
        if card.model is CardModel.DAC0808:
            return self._dac(joints)
        if card.model is CardModel.LATCH:
            return self._latch(joints)
        return self._adc(card, joints)

    def _dac(self, joints: dict[int, int]) -> DacDevice:
        def on_output(channel: int, fraction: float) -> None:
            if channel in joints:
                self._world.set_dac_output(joints[channel], fraction)

        card = Dac0808Card(on_output, self._truth.dac.nonlinearity)
        self._dacs.update({joint: (card, channel) for channel, joint in joints.items()})
        return DacDevice(card)

    def _latch(self, joints: dict[int, int]) -> LatchDevice:
        def on_direction(channel: int, bits: int) -> None:
            if channel in joints:
                self._world.set_direction(joints[channel], bits)

        card = Sc300Card(on_direction)
        self._latches.update({joint: (card, channel) for channel, joint in joints.items()})
        return LatchDevice(card)

    def _reference_v(self, card: Card) -> float:
        """The reference of an ADC card: the full scale of its sensors, which is the same for all."""
        sensors = (fitted_sensor(self._cell, card, channel) for channel in card.channel)
        return next(sensor.full_scale_v for sensor in sensors if isinstance(sensor, AnalogueSensor))

    def _adc(self, card: Card, joints: dict[int, int]) -> AdcDevice:
        world, errors = self._world, self._truth.adc
        sources = {
            channel.number - 1: world.source(joints[channel.number - 1], SENSOR_KINDS[channel.leaf].quantity)
            for channel in card.channel
        }

        def sample(channel: int) -> float:
            return world.sample(sources[channel]) if channel in sources else 0.0

        conversion_ns = card.conversion_us * 1000
        adc = Adc0809Card(
            sample,
            self._reference_v(card),
            conversion_ns,
            errors.offset_lsb,
            errors.gain_error,
            errors.nonlinearity_lsb,
        )
        device = AdcDevice(adc, sample)
        self._converters.append(_Converter(card.node_id, device, sources, dict(sources), conversion_ns))
        return device
