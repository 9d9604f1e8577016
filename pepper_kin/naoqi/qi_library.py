"""libqi as the package `qi`, with its settings (extra `naoqi`).

libqi brings Boost 1.83, and coal, of the collision checks, another one.  Both have symbols of which a process
keeps one only, the first.  With those of coal, the first bytes on a connection that are no messages of libqi
end the process by a segmentation fault; with those of libqi both work.  So servers import this first.
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
"""Environment of libqi, read as it is loaded.

A call that blocks keeps one of its threads, of which it has three at first; with all of them kept, others
wait for a second or two.
"""


def libqi() -> Any:
    """Return the module `qi`.

    Raises:
        MissingDependencyError: where it is not installed.
    """
    unset = "QI_LOG_LEVEL" not in os.environ
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    qi = optional("qi", extra="naoqi", need="a connection by NAOqi's messages")
    if unset:  # a program may have imported it first, and libqi read no settings
        qi.logging.setLevel(qi.logging.ERROR)
    return qi
