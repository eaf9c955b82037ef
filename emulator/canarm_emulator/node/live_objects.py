"""Objects of a card whose value is found out when a client reads them.

What is written to a node's objects, and how it is stored, never enters.
"""

from canarm_protocol.canopen.dictionary import CLOCK_MODE, ERROR_HISTORY, INTERRUPT_SOURCE, STORED_EDS
from canarm_protocol.canopen.sdo import AbortCode

from .analogue_events import AnalogueEvents
from .io_device import IoDevice
from .pdos import Pdos
from .store import ObjectStore, SdoRefused

APPLICATION_OBJECTS = 0x2000
"""The first index that is not of the communication profile."""


class LiveObjects:
    """What object 0x2000 shows is `clock_mode` (0 wall, 1 lockstep), what 0x1021 holds `eds`."""

    def __init__(
        self, device: IoDevice, pdos: Pdos, inputs: AnalogueEvents | None, clock_mode: int, eds: bytes
    ) -> None:
        self._device, self._pdos, self._inputs = device, pdos, inputs
        self._clock_mode, self._eds = clock_mode, eds

    def read(self, store: ObjectStore, index: int, subindex: int) -> bytes | None:
        """The object's bytes; None where `store` has them. Raises `SdoRefused`."""
        if index == CLOCK_MODE:
            return bytes((self._clock_mode,))
        if index == STORED_EDS:
            return self._eds
        if index == ERROR_HISTORY and subindex and subindex > store.number(ERROR_HISTORY):
            raise SdoRefused(AbortCode.NO_DATA)
        if index == INTERRUPT_SOURCE and subindex and self._inputs is not None:
            return self._inputs.take_sources().to_bytes(4, "little")
        if index >= APPLICATION_OBJECTS:
            if not self._pdos.is_scanned(index, subindex):
                self._device.refresh(index, subindex)
            getter = self._device.getter(index, subindex)
            if getter is not None:
                return bytes(store.variable(index, subindex).encode_raw(getter()))
        return None
