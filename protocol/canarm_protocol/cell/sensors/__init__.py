"""The kinds of sensor that a joint can have: one file each, and `registry.py` lists them."""

from .base import AnalogueSensor, Fitting, Quantity, Sensor, SensorScale
from .current_sense import CurrentSense
from .potentiometer import Potentiometer
from .registry import SENSOR_KINDS, Sensors
from .tachometer import Tachometer

__all__ = [
    "SENSOR_KINDS",
    "AnalogueSensor",
    "CurrentSense",
    "Fitting",
    "Potentiometer",
    "Quantity",
    "Sensor",
    "SensorScale",
    "Sensors",
    "Tachometer",
]
