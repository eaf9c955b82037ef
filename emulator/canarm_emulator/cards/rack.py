"""The cards of a cell, plugged in: their wires to the world on one side, devices on the other.

Knows which channel drives or measures which joint. Kinds of card, frames, states and the order of events never enter.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from canarm_protocol.canopen.pdo import MappedObject
from canarm_protocol.cards import Wire
from canarm_protocol.cell.model import SENSOR_KINDS, Card, Cell, Command, Quantity
from canarm_protocol.cell.sensing import fitted_sensor
from canarm_protocol.cell.sensors import AnalogueSensor

from ..node.io_device import IoDevice
from ..robot.scan_schedule import ScanSchedule
from ..robot.sensors import DistortedSource
from ..robot.truth import Truth
from ..robot.world import Source, World
from ..signals import Distortion
from .plugged import Connections, Plugged, Samples, Scan, plug_in

Mapped = tuple[tuple[int, MappedObject], ...]
"""Objects of the cards' TPDOs, each with its node-ID."""


@dataclass(frozen=True, slots=True)
class _InputCard:
    """A card with the sensors at its channels (from 0)."""

    node_id: int
    indices: frozenset[int]
    scan: Scan
    channel_ns: int
    sources: dict[int, Source]
    """Sources by channel, with faults; `sound` has them without."""
    sound: dict[int, Source]

    def measured(self, mapped: Mapped) -> list[int]:
        """Its channels among these objects, from the lowest up, whatever PDO each of them leaves in."""
        return sorted(
            each.subindex - 1
            for node_id, each in mapped
            if node_id == self.node_id and each.index in self.indices and each.subindex - 1 in self.sources
        )


@dataclass(frozen=True, slots=True)
class _Plan:
    """A scan: the sampling times, which card takes which samples, and how long each card needs."""

    schedule: ScanSchedule
    scans: tuple[tuple[Scan, Samples], ...]
    durations_ns: dict[int, int]
    """By node-ID, without cards that convert nothing."""


def _plan(cards: list[_InputCard], mapped: Mapped) -> _Plan:
    """All cards begin at once, each takes its channels one after the other."""
    busy = [(card, channels) for card in cards if (channels := card.measured(mapped))]
    sequences = [([card.sources[channel] for channel in channels], card.channel_ns) for card, channels in busy]
    schedule = ScanSchedule.merged(sequences)
    samples: list[list[tuple[int, int, int]]] = [[] for _ in busy]
    for value, ((number, index), offset_ns) in enumerate(zip(schedule.origins, schedule.offsets_ns, strict=True)):
        samples[number].append((busy[number][1][index], offset_ns, value))
    scans = tuple((card.scan, tuple(taken)) for (card, _), taken in zip(busy, samples, strict=True))
    return _Plan(schedule, scans, {card.node_id: len(channels) * card.channel_ns for card, channels in busy})


class Rack:
    """Every card of `cell` as a device, by node-ID."""

    def __init__(self, cell: Cell, world: World, truth: Truth) -> None:
        self._cell, self._world, self._truth = cell, world, truth
        self._inputs: list[_InputCard] = []
        self._mapped: Mapped | None = None
        self._plan = _plan([], ())
        """Plan of the last scan, nearly always the next one's too."""
        self.cards: dict[int, Plugged] = {card.node_id: self._plug_in(card) for card in cell.card}
        self.devices: dict[int, IoDevice] = {node_id: card.device for node_id, card in self.cards.items()}

    def convert(self, mapped: Mapped) -> Mapping[int, int]:
        """Scan the inputs among these objects, all cards at once; the world moves on to the end meanwhile.

        Returns how long each card takes, in ns by node-ID, without cards that convert nothing.
        """
        if mapped is not self._mapped:
            self._mapped, self._plan = mapped, _plan(self._inputs, mapped)
        plan, begin_ns = self._plan, self._world.time_ns
        values = self._world.scan(plan.schedule)
        for scan, samples in plan.scans:
            scan(begin_ns, samples, values)
        return plan.durations_ns

    def spare(self, card: Card) -> IoDevice:
        """Another card of the same kind, wired to nothing."""
        return plug_in(card, self._connections(card)).device

    def distort_input(self, joint: int, quantity: Quantity, distortion: Distortion | None) -> None:
        """Distort a sensor's output on its way to the card, or no longer (None)."""
        for card in self._inputs:
            for channel, source in card.sound.items():
                if (source.joint_index, source.quantity) == (joint, quantity):
                    broken = None if distortion is None else DistortedSource.of(source, distortion)
                    card.sources[channel] = broken or source
        self._mapped = None

    def _plug_in(self, card: Card) -> Plugged:
        joints = {channel.number - 1: self._cell.far_joint(card, channel) for channel in card.channel}
        world = self._world
        hands = {channel.number - 1 for channel in card.channel if channel.leaf == Command.GRIP}
        if card.kind.is_output:
            set_joint: Callable[[int, float], None] = world.set_dac_output
            if card.kind.takes is Wire.DIRECTION:
                set_joint = lambda joint, bits: world.set_direction(joint, int(bits))  # noqa: E731

            def set_output(channel: int, value: float) -> None:
                if channel in hands:
                    world.set_grip(joints[channel], int(value))
                elif channel in joints:
                    set_joint(joints[channel], value)

            return plug_in(card, self._connections(card, set_output))
        sources = {
            channel.number - 1: world.source(joints[channel.number - 1], SENSOR_KINDS[channel.leaf].quantity)
            for channel in card.channel
        }

        def sample(channel: int) -> float:
            return world.sample(sources[channel]) if channel in sources else 0.0

        plugged = plug_in(card, self._connections(card, sample=sample))
        assert plugged.scan is not None, "inputs are scanned"
        channel_ns = card.channel_us * 1000
        self._inputs.append(_InputCard(card.node_id, plugged.inputs, plugged.scan, channel_ns, sources, dict(sources)))
        return plugged

    def _connections(
        self,
        card: Card,
        set_output: Callable[[int, float], None] = lambda channel, value: None,
        sample: Callable[[int], float] = lambda channel: 0.0,
    ) -> Connections:
        world, truth = self._world, self._truth
        return Connections(
            world,
            set_output,
            sample,
            self._reference_v(card),
            self._lines(card).__getitem__,
            truth.adc,
            truth.dac,
        )

    def _lines(self, card: Card) -> dict[int, int]:
        """Periods per turn of the encoders at a card's channels (from 0); 0 at those without."""
        fitted = {channel.number - 1: fitted_sensor(self._cell, card, channel) for channel in card.channel}
        return {channel: getattr(fitted.get(channel), "lines", 0) for channel in range(card.kind.channels)}

    def _reference_v(self, card: Card) -> float:
        """The reference of a card's converter: the full scale of its sensors, which is the same for all."""
        sensors = (fitted_sensor(self._cell, card, channel) for channel in card.channel)
        return next((each.full_scale_v for each in sensors if isinstance(each, AnalogueSensor)), 0.0)
