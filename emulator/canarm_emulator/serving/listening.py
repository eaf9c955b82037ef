"""Listening TCP sockets, for the virtual bus and the serial adapter over TCP, with refusals in words.

Only loopback is served unless the user says otherwise. Handles clients for which no file descriptor is left.
"""

import contextlib
import errno
import ipaddress
import os
import socket
from collections.abc import Iterator

from ..errors import HubError, RefusedError

BACKLOG = 64
"""Connections that may wait to be accepted."""


class Listener:
    """A listening socket at `address`, a (host, port); errors name `option`, which the user can change.

    One descriptor is kept in reserve: at the limit of open files a connection could otherwise neither be accepted nor
    refused, and the socket would be readable for ever.
    """

    def __init__(self, host: str, port: int, allow_remote: bool, option: str = "--serve HOST:PORT") -> None:
        """Raises `HubError`: address in use or not of this machine, or not loopback without `allow_remote`."""
        self._socket = _listen(host, port, allow_remote, option)
        bound_host, bound_port = self._socket.getsockname()[:2]
        self.address: tuple[str, int] = (bound_host, bound_port)
        self.refused = 0
        """Connections that were closed at once since this process has as many files open as it may."""
        self._reserve = os.open(os.devnull, os.O_RDONLY)

    def fileno(self) -> int:
        """Readable when somebody wants to connect."""
        return self._socket.fileno()

    def accept(self, refusal: bytes = b"") -> Iterator[tuple[socket.socket, str]]:
        """Waiting connections with their addresses. Those for which there is no room are sent `refusal`."""
        while True:
            try:
                connection, address = self._socket.accept()
            except OSError as error:
                if error.errno not in (errno.EMFILE, errno.ENFILE) or not self._refuse(refusal):
                    return  # nobody waits any more, or a client has gone before it was accepted
                continue
            yield connection, f"{address[0]}:{address[1]}"

    def close(self) -> None:
        """Listen no longer. May be called again."""
        self._socket.close()
        if self._reserve >= 0:
            os.close(self._reserve)
            self._reserve = -1

    def _refuse(self, refusal: bytes) -> bool:
        """Refuse one connection with the reserve descriptor; returns whether there was one."""
        if self._reserve < 0:
            return False
        os.close(self._reserve)
        self._reserve = -1
        try:
            with self._socket.accept()[0] as connection:
                self.refused += 1
                with contextlib.suppress(OSError):
                    connection.setblocking(False)
                    connection.send(refusal)
        except OSError:
            return False
        finally:
            with contextlib.suppress(OSError):
                self._reserve = os.open(os.devnull, os.O_RDONLY)
        return True


def _listen(host: str, port: int, allow_remote: bool, option: str) -> socket.socket:
    """A non-blocking listener."""
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
        raise RefusedError(_explain(error, where, option)) from error
    return listener


def _explain(error: OSError, where: str, option: str) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"{where} is in use; stop the other emulator or choose another {option}"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{where} is no address of this machine; choose another {option}"
    if error.errno == errno.EACCES:
        return f"{where} is not allowed for this user; choose a port above 1023 in {option}"
    return f"cannot listen on {where}: {error.strerror or error}; choose another {option}"
