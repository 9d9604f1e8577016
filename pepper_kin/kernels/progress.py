"""Progress messages while machine code is made."""

from __future__ import annotations

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Iterator

from pepper_kin.kernels.package_file import log_reasons

_logger = logging.getLogger(__name__)

PATIENCE = 2.0
"""Longest wait without a message [s]."""

_WIDTH = 30

_lock = threading.Lock()
_made: list[str] = []
_spent = 0.0
_reported = False
_expected = 0


def expect(count: int) -> None:
    """Set how many parts are expected to be made in all, for the bar."""
    global _expected
    _expected = count


@contextlib.contextmanager
def making(name: str) -> Iterator[None]:
    """Report that a part is being made, once making has taken `PATIENCE` in all.

    On a terminal a bar moves in one line; elsewhere one message of this module's logger says that it has
    begun.

    Args:
        name: The part.
    """
    global _spent
    begin = time.perf_counter()
    log_reasons()
    with _lock:
        timer = threading.Timer(max(PATIENCE - _spent, 0.0), _tell, (name,))
        timer.daemon = True
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with _lock:
            _spent += time.perf_counter() - begin
            _made.append(name)
            if _reported:
                _draw("")


def _tell(name: str) -> None:
    global _reported
    with _lock:
        if not _reported:
            _reported = True
            _logger.warning(
                "compiling machine code for this processor, once; the next run reads it from disk "
                "(`pepper-kin warm-up` compiles all of it, on all cores)"
            )
        _draw(name)


def _draw(name: str) -> None:
    if not sys.stderr.isatty():
        return
    expected = max(_expected, len(_made) + bool(name))
    filled = "#" * (_WIDTH * len(_made) // expected)
    sys.stderr.write(f"\r[{filled:<{_WIDTH}}] {len(_made)} of {expected} {name[:40]:<40}")
    if len(_made) == expected:
        sys.stderr.write("\r" + " " * (_WIDTH + 60) + "\r")
    sys.stderr.flush()
