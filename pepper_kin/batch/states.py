"""Leading batch axes around functions of one state: few states one by one, many by a compiled kernel."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.batch.kernels_of import kernel
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors

KERNEL_FROM = 24
"""Number of states from which on a kernel is used: below, its call costs as much as the states."""

Array = NDArray[np.float64]


def over_states(
    pepper: PepperModel,
    function: Callable[..., Array],
    shape: tuple[int, ...],
    quantity: tuple[object, ...] | None,
    **quantities: ArrayLike,
) -> Array:
    """Evaluate a function of one state for every state of a batch.

    Args:
        pepper: The robot.
        function: Takes one (n,) vector per quantity and returns an array of shape `shape` (which it may
            overwrite at its next call).
        shape: Shape of one result.
        quantity: Name of the same function in `symbolic.QUANTITIES`, and what it takes besides the robot;
            None where there is no kernel for it.
        **quantities: Joint vectors with leading batch axes, shape (..., n), by the name used in messages;
            their batch axes broadcast against one another.

    Returns:
        Results, shape (..., *shape).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    arrays = [_shaped(pepper, value, name) for name, value in quantities.items()]
    if all(array.ndim == 1 for array in arrays):
        return np.array(function(*_finite(pepper, arrays, quantities)), dtype=float).reshape(shape)
    batch = _batch_axes(arrays, quantities)
    count = math.prod(batch)
    if quantity is not None and count >= KERNEL_FROM:
        return _by_kernel(pepper, quantity, shape, arrays, batch, quantities)
    flat = [np.broadcast_to(a, (*batch, pepper.n)).reshape(-1, pepper.n) for a in arrays]
    result = np.empty((count, *shape))
    for i, state in enumerate(zip(*_finite(pepper, flat, quantities), strict=True)):
        result[i] = np.reshape(function(*state), shape)
    return result.reshape(*batch, *shape)


def _by_kernel(
    pepper: PepperModel,
    quantity: tuple[object, ...],
    shape: tuple[int, ...],
    arrays: list[Array],
    batch: tuple[int, ...],
    quantities: dict[str, ArrayLike],
) -> Array:
    name, *args = quantity
    compiled = kernel(pepper, str(name), *args)
    flat = [
        a if a.ndim == 1 else np.broadcast_to(a, (*batch, pepper.n)).reshape(-1, pepper.n) for a in arrays
    ]
    try:
        result = compiled(*flat)
    except InvalidValueError:
        _finite(pepper, arrays, quantities)  # says which joint it is
        raise
    if isinstance(result, tuple):
        result = np.stack(result, axis=1)
    return np.asarray(result).reshape(*batch, *shape)


def _shaped(pepper: PepperModel, value: ArrayLike, name: str) -> Array:
    """Convert to floats with n columns; finiteness is looked at where the values are read."""
    if (
        isinstance(value, np.ndarray)
        and value.dtype == np.float64
        and value.ndim
        and value.shape[-1] == pepper.n
    ):
        return value
    return as_joint_vectors(pepper, value, name)


def _finite(pepper: PepperModel, arrays: list[Array], quantities: dict[str, ArrayLike]) -> list[Array]:
    return [as_joint_vectors(pepper, array, name) for array, name in zip(arrays, quantities, strict=True)]


def _batch_axes(arrays: list[Array], quantities: dict[str, ArrayLike]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    except ValueError:
        shapes = ", ".join(f"{n}: {a.shape[:-1]}" for n, a in zip(quantities, arrays, strict=True))
        raise InvalidValueError(
            "batch axes", shapes, "leading axes that broadcast against one another"
        ) from None
