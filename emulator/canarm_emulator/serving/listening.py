"""Opening a listening TCP socket, with refusals in words: for the virtual bus and the serial adapter over TCP.

Owns the rule that nothing but loopback is served unless the user says so.
"""

import errno
import ipaddress
import os
import socket

from ..errors import HubError

BACKLOG = 64
"""Connections that may wait to be accepted."""


def listen(host: str, port: int, allow_remote: bool, option: str = "--serve HOST:PORT") -> socket.socket:
    """A non-blocking listener. `option` is what the user changes when it fails.

    Raises `HubError`: address in use or not of this machine, or not loopback without `allow_remote`.
    """
    where = f"{host}:{port}"
    if not 0 <= port < 65536:
        raise HubError(f"{where}: a port is a number from 1 to 65535, or 0 for any free one")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host or "0.0.0.0", port, type=socket.SOCK_STREAM)[0]
    except (socket.gaierror, UnicodeError):
        raise HubError(f"{where}: unknown host; take 127.0.0.1 or an address of this machine") from None
    if not allow_remote and not ipaddress.ip_address(address[0]).is_loopback:
        raise HubError(
            f"{where} can be reached from the network, and whoever reaches it drives the robot; "
            "take 127.0.0.1, or say --allow-remote if that is meant"
        )
    listener = socket.socket(family, kind, protocol)
    try:
        if os.name == "posix":
            # Elsewhere this would let two servers share the port.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise HubError(_explain(error, where, option)) from error
    return listener


def _explain(error: OSError, where: str, option: str) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"{where} is in use; stop the other emulator or choose another {option}"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{where} is no address of this machine; choose another {option}"
    if error.errno == errno.EACCES:
        return f"{where} is not allowed for this user; choose a port above 1023 in {option}"
    return f"cannot listen on {where}: {error.strerror or error}; choose another {option}"
