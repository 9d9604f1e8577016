"""A word to those who wait: what is compiled on first use takes up to a minute, and says so meanwhile."""

from __future__ import annotations

import logging
import threading
import time

_logger = logging.getLogger(__name__)

PATIENCE = 4.0
"""Waiting so long for code without a word is fine [s]; loading it from disk takes less."""


class Compilation:
    """Tells that something is being compiled, once it takes long, and at its end how long it took.

        compilation = Compilation("the fast solver")
        ...                                             # functions that Numba compiles at once
        compilation.end(compiled=bool(f.stats.cache_misses))

    Both are warnings of this module's logger, which Python prints on the error stream by default.

    Args:
        what: What is compiled, with its article.
        patience: How long to wait for the end before the first word [s].
    """

    def __init__(self, what: str, patience: float = PATIENCE) -> None:
        self._what, self._begin = what, time.perf_counter()
        self._timer = threading.Timer(patience, self._tell)
        self._timer.daemon = True
        self._timer.start()

    def end(self, compiled: bool) -> None:
        """Stop the clock.

        Args:
            compiled: Whether anything was compiled, and not only loaded from disk.
        """
        self._timer.cancel()
        if compiled:
            seconds = time.perf_counter() - self._begin
            _logger.warning(
                "compiled %s, once on this machine, in %.1f s; from now on it is loaded from disk",
                self._what,
                seconds,
            )

    def _tell(self) -> None:
        _logger.warning("compiling %s, once on this machine; it may take a minute ...", self._what)
