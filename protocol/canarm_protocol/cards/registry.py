"""Every kind of card by its name, in the order in which they are listed to users."""

from collections.abc import Mapping

from .adc import ADC
from .adc0809 import ADC0809
from .dac import DAC
from .dac0808 import DAC0808
from .encoder_counter import ENCODER_COUNTER
from .kind import CardKind
from .sc300 import SC300

KINDS: Mapping[str, CardKind] = {
    kind.model: kind
    for kind in (
        DAC0808,
        SC300,
        ADC0809,
        DAC,
        ADC,
        ENCODER_COUNTER,
    )
}
