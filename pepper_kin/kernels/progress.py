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
"""Longest wait without a message [s]."""

INTERVAL = 20.0
"""Time between messages where there is no terminal [s]."""

_WIDTH = 30

_lock = threading.Lock()
_spent = 0.0
_reported = False
_logged = 0.0


class WarmUpProgress(NamedTuple):
    """How far processes have come that make machine code.

    Attributes:
        ratio: Part of the work that is done, 0 to 1.
        remaining: Time that the rest takes [s]; None where nothing has been done yet.
    """

    ratio: float
    remaining: float | None

    def bar(self) -> str:
        """Return a bar, the percentage and the time that remains."""
        filled = "#" * round(_WIDTH * self.ratio)
        left = "" if self.remaining is None else f", {self.remaining:.0f} s left"
        return f"[{filled:<{_WIDTH}}] {100.0 * self.ratio:.0f} %{left}"


@contextlib.contextmanager
def making(name: str) -> Iterator[None]:
    """Report that a part is being made, once making has taken `PATIENCE` in all.

    Args:
        name: The part, shown on a terminal; elsewhere one message of this module's logger says that it has
            begun.
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
    """Log once that machine code is made; show what on a terminal, and elsewhere log it every `INTERVAL`."""
    global _reported, _logged
    name = name.encode("utf-8", "backslashreplace").decode()  # a caller's text may hold half a character
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
    """Show a text in the last line of a terminal, in place of what was shown there; nothing elsewhere."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{text[:79]:<79}\r")
        sys.stderr.flush()


def note_reason(reason: str) -> None:
    """Note why machine code may have to be made on this machine; it is logged once something is made."""
    _reasons.setdefault(reason, False)


def _log_reasons() -> None:
    for reason, logged in tuple(_reasons.items()):
        if not logged:
            _reasons[reason] = True
            _logger.warning("%s; it is made here, once, and kept", reason)


_reasons: dict[str, bool] = {}
"""Reasons, and whether they have been logged."""
