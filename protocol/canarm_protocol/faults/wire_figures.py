"""What a bench says of the wires and the clients of its buses, read object by object."""

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..cell import bench_objects as objects
from ..cell.model import Cell

Read = Callable[[int, int], bytes]
"""Index and sub-index to bytes."""


@dataclass(frozen=True, slots=True)
class ErrorCounters:
    """A card's CAN controller: transmit and receive error counters, and the state that they put it in."""

    transmit: int
    receive: int
    state: int
    """0 error-active, 1 error-passive, 2 bus-off."""


@dataclass(frozen=True, slots=True)
class WireFigures:
    """The robot's bus, and the clients of both. Load and response are None where no wire model runs."""

    load: float | None
    """0 to 1, of the last second."""
    total_load: float | None
    worst_response_us: float | None
    worst_cob_id: int
    error_frames: int
    lost_frames: int
    cards: Mapping[str, ErrorCounters]
    """By the cards' names."""
    dropped: Mapping[str, int]
    """Frames that slow clients of a bus did not get, by bus."""
    clients: Mapping[str, int]
    """By bus."""


def wire_figures(read: Read, cell: Cell) -> WireFigures:
    """The figures of the bench of `cell`. Raises what `read` does, and `ValueError` for a value of another length."""

    def number(index: int, subindex: int = 0) -> int:
        return int.from_bytes(read(index, subindex), "little")

    def real(index: int) -> float | None:
        data = read(index, 0)
        if len(data) != 4:
            raise ValueError(f"0x{index:04X}: {len(data)} bytes instead of 4")
        value: float = struct.unpack("<f", data)[0]
        return None if math.isnan(value) else value

    return WireFigures(
        load=real(objects.BUS_LOAD),
        total_load=real(objects.TOTAL_BUS_LOAD),
        worst_response_us=real(objects.WORST_RESPONSE),
        worst_cob_id=number(objects.WORST_COB_ID),
        error_frames=number(objects.ERROR_FRAMES),
        lost_frames=number(objects.LOST_FRAMES),
        cards={
            card.name: ErrorCounters(
                number(objects.TRANSMIT_ERRORS, place),
                number(objects.RECEIVE_ERRORS, place),
                number(objects.ERROR_STATE, place),
            )
            for place, card in enumerate(cell.card, start=1)
        },
        dropped={bus: number(objects.DROPPED_FRAMES, place) for place, bus in enumerate(objects.BUSES, start=1)},
        clients={bus: number(objects.ATTACHED_CLIENTS, place) for place, bus in enumerate(objects.BUSES, start=1)},
    )
