"""Import of libqi's package `qi`, with settings (extra `naoqi`).

libqi brings Boost 1.83, and coal, the library of the collision checks, another Boost.  Both have common
symbols, of which a process keeps the first loaded ones.  With coal's symbols, the first bytes on a
connection that are no messages of libqi end the process by a segmentation fault; with libqi's symbols both
work.  So servers import this module first.
"""

from __future__ import annotations

import os
from typing import Any

from pepper_kin.exceptions import optional

SETTINGS = {
    "QI_LOG_LEVEL": "2",  # errors; libqi logs each service that it registers
    "QI_EVENTLOOP_THREAD_COUNT": "24",
    "QI_EVENTLOOP_MAX_THREADS": "256",
}
"""Environment variables of libqi, read when it is loaded.

A blocking call occupies one of libqi's threads, of which it starts with three; while all are occupied,
further calls wait for a second or two.
"""


def libqi() -> Any:
    """Return the module `qi`.

    Raises:
        MissingDependencyError: if `qi` is not installed.
    """
    unset = "QI_LOG_LEVEL" not in os.environ
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    qi = optional("qi", extra="naoqi", need="a connection by NAOqi's messages")
    if unset:  # a program may have imported it before, without the settings
        qi.logging.setLevel(qi.logging.ERROR)
    return qi
