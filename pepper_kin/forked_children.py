"""New locks in forked children: a thread of the parent, which the child lacks, may have held the old ones."""

import os
import sys
import threading
from functools import cached_property


def _free_locks() -> None:
    """Replace each `_lock` of a module, and the locks of `cached_property` up to Python 3.11."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] != "pepper_kin":
            continue
        names = vars(module)
        if "_lock" in names:
            names["_lock"] = threading.RLock()
        for kind in list(names.values()):
            for value in list(vars(kind).values()) if isinstance(kind, type) else ():
                if isinstance(value, cached_property) and hasattr(value, "lock"):
                    value.lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_locks)
