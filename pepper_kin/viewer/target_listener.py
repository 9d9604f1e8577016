"""Callbacks for dragged targets, in a separate thread."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import read_only


class TargetListener:
    """Calls a function with each target's newest position, one call at a time.

    A callback that is slower than the dragging misses intermediate positions, never the last.

    Args:
        callback: Gets name and position, shape (3,) [m], read-only.  Its errors are printed, and the next
            position is still delivered.
    """

    def __init__(self, callback: Callable[[str, NDArray[np.float64]], object]) -> None:
        self._callback = callback
        self._newest: dict[str, NDArray[np.float64]] = {}
        self._changed = threading.Condition()
        self._ended = False
        threading.Thread(target=self._run, name="pepper-kin target listener", daemon=True).start()

    def hear(self, name: str, position: NDArray[np.float64]) -> None:
        """Queue a position [m], shape (3,), for the callback; return at once."""
        with self._changed:
            self._newest[name] = read_only(position)
            self._changed.notify()

    def stop(self) -> None:
        """Stop; no further call is started."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest or self._ended)
                if self._ended:
                    return
                waiting, self._newest = self._newest, {}
            for name, position in waiting.items():
                try:
                    self._callback(name, position)
                except Exception:
                    traceback.print_exc()
