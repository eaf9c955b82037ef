"""How long the scheduler lets a thread run at a stretch, and so who gives way to whom, without any permission.

Linux from 6.12 on: of two threads of the ordinary class, that with the shorter slice has the earlier deadline, and runs
as soon as it wakes, also where the other one is running (sched(7), "EEVDF"). Elsewhere nothing is done.
"""

import ctypes
import os
import platform
import sys

LEAST_NS = 100_000
"""The shortest that Linux takes."""
PROMPT_NS = LEAST_NS
"""Of a loop whose cycles must not be late."""
PATIENT_NS = 20_000_000
"""Of what watches such a loop."""

_CALLS = {"x86_64": (314, 315), "aarch64": (274, 275), "riscv64": (274, 275)}
"""Numbers of sched_setattr and sched_getattr, by machine (Linux, asm/unistd.h)."""


class _SchedAttr(ctypes.Structure):
    """The first version of `struct sched_attr` (linux/sched/types.h)."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
    )


def set_time_slice(wanted_ns: int) -> int:
    """Set this thread's slice and return the old one, in ns; 0 where it has none: in a real-time class, elsewhere.

    Threads and processes that it starts later inherit it.
    """
    calls = _CALLS.get(platform.machine()) if sys.platform == "linux" and ctypes.sizeof(ctypes.c_void_p) == 8 else None
    if calls is None:
        return 0
    system = ctypes.CDLL(None).syscall
    attributes = _SchedAttr()
    size = ctypes.sizeof(attributes)
    if system(calls[1], 0, ctypes.byref(attributes), size, 0) != 0 or attributes.policy != os.SCHED_OTHER:
        return 0
    before_ns = int(attributes.runtime_ns)
    if not before_ns:
        return 0  # this kernel does not know it
    attributes.size, attributes.flags, attributes.runtime_ns = size, 0, wanted_ns
    return before_ns if system(calls[0], 0, ctypes.byref(attributes), 0) == 0 else 0
