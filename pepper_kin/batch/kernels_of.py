"""Compiled kernels of a robot's quantities, built once and cached."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import Kernel, compile_function, host_target, source_digest
from pepper_kin.model import PepperModel, RobotMemory, robot_digest

if TYPE_CHECKING:
    import casadi

_PACKAGE_VECTOR_BYTES = 32

_kept: RobotMemory[tuple[object, ...], Kernel] = RobotMemory()
_lock = threading.Lock()


def kernel(
    pepper: PepperModel, quantity: str, *args: object, dtype: str = "float64", wide: bool = False
) -> Kernel:
    """Return the compiled kernel of `symbolic.function(pepper, quantity, *args)`.

    The first use compiles it (a fraction of a second for most, some seconds for derivatives) and caches the
    machine code on disk; later uses, in other processes too, load it without building the expression.

    Args:
        pepper: The robot.
        quantity: Name of a quantity, see `symbolic.QUANTITIES`, such as "inverse_dynamics".
        *args: Arguments of the quantity after the robot, such as a frame's name.
        dtype: "float64" or "float32".
        wide: Whether to use the widest vectors of the processor, which pays for tens of thousands of states;
            otherwise vectors of 32 bytes, for which the package has code of everyday quantities.

    Returns:
        The kernel, to be called with arrays of shape (N, n), `threads=` and `out=`.

    Raises:
        UnknownNameError: for an unknown quantity or frame.
        InvalidValueError: for another dtype, arguments that are not names, or anything but a robot.
    """
    if not isinstance(pepper, PepperModel):
        raise InvalidValueError("pepper", repr(pepper), "a PepperModel, as load_pepper gives")
    width = host_target().vector_bytes if wide else _PACKAGE_VECTOR_BYTES
    key = (quantity, *args, dtype, width)
    with _lock:
        try:
            known = _kept.of(pepper)
            found = known.get(key)
        except TypeError:
            allowed = "names, which can be hashed (a tuple for several)"
            raise InvalidValueError(f"arguments of {quantity}", repr(args), allowed) from None
    if found is None:
        sources = source_digest("pepper_kin.symbolic", "pepper_kin.model", __name__)
        found = compile_function(
            lambda: _expression(pepper, quantity, args),
            dtype=dtype,
            key=f"{quantity}{args!r} of {robot_digest(pepper)} by {sources}",
            vector_bytes=width,
        )
        with _lock:
            found = known.setdefault(key, found)
    return found


def _expression(pepper: PepperModel, quantity: str, args: tuple[object, ...]) -> casadi.Function:
    from pepper_kin import symbolic

    return symbolic.function(pepper, quantity, *args)
