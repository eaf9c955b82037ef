"""The D/A converters of a card with the faults in front of them. How codes get to them is the card's."""

from abc import ABC, abstractmethod
from collections.abc import Callable

from canarm_protocol.compiling import mypyc_attr

from ..signals import Distortion
from .converters import output_fractions
from .registers import OPEN_BUS


@mypyc_attr(allow_interpreted_subclasses=True)
class DacConverters(ABC):
    """Converters of `bits` bits. `on_output(channel, fraction)` is told of every change of I_out / I_ref.

    `nonlinearity` is the largest deviation from the end-point line, as a fraction of full scale; its shape is a bow
    over the codes.
    """

    def __init__(self, bits: int, on_output: Callable[[int, float], None], nonlinearity: float) -> None:
        self._on_output = on_output
        self._fractions = output_fractions(bits, nonlinearity)
        self._distortions: dict[int, Distortion] = {}

    @abstractmethod
    def code(self, channel: int) -> int:
        """The code that the card gives to a converter."""

    def read(self, address: int, now_ns: int) -> int:
        """What is written cannot be read back."""
        return OPEN_BUS

    def refresh(self, channel: int) -> None:
        """Convert the code again, with the faults in front of the converter."""
        code = self.code(channel)
        if self._distortions and channel in self._distortions:
            code = int(self._distortions[channel](code))
        self._on_output(channel, self._fractions[code])

    def distort(self, channel: int, distortion: Distortion | None) -> None:
        """Change the code that the converter sees, from the next `refresh` on."""
        if distortion is None:
            self._distortions.pop(channel, None)
        else:
            self._distortions[channel] = distortion
