"""Checks at the door: joint vectors of the right length, finite, and within limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.exceptions import InvalidValueError, LimitError, did_you_mean

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pepper_kin.model.pepper_model import PepperModel


def as_finite(value: ArrayLike, quantity: str, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Convert to an array of finite floats of a given shape.

    Args:
        value: Array-like.
        quantity: Name for the message.
        shape: Expected shape; None stands for any length.

    Returns:
        The array (a view where no conversion was needed).

    Raises:
        InvalidValueError: naming the quantity and what is wrong.
    """
    try:
        array = _as_floats(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(quantity, repr(value), f"numbers of shape {_shape_text(shape)}") from error
    if array.shape != shape and (
        len(array.shape) != len(shape)
        or any(s is not None and s != a for s, a in zip(shape, array.shape, strict=True))
    ):
        raise InvalidValueError(quantity, f"shape {array.shape}", f"shape {_shape_text(shape)}")
    if not np.isfinite(array).all():
        raise InvalidValueError(
            quantity, array[~np.isfinite(array)][0], "finite numbers (no NaN, no infinity)"
        )
    return array


def _shape_text(shape: tuple[int | None, ...]) -> str:
    """Return a shape for a message; k stands for any length."""
    return (
        "(" + ", ".join("k" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
    )


def _as_floats(value: ArrayLike) -> NDArray[np.float64]:
    """Convert numbers, and nothing else that NumPy would turn into some: dates, texts, complex numbers."""
    array = np.asarray(value)
    if array.dtype.kind not in "biufO":
        raise TypeError(f"an array of {array.dtype}")
    return array.astype(np.float64, copy=False)


def as_joint_vectors(pepper: PepperModel, value: ArrayLike, quantity: str) -> NDArray[np.float64]:
    """Convert to joint vectors with leading batch axes, shape (..., n).

    Args:
        pepper: The robot, which gives n and the joint names.
        value: Array-like whose last axis has length n.
        quantity: Name for the message, such as "q".

    Returns:
        Array of finite floats, shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, or naming the joint that is NaN or infinite.
    """
    # One vector of floats is the usual case; a sum of squares that overflows is looked at below.
    if (
        type(value) is np.ndarray
        and value.dtype == np.float64
        and value.shape == (pepper.n,)
        and value.dot(value) < np.inf
    ):
        return value
    try:
        array = _as_floats(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(quantity, repr(value), f"numbers of shape (..., {pepper.n})") from error
    if array.ndim == 0 or array.shape[-1] != pepper.n:
        raise InvalidValueError(
            quantity,
            f"shape {array.shape}",
            f"shape (..., {pepper.n}), one value per joint: {', '.join(pepper.joint_names)}",
        )
    if not np.isfinite(array).all():
        index = tuple(np.argwhere(~np.isfinite(array))[0])
        raise InvalidValueError(
            quantity, f"{array[index]} at joint {pepper.joint_names[index[-1]]}", "finite numbers"
        )
    return array


def check_within_limits(
    pepper: PepperModel, q: NDArray[np.float64], quantity: str, tolerance: float = 1e-9
) -> None:
    """Refuse positions outside the joint limits.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        quantity: Name for the message, such as "start".
        tolerance: Violation allowed [rad or m].

    Raises:
        LimitError: naming the worst joint, its value and its limits.
    """
    if (q >= pepper.lower_limits).all() and (q <= pepper.upper_limits).all():
        return
    violation = np.maximum(pepper.lower_limits - q, q - pepper.upper_limits)
    if violation.size and violation.max() > tolerance:
        index = np.unravel_index(int(np.argmax(violation)), violation.shape)
        joint = int(index[-1])
        raise LimitError(
            quantity,
            pepper.joint_names[joint],
            float(q[index]),
            float(pepper.lower_limits[joint]),
            float(pepper.upper_limits[joint]),
            pepper.joint_units[joint],
        )


def check_choice(quantity: str, value: str, choices: tuple[str, ...]) -> str:
    """Return `value` if it is one of `choices`.

    Raises:
        InvalidValueError: listing the choices, with the one that is most like a wrong value.
    """
    if value not in choices:
        allowed = f"one of {', '.join(map(repr, choices))}{did_you_mean(value, choices)}"
        raise InvalidValueError(quantity, repr(value), allowed)
    return value


def check_positive(quantity: str, value: float, unit: str = "") -> float:
    """Return `value` as a float if it is finite and above zero.

    Raises:
        InvalidValueError: naming the quantity.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not (math.isfinite(number) and number > 0):
        raise InvalidValueError(quantity, value, f"a finite number above 0{' ' + unit if unit else ''}")
    return number
