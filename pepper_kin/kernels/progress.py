"""Progress messages while machine code is made."""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Iterator
from typing import NamedTuple

_logger = logging.getLogger(__name__)

PATIENCE = 2.0
"""Maximum time of making without a message [s]."""

INTERVAL = 20.0
"""Time between messages without a terminal [s]."""

_WIDTH = 30

_lock = threading.Lock()
_spent = 0.0
_reported = False
_logged = 0.0


class BuildProgress(NamedTuple):
    """Progress of the processes that make machine code.

    Attributes:
        ratio: Fraction of the work that is done, 0 to 1.
        remaining: Estimated remaining time [s]; None while it is unknown.
    """

    ratio: float
    remaining: float | None

    def bar(self) -> str:
        """Return a bar, the percentage and the remaining time as text."""
        filled = "#" * round(_WIDTH * self.ratio)
        left = "" if self.remaining is None else f", {self.remaining:.0f} s left"
        return f"[{filled:<{_WIDTH}}] {100.0 * self.ratio:.0f} %{left}"


@contextlib.contextmanager
def making(name: str) -> Iterator[None]:
    """Report that a part is being made, once making has taken `PATIENCE` in all.

    Args:
        name: Name of the part, shown on a terminal; without a terminal this module's logger logs the start.
    """
    global _spent
    begin = time.perf_counter()
    _log_reasons()
    with _lock:
        timer = threading.Timer(max(PATIENCE - _spent, 0.0), announce, (name,))
        timer.daemon = True
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with _lock:
            _spent += time.perf_counter() - begin
        if _reported:
            show("")


def announce(name: str) -> None:
    """Log once that machine code is made; show the name on a terminal, or log it every `INTERVAL`."""
    global _reported, _logged
    name = name.encode("utf-8", "backslashreplace").decode()  # a caller's text may hold a lone surrogate
    now, terminal = time.monotonic(), sys.stderr.isatty()
    with _lock:
        first, _reported = not _reported, True
        again = not first and not terminal and now - _logged >= INTERVAL
        if first or again:
            _logged = now
    if again:
        _logger.warning("%s", name)
    if first:
        _logger.warning(
            "compiling machine code for this processor, once; the next run reads it from disk "
            "(`pepper-kin warm-up` compiles all of it, on all cores)"
        )
    show(name)


def show(text: str) -> None:
    """Show a text in the last line of a terminal, in place of the last text; do nothing without one."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{text[:79]:<79}\r")
        sys.stderr.flush()


def note_reason(reason: str) -> None:
    """Record why machine code may have to be made on this machine; the reason is logged with the next one."""
    _reasons.setdefault(reason, False)


def _log_reasons() -> None:
    for reason, logged in tuple(_reasons.items()):
        if not logged:
            _reasons[reason] = True
            _logger.warning("%s; it is made here, once, and kept", reason)


_reasons: dict[str, bool] = {}
"""Reasons to make machine code -> whether they have been logged."""
