"""A simulated robot in a separate process, for dry runs."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InfeasibleError

START = 120.0
"""Maximum time for the process to start [s]."""

END = 30.0
"""Maximum time for the process to end [s]."""


@contextmanager
def hosted_twin(scene: Scene | None = None, *options: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Host the modules in another process on loopback; yield the address and the process.

    Args:
        scene: Obstacles around the robot, and attached objects.
        options: Further options of `pepper-kin naoqi serve`.

    Raises:
        InfeasibleError: if the process does not start.
    """
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as errors:
        command = [sys.executable, "-P", "-c", "from pepper_kin.cli import main; main()"]
        command += ["naoqi", "serve", "--port", "0", *options]
        if scene is not None:
            scene.save(Path(folder) / "scene.json")
            command += ["--scene", str(Path(folder) / "scene.json")]
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
        )
        late = threading.Timer(START, process.kill)
        late.start()
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            late.cancel()
            if not line.startswith("tcp://"):
                process.kill()
                process.wait(END)
                errors.seek(0)
                reason = errors.read().strip().splitlines() or ["it did not start"]
                raise InfeasibleError("simulated robot", reason[-1], "run: pepper-kin naoqi serve --port 0")
            # libqi logs to stdout: unread, the pipe would fill up, and the process would wait for ever.
            threading.Thread(
                target=deque, args=(process.stdout, 0), name="hosted-twin-log", daemon=True
            ).start()
            yield line.split(": ")[0], process
        finally:
            late.cancel()
            process.terminate()
            try:
                process.wait(END)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(END)
