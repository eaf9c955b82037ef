"""Which buses a rig of separate processes runs over, parsed from one word. Imports little: option parsing needs it."""

from dataclasses import dataclass

from canarm_protocol.shown import quoted

from .usage import UsageError

VIRTUAL = "virtual"
SOCKETCAN = "socketcan:"


@dataclass(frozen=True, slots=True)
class BusChoice:
    """Which buses: the emulator's own, or two of SocketCAN, the robot's and the bench's."""

    channels: tuple[str, str] | None = None

    @classmethod
    def parse(cls, text: str) -> "BusChoice":
        """`virtual`, or `socketcan:CHANNEL,CHANNEL`. Raises `UsageError`."""
        if text == VIRTUAL:
            return cls()
        robot, comma, bench = text.removeprefix(SOCKETCAN).partition(",")
        if not text.startswith(SOCKETCAN) or not (robot and comma and bench) or "," in bench:
            raise UsageError(
                f"bus {quoted(text)}: must be {VIRTUAL}, or {SOCKETCAN}vcan0,vcan1 (the robot's, the bench's)"
            )
        return cls((robot, bench))

    @property
    def flags(self) -> list[str]:
        """Extra options for emulator and controller, besides the address."""
        if self.channels is None:
            return []
        robot, bench = self.channels
        return ["-i", "socketcan", "-c", robot, "--bench-interface", "socketcan", "--bench-channel", bench]


VIRTUAL_BUSES = BusChoice()
"""The buses that the emulator itself serves."""
