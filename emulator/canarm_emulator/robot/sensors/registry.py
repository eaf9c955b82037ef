"""The kinds of sensor in the true robot, by the names that they have in a cell. A new kind is one line here."""

from canarm_protocol.cell.sensing import WiredSensor

from ..joint_truth import JointTruth
from .base import SensorKind, Source
from .current_sense import CURRENT_SENSE
from .encoder import ENCODER
from .potentiometer import POTENTIOMETER
from .tachometer import TACHOMETER

SENSORS: dict[str, SensorKind] = {
    "potentiometer": POTENTIOMETER,
    "tachometer": TACHOMETER,
    "current_sense": CURRENT_SENSE,
    "encoder": ENCODER,
}


def source(wired: WiredSensor, truth: JointTruth) -> Source:
    """The true sensor at a channel of a card; true offsets are part of its zero."""
    return SENSORS[wired.sensor.kind].make(wired, truth.sensors)
