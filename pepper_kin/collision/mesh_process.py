"""Mesh files read by trimesh in a separate process, with limits of time and memory.

COLLADA, PLY, glTF and other formats hold references, repetitions and compressed parts: a small file can
require endless work or all memory.  The process is killed when it exceeds the limits, which protects the
caller.  It is started with the first such file, and serves all later ones.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import FileFormatError, MissingDependencyError

SECONDS = 8.0
"""Maximum time to read a file [s], in addition to SECONDS_PER_BYTE for each byte of it."""
SECONDS_PER_BYTE = 4e-7
START = 60.0
"""Maximum time for the process to start [s]."""
MEMORY = 800_000_000
"""Maximum memory to read a file [bytes], in addition to MEMORY_PER_BYTE for each byte of it."""
MEMORY_PER_BYTE = 40

_SERVER = Path(__file__).with_name("mesh_server.py")
_lock = threading.Lock()
_process: subprocess.Popen[bytes] | None = None
_owner = 0


def mesh_of_other_format(file: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """Read a mesh of a format that trimesh supports, such as COLLADA, PLY or glTF.

    The transforms of the file's scene and its unit are applied.  Its up axis is not, as in ROS: robot
    descriptions are made for programs that ignore it (TIAGo's parts would lie on their sides).

    Args:
        file: The file; its suffix determines the format.

    Returns:
        Vertices, shape (k, 3) [m]; faces, shape (f, 3), indices of vertices; and the faces' colors, shape
        (f, 4), red, green, blue and opacity from 0 to 255, or (0, 4) if the file has none.

    Raises:
        FileFormatError: naming the file, if it cannot be read, or exceeds SECONDS or MEMORY.
    """
    with _lock:
        try:
            head, parts = _answer(_running(), file)
        except BaseException:
            _end()  # a rest of this answer would be read as the next file's
            raise
    if "error" in head:
        raise FileFormatError(file, f"cannot be read as a mesh: {head['error']}")
    vertices, faces, colors = parts
    return vertices, faces, colors


def _running() -> subprocess.Popen[bytes]:
    """Return the process, a new one after a fork, which would otherwise share its pipes."""
    global _process, _owner
    if _process is not None and (_owner != os.getpid() or _process.poll() is not None):
        _process = None
    if _process is None:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        _owner = os.getpid()
        _process = subprocess.Popen(
            [sys.executable, "-P", str(_SERVER)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        with _ended_after(START, _process):
            started = cast("IO[bytes]", _process.stdout).read(1)
        if not started:
            raise MissingDependencyError(
                "trimesh and pycollada", "pip install trimesh pycollada", "reading this format of meshes"
            )
    return _process


def _answer(process: subprocess.Popen[bytes], file: Path) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Return the header of the answer, and the arrays that it announces."""
    size = file.stat().st_size
    memory, seconds = MEMORY + MEMORY_PER_BYTE * size, SECONDS + SECONDS_PER_BYTE * size
    request = json.dumps({"path": str(file.absolute()), "memory": memory}).encode() + b"\n"
    requests, answers = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
    with _ended_after(seconds, process) as late:
        try:
            requests.write(request)
            requests.flush()
            head = json.loads(_exactly(answers, int.from_bytes(_exactly(answers, 8), "little")))
            parts = [
                np.frombuffer(_exactly(answers, np.dtype(kind).itemsize * int(np.prod(shape))), kind)
                for kind, shape in head.get("arrays", ())
            ]
        except (OSError, EOFError) as error:
            reason = (
                f"it takes more than {seconds:.2g} s" if late.is_set() else "the process that read it ended"
            )
            raise FileFormatError(file, f"cannot be read as a mesh: {reason}") from error
    shapes = [shape for _, shape in head.get("arrays", ())]
    return head, [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def _exactly(stream: IO[bytes], count: int) -> bytes:
    """Return exactly `count` bytes of a stream, or raise EOFError."""
    content = stream.read(count)
    if len(content) < count:
        raise EOFError
    return content


@contextlib.contextmanager
def _ended_after(seconds: float, process: subprocess.Popen[bytes]) -> Iterator[threading.Event]:
    """Kill the process, so that reading from it returns, if the block takes longer [s]."""
    late = threading.Event()

    def end() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield late
    finally:
        timer.cancel()


def _end() -> None:
    """Kill the process, if this process started it."""
    global _process
    process, _process = _process, None
    if process is None or _owner != os.getpid():
        return
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    process.wait()


atexit.register(_end)
