"""Waits for changes of file descriptors, where the system has such a thing: what has been told once is not told again.

A pseudo-terminal that nobody uses is at its end all the time; here that end is told once, and then each time that
somebody has opened and left the terminal, even without a word. Terminals and protocols never enter.
"""

import select
import selectors

from .hub_events import HasFileno


class EdgeSelector:
    """The part of `selectors.BaseSelector` that a port needs, with epoll's edges in place of levels.

    Input that is not read to its end is told again only after `modify`.
    """

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._keys: dict[int, selectors.SelectorKey] = {}

    def register(self, fileobj: HasFileno, events: int) -> None:
        """Wait for `events` of `fileobj` from now on. That it is at its end already is no news."""
        fd = fileobj.fileno()
        self._keys[fd] = selectors.SelectorKey(fileobj, fd, events, None)
        self._epoll.register(fd, _flags(events))
        if any(found == fd and flags & select.EPOLLIN for found, flags in self._epoll.poll(0)):
            self.modify(fileobj, events)

    def modify(self, fileobj: HasFileno, events: int) -> None:
        """Wait for `events` from now on, and tell once more of what is there by now."""
        fd = fileobj.fileno()
        self._keys[fd] = selectors.SelectorKey(fileobj, fd, events, None)
        self._epoll.modify(fd, _flags(events))

    def unregister(self, fileobj: HasFileno) -> None:
        """Wait for `fileobj` no more."""
        fd = fileobj.fileno()
        del self._keys[fd]
        self._epoll.unregister(fd)

    def select(self, timeout_s: float) -> list[tuple[selectors.SelectorKey, int]]:
        """What has happened, as in `selectors`. An end, or an error, counts as something to read."""
        happened = []
        for fd, flags in self._epoll.poll(timeout_s):
            events = selectors.EVENT_WRITE if flags & select.EPOLLOUT else 0
            events |= selectors.EVENT_READ if flags & ~select.EPOLLOUT else 0
            happened.append((self._keys[fd], events))
        return happened

    def fileno(self) -> int:
        """One descriptor that is readable when `select` has something."""
        return self._epoll.fileno()

    def close(self) -> None:
        """Give the descriptor back. May be called again."""
        self._keys.clear()
        self._epoll.close()


def _flags(events: int) -> int:
    reading = select.EPOLLIN if events & selectors.EVENT_READ else 0
    writing = select.EPOLLOUT if events & selectors.EVENT_WRITE else 0
    return reading | writing | select.EPOLLET
