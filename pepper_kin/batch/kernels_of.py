"""Compiled kernels of a robot's quantities, made once and kept."""

from __future__ import annotations

import hashlib
import threading
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import Kernel, compile_function
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    import casadi

_kept: WeakKeyDictionary[PepperModel, dict[tuple[object, ...], Kernel]] = WeakKeyDictionary()
_lock = threading.Lock()


def kernel(pepper: PepperModel, quantity: str, *args: object, dtype: str = "float64") -> Kernel:
    """Return the compiled kernel of a quantity: of `symbolic.function(pepper, quantity, *args)`.

    The first use compiles it (a fraction of a second for most, some seconds for derivatives) and keeps the
    machine code on disk; later uses, in other processes too, load it without building the expression.

    Args:
        pepper: The robot.
        quantity: A name of `symbolic.QUANTITIES`, such as "inverse_dynamics".
        *args: What that quantity takes besides the robot, such as a frame's name.
        dtype: "float64" or "float32".

    Returns:
        The kernel: call it with arrays of shape (N, n), `threads=` and `out=`.

    Raises:
        UnknownNameError: for a quantity or frame that is not known.
        InvalidValueError: for another dtype, arguments that are no names, or no robot.
    """
    if not isinstance(pepper, PepperModel):
        raise InvalidValueError("pepper", repr(pepper)[:80], "a PepperModel, as load_pepper gives")
    key = (quantity, *args, dtype)
    with _lock:
        try:
            found = _kept.setdefault(pepper, {}).get(key)
        except TypeError:
            allowed = "names, which can be hashed (a tuple for several)"
            raise InvalidValueError(f"arguments of {quantity}", repr(args)[:80], allowed) from None
    if found is None:
        found = compile_function(
            lambda: _expression(pepper, quantity, args), dtype=dtype, key=_disk_key(pepper, quantity, args)
        )
        with _lock:
            found = _kept[pepper].setdefault(key, found)
    return found


def _expression(pepper: PepperModel, quantity: str, args: tuple[object, ...]) -> casadi.Function:
    from pepper_kin import symbolic

    return symbolic.function(pepper, quantity, *args)


def _disk_key(pepper: PepperModel, quantity: str, args: tuple[object, ...]) -> str:
    """Name what the code depends on: the robot, the quantity and the source of the expressions."""
    return f"{quantity}{args!r} of {_robot_digest(pepper)} by {_source_digest()}"


@lru_cache(maxsize=32)
def _robot_digest(pepper: PepperModel) -> str:
    """Digest of the text, and of the model besides: it may have been given a payload or rotor inertias."""
    content = pepper.urdf + pepper.pinocchio_model.saveToString()
    return hashlib.sha256(content.encode()).hexdigest()


@lru_cache(maxsize=1)
def _source_digest() -> str:
    digest = hashlib.sha256()
    for room in ("symbolic", "model"):
        folder = files(f"pepper_kin.{room}")
        for file in sorted(folder.iterdir(), key=lambda f: f.name):
            if file.name.endswith(".py"):
                digest.update(file.read_bytes())
    return digest.hexdigest()
