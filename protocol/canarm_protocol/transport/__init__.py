"""Access to a CAN bus: any interface of python-can, and the virtual bus that the emulator serves."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .hub_client import HubClientBus
    from .port import BusPort, open_port, parse_bus_options

__all__ = ["BusPort", "HubClientBus", "open_port", "parse_bus_options"]

__getattr__ = loader(__name__, __all__, ".port", ".hub_client")
