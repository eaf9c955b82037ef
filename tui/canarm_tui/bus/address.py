"""A bus as the command line names it, not yet open."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from canarm_protocol.transport.port import BusPort, open_port


@dataclass(frozen=True, slots=True)
class BusAddress:
    """`-i interface -c channel key=value …`"""

    interface: str
    channel: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def where(self) -> str:
        """The bus as on the command line."""
        words = [f"-i {self.interface}", *([] if self.channel is None else [f"-c {self.channel}"])]
        return " ".join([*words, *(f"{key}={value}" for key, value in self.options.items())])

    def open(self) -> BusPort:
        """Open it. Raises `BusError`."""
        return open_port(self.interface, self.channel, **self.options)
