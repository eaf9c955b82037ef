"""What converters of any resolution have in common: their characteristics with their errors.

Registers belong to the cards.
"""

from collections.abc import Callable

from canarm_protocol.cell.wiring import FULL_SCALE_CODE

STEPS = FULL_SCALE_CODE + 1
"""I_out = I_ref x code / 256: full scale is 255/256 of the reference (DAC0808 data sheet)."""


def output_fractions(bits: int, nonlinearity: float) -> list[float]:
    """I_out / I_ref of a D/A converter for each of its codes; full scale is 255/256 whatever the resolution.

    `nonlinearity` is the greatest deviation from the line between the end points, a fraction of full scale, as a bow.
    """
    full_scale = (1 << bits) - 1
    per_code = FULL_SCALE_CODE / full_scale / STEPS
    bows = (4.0 * code * (full_scale - code) / full_scale**2 for code in range(full_scale + 1))
    if bits == 8:
        return [(code + nonlinearity * bow * full_scale) / STEPS for code, bow in enumerate(bows)]
    return [(code + nonlinearity * bow * full_scale) * per_code for code, bow in enumerate(bows)]


def input_code(
    bits: int, full_scale_v: float, offset_lsb: float, gain_error: float, nonlinearity_lsb: float
) -> Callable[[float], int]:
    """The characteristic of an A/D converter: from volts to a code.

    Its errors are in steps of its own, but for `gain_error`, a fraction of the reading; the nonlinearity is a bow
    between the end points. The reference is trimmed so that `full_scale_v` reads the highest code.
    """
    full_scale = (1 << bits) - 1
    gain = full_scale / full_scale_v * (1.0 + gain_error)
    offset, curvature = 0.5 + offset_lsb, 4.0 * nonlinearity_lsb / full_scale**2

    def code(volts: float) -> int:
        step = volts * gain if volts > 0.0 else 0.0
        code = int(step + offset + curvature * step * (full_scale - step))
        return 0 if code < 0 else full_scale if code > full_scale else code

    return code
