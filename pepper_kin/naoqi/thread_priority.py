"""Scheduling of threads that keep a clock, and of threads that compute at the same time.

A thread that wakes in time may run late: Linux lets another thread on the same core finish its time
slice of some milliseconds first, more often if the woken thread has run much recently.  Neither
function needs privileges or affects other programs.
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
"""Time slice of a thread that wakes promptly [ns]: the minimum of Linux."""

PATIENCE = 5
"""Increment of the nice value by `yield_to_others`."""

_SET_ATTRIBUTES = {"x86_64": 314, "aarch64": 274}
"""Number of the system call `sched_setattr`, which C libraries before glibc 2.41 lack."""


def wake_promptly() -> bool:
    """Request the shortest time slices for this thread; return whether the system has granted them.

    Since Linux 6.12 a waking thread may interrupt one with longer slices.  On other systems, and for
    threads with a real-time policy, nothing is changed.
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
    """Raise the nice value of this thread permanently, on Linux, where each thread has its own."""
    if sys.platform == "linux":
        thread = threading.get_native_id()
        with contextlib.suppress(OSError):  # in some sandboxes
            nice = os.getpriority(os.PRIO_PROCESS, thread)
            os.setpriority(os.PRIO_PROCESS, thread, min(nice + PATIENCE, 19))
