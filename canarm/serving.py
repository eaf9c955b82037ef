"""Texts about an emulator's buses: how to attach, and who else can.

Sockets belong to the emulator.
"""

import ipaddress
import socket
from collections.abc import Mapping

from canarm_protocol.transport.port import bus_flags

from .options import BENCH_BUS, LOSSY, ROBOT_BUS, NamedBus

EVERY_ADDRESS = ("0.0.0.0", "::")
ELSEWHERE = ("192.0.2.1", 9)
"""A documentation address of RFC 5737: nothing is sent to it."""
WHAT_IS_OPEN = {ROBOT_BUS: "drive the robot and read its bus", BENCH_BUS: "set faults and read everything"}


def attach_flags(bus: str, host: str, port: int) -> str:
    """The flags with which python-can's tools and ours attach to a virtual bus."""
    return bus_flags("canarm", bus, {"host": reachable_host(host), "port": port})


def reachable_host(host: str) -> str:
    """The host for a client: if all addresses are served, the one towards the network, or the machine's name."""
    if host not in EVERY_ADDRESS:
        return host
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(ELSEWHERE)
            return str(probe.getsockname()[0])
    except OSError:
        return socket.gethostname() or host


def is_remote(host: str) -> bool:
    """Whether other machines can reach a listener on `host`, a numeric address."""
    return not ipaddress.ip_address(host.partition("%")[0]).is_loopback


def exposure_lines(
    hub: tuple[str, int], adapter: tuple[str, int] | None, buses: Mapping[str, NamedBus | None]
) -> list[str]:
    """A line for each address, and for each bus on a network, that other machines can reach."""
    lines = []
    if is_remote(hub[0]):
        what = f"drive the robot, {WHAT_IS_OPEN[BENCH_BUS]}"
        lines.append(f"{hub[0]}:{hub[1]} is open to other machines: whoever reaches it can {what}")
    if adapter is not None and is_remote(adapter[0]):
        lines.append(
            f"{adapter[0]}:{adapter[1]} (slcan) is open to other machines: whoever reaches it can "
            f"{WHAT_IS_OPEN[ROBOT_BUS]}"
        )
    for bus, named in buses.items():
        if named is not None and named.reaches_network:
            lines.append(
                f"-i {LOSSY} carries {bus} to the network: whoever reaches this machine or the group can "
                f"{WHAT_IS_OPEN[bus]}"
            )
    return lines
