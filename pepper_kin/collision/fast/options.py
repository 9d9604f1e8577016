"""How the functions of this room are compiled."""

from __future__ import annotations

from typing import Any

from pepper_kin.kernels import host_target

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
"""Numba's options: kept on disk, without the interpreter's lock."""
VECTOR: dict[str, Any] = {**OPTIONS, "fastmath": {"nsz", "contract", "arcp", "nnan", "ninf"}}
"""The same for loops over lanes, in which nothing reorders sums."""
LANES = host_target().lanes("float32")
"""Configurations side by side in a vector register."""
POSE_LANES = host_target().lanes("float64")
"""The same of configurations whose exact poses are wanted."""
ROOM = 64
"""Configurations that go through the stages together."""
WIDEST = 16.0
"""Beyond this angle or distance [rad or m] single precision is not trusted: such a configuration is a tie."""
