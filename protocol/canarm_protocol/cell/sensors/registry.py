"""The kinds of sensor. A new kind is one line here and a file of its own."""

from ..table import Table
from .base import Quantity, Sensor
from .current_sense import CurrentSense
from .encoder import Encoder
from .potentiometer import Potentiometer
from .tachometer import Tachometer


class Sensors(Table):
    """The sensors of one joint: one table `[robot.joint.sensors.<kind>]` for each."""

    potentiometer: Potentiometer | None = None
    tachometer: Tachometer | None = None
    current_sense: CurrentSense | None = None
    encoder: Encoder | None = None

    def fitted(self) -> tuple[Sensor, ...]:
        """Those that the joint has, in the order of the registry."""
        return tuple(sensor for _, sensor in self if sensor is not None)

    def measuring(self, quantity: Quantity) -> Sensor | None:
        """The one that measures `quantity`; None without one."""
        return next((sensor for sensor in self.fitted() if sensor.quantity is quantity), None)


SENSOR_KINDS: dict[str, type[Sensor]] = {kind.kind: kind for kind in (Potentiometer, Tachometer, CurrentSense, Encoder)}
"""Every kind by its name."""
