"""Distribution of the rows of a batch among threads.

Compiled code is called through ctypes, which releases the interpreter's lock, so threads run in parallel.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_PIECES_PER_THREAD = 4  # more than one, so that others do the pieces of a thread that loses its core
_SMALLEST_PIECE = 512  # minimum number of rows: for fewer, starting a thread costs more than it saves
LARGEST_PIECE = 65_536  # maximum number of rows, after which the interpreter handles interrupts

OWN_THREADS = "pepper_kin"
"""Prefix of the names of threads that belong to the library, not to the program that uses it."""

_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_pool_size = 0


def run_in_pieces(
    count: int,
    threads: int,
    multiple: int,
    run: Callable[[int, int], None],
    most: int = LARGEST_PIECE,
    progress: Callable[[int], object] = lambda rows: None,
) -> None:
    """Call `run(start, stop)` for consecutive ranges that cover `range(count)`.

    Args:
        count: Number of rows.
        threads: Number of threads, the calling one included.
        multiple: Ranges start at multiples of this number.
        run: Function that is called from several threads at once; its exception is passed to the caller.
        most: Maximum number of rows of a range, at least `multiple`.
        progress: Function that is called from the calling thread with about the number of rows done.
    """
    pieces = 1 if threads == 1 else threads * _PIECES_PER_THREAD
    length = min(max(_SMALLEST_PIECE, -(-count // pieces)), max(most // multiple, 1) * multiple)
    length = -(-length // multiple) * multiple
    chunks = deque((start, min(start + length, count)) for start in range(0, count, length))
    helpers = min(threads, len(chunks)) - 1

    def work(after: Callable[[int], object] = lambda rows: None) -> None:
        while chunks:
            try:
                chunk = chunks.popleft()
            except IndexError:  # another thread took the last one
                return
            run(*chunk)
            after(chunk[1])

    if helpers <= 0:
        work(progress)
        return
    futures = [_executor(helpers).submit(work) for _ in range(helpers)]
    try:
        work(progress)
    finally:
        chunks.clear()  # after an exception the others need not go on
        for future in futures:
            future.exception()  # wait: they use arrays of the caller
    for future in futures:
        future.result()
    progress(count)


def _executor(helpers: int) -> ThreadPoolExecutor:
    """Return a pool with at least a number of threads; it lives as long as the process."""
    global _pool, _pool_size
    with _lock:
        if _pool is None or _pool_size < helpers:
            _pool, _pool_size = ThreadPoolExecutor(helpers, OWN_THREADS), helpers
        return _pool


def _forget_pool() -> None:
    """Replace the pool in a forked child, where its threads do not exist."""
    global _lock, _pool, _pool_size
    _lock, _pool, _pool_size = threading.Lock(), None, 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pool)
