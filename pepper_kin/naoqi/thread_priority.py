"""Threads that keep a clock, and threads that compute beside them.

A thread that wakes in time does not run in time: Linux lets another thread on the same core finish its time
slice of some milliseconds first, and the more so the more often the woken one has run of late.  Neither
function needs any privilege, nor changes what other programs get.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import struct
import sys
import threading

SLICE = 100_000
"""Time slice of a thread that wakes promptly [ns], the shortest that Linux grants."""

PATIENCE = 5
"""By how much `yield_to_others` raises the nice value."""

_SET_ATTRIBUTES = {"x86_64": 314, "aarch64": 274}
"""Number of the system call `sched_setattr`, which C libraries before glibc 2.41 lack."""


def wake_promptly() -> bool:
    """Ask for the shortest time slices for this thread; return whether the system has agreed.

    Since Linux 6.12 a thread that wakes may interrupt one whose slices are longer.  Elsewhere, and for
    threads that have a real-time policy already, nothing is changed.
    """
    number = _SET_ATTRIBUTES.get(platform.machine())
    if sys.platform != "linux" or number is None:
        return False
    try:
        nice, policy = os.getpriority(os.PRIO_PROCESS, 0), os.sched_getscheduler(0)
    except OSError:  # in some sandboxes
        return False
    if policy != os.SCHED_OTHER:
        return False
    # struct sched_attr: size, policy, flags, nice, priority, runtime, deadline, period
    attributes = struct.pack("=IIQiIQQQ", 48, policy, 0, nice, 0, SLICE, 0, 0)
    return bool(ctypes.CDLL(None).syscall(number, 0, attributes, 0) == 0)


def yield_to_others() -> None:
    """Raise the nice value of this thread for good, where each thread has one (Linux)."""
    if sys.platform == "linux":
        thread = threading.get_native_id()
        with contextlib.suppress(OSError):  # in some sandboxes
            nice = os.getpriority(os.PRIO_PROCESS, thread)
            os.setpriority(os.PRIO_PROCESS, thread, min(nice + PATIENCE, 19))
