"""Characteristics of converters of any resolution, with their errors. Registers belong to the cards."""

from collections.abc import Sequence

from canarm_protocol.cards.kind import highest_code
from canarm_protocol.compiling import mypyc_attr

from ..robot.truth import AdcTruth
from .plugged import Samples

NO_ERRORS = AdcTruth()
STEPS = 256
"""I_out = I_ref x code / 256: full scale is 255/256 of the reference (DAC0808 data sheet)."""


def output_fractions(bits: int, nonlinearity: float) -> list[float]:
    """I_out / I_ref of a D/A converter for each of its codes; full scale is 255/256 whatever the resolution.

    `nonlinearity` is the largest deviation from the end-point line, as a fraction of full scale; its shape is a bow.
    """
    full_scale = highest_code(bits)
    per_code = (STEPS - 1) / full_scale / STEPS
    bows = (4.0 * code * (full_scale - code) / full_scale**2 for code in range(full_scale + 1))
    if bits == 8:
        return [(code + nonlinearity * bow * full_scale) / STEPS for code, bow in enumerate(bows)]
    return [(code + nonlinearity * bow * full_scale) * per_code for code, bow in enumerate(bows)]


@mypyc_attr(allow_interpreted_subclasses=True)
class Converter:
    """An A/D converter that starts when it is told to and is done after `conversion_ns`.

    `errors` are in LSB, except `gain_error`, a fraction of the reading; the nonlinearity is a bow between the end
    points. The reference is trimmed so that `full_scale_v` reads the full-scale code.
    """

    def __init__(self, bits: int, full_scale_v: float, conversion_ns: int, errors: AdcTruth) -> None:
        self.conversion_ns = conversion_ns
        full_scale = self._full_scale = highest_code(bits)
        self._gain = full_scale / full_scale_v * (1.0 + errors.gain_error)
        self._offset = 0.5 + errors.offset_lsb
        self._bow = 4.0 * errors.nonlinearity_lsb / full_scale**2
        self._result = self._converting = self._done_ns = 0

    def start(self, volts: float, now_ns: int) -> None:
        """Start to convert the input; a running conversion is abandoned."""
        if now_ns >= self._done_ns:
            self._result = self._converting
        self._converting = self.code(volts)
        self._done_ns = now_ns + self.conversion_ns

    def is_done(self, now_ns: int) -> bool:
        """Whether no conversion is running."""
        return now_ns >= self._done_ns

    def result(self, now_ns: int) -> int:
        """The last result; during a conversion, that of the one before."""
        if now_ns >= self._done_ns:
            self._result = self._converting
        return self._result

    def convert(self, begin_ns: int, samples: Samples, volts: Sequence[float]) -> list[int]:
        """Make one conversion after the other, and read each result when it is done: a code for each sample."""
        codes = self._codes([volts[place] for _, _, place in samples])
        self._result = self._converting = codes[-1]
        self._done_ns = begin_ns + samples[-1][1] + self.conversion_ns
        return codes

    def code(self, volts: float) -> int:
        """The converter's characteristic."""
        return self._codes((volts,))[0]

    def _codes(self, volts: Sequence[float]) -> list[int]:
        gain, offset, bow, full_scale = self._gain, self._offset, self._bow, self._full_scale
        codes = []
        for each in volts:
            step = each * gain if each > 0.0 else 0.0
            code = int(step + offset + bow * step * (full_scale - step))
            codes.append(0 if code < 0 else full_scale if code > full_scale else code)
        return codes
