"""Leading batch axes around functions of one state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.model.pepper_model import PepperModel


def over_states(
    pepper: PepperModel,
    function: Callable[..., NDArray[np.float64]],
    shape: tuple[int, ...],
    **quantities: ArrayLike,
) -> NDArray[np.float64]:
    """Evaluate a function of one state for every state of a batch.

    Args:
        pepper: The robot.
        function: Takes one (n,) vector per quantity and returns an array of shape `shape` (which it may
            overwrite at its next call).
        shape: Shape of one result.
        **quantities: Joint vectors with leading batch axes, shape (..., n), by the name used in messages;
            their batch axes broadcast against one another.

    Returns:
        Results, shape (..., *shape).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    arrays = [as_joint_vectors(pepper, value, name) for name, value in quantities.items()]
    if all(array.ndim == 1 for array in arrays):
        return np.array(function(*arrays), dtype=float).reshape(shape)
    try:
        arrays = list(np.broadcast_arrays(*arrays))
    except ValueError:
        shapes = ", ".join(f"{n}: {a.shape[:-1]}" for n, a in zip(quantities, arrays, strict=True))
        raise InvalidValueError(
            "batch axes", shapes, "leading axes that broadcast against one another"
        ) from None
    batch = arrays[0].shape[:-1]
    flat = [array.reshape(-1, pepper.n) for array in arrays]
    result = np.empty((flat[0].shape[0], *shape))
    for i, state in enumerate(zip(*flat, strict=True)):
        result[i] = np.reshape(function(*state), shape)
    return result.reshape(*batch, *shape)
