"""Vectors and lists of points, checked, copied and read-only."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def coordinate_name(quantity: str, index: int, labels: Sequence[str] | None = None) -> str:
    """Name one coordinate of a quantity for a message: ``start[2] (HeadYaw)``."""
    return f"{quantity}[{index}]" if labels is None else f"{quantity}[{index}] ({labels[index]})"


def read_only(array: FloatArray) -> FloatArray:
    """Return the array itself, locked against writing."""
    array.setflags(write=False)
    return array


def _numbers(quantity: str, value: ArrayLike, allowed: str) -> FloatArray:
    """Return numbers, of any shape, as a new float64 array in C order.

    Raises:
        InvalidValueError: for anything but real numbers in equal rows; the message says what is allowed.
    """
    try:
        array = np.asarray(value)
    except (ValueError, OverflowError, RecursionError):  # ragged rows, lists without end
        raise InvalidValueError(quantity, value, allowed) from None
    if array.dtype.kind not in "fiu":
        raise InvalidValueError(quantity, value, allowed)
    return np.array(array, dtype=np.float64, order="C")


def real_numbers(quantity: str, value: ArrayLike) -> FloatArray:
    """Return numbers of any shape as float64; a float64 array is not copied.

    Raises:
        InvalidValueError: for anything but real numbers in equal rows.
    """
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value
    return _numbers(quantity, value, "real numbers")


def finite_vector(
    quantity: str, value: ArrayLike, n: int | None = None, labels: Sequence[str] | None = None
) -> FloatArray:
    """Copy a vector, refusing wrong shapes, NaN and infinity.

    Args:
        quantity: Name of the argument, for the message.
        value: Anything that numpy reads as numbers.
        n: Required number of entries; any positive number if None.
        labels: Names of the coordinates, for the message.

    Returns:
        A read-only copy, shape (n,).

    Raises:
        InvalidValueError: The shape is wrong or an entry is not finite; the message names the coordinate.
    """
    allowed = f"a vector of shape ({'n' if n is None else n},) of finite numbers"
    vector = _numbers(quantity, value, allowed)
    if vector.ndim != 1 or vector.size == 0 or (n is not None and vector.size != n):
        raise InvalidValueError(quantity, f"shape {vector.shape}", allowed)
    finite = np.isfinite(vector)
    if not finite.all():
        i = int(np.argmin(finite))
        raise InvalidValueError(coordinate_name(quantity, i, labels), vector[i], "a finite number")
    return read_only(vector)


def finite_points(
    quantity: str, value: ArrayLike, n: int | None = None, labels: Sequence[str] | None = None
) -> FloatArray:
    """Copy a list of points, refusing wrong shapes, NaN and infinity.

    Args:
        quantity: Name of the argument, for the message.
        value: Anything that numpy reads as a table of numbers.
        n: Required number of columns; any positive number if None.
        labels: Names of the coordinates, for the message.

    Returns:
        A read-only copy, shape (k, n) with k >= 1.

    Raises:
        InvalidValueError: The shape is wrong or an entry is not finite; the message names row and coordinate.
    """
    allowed = f"points of shape (k, {'n' if n is None else n}) with k >= 1, of finite numbers"
    points = _numbers(quantity, value, allowed)
    if points.ndim != 2 or points.size == 0 or (n is not None and points.shape[1] != n):
        raise InvalidValueError(quantity, f"shape {points.shape}", allowed)
    finite = np.isfinite(points)
    if not finite.all():
        row, i = np.argwhere(~finite)[0]
        name = coordinate_name(f"{quantity}[{row}]", int(i), labels)
        raise InvalidValueError(name, points[row, i], "a finite number")
    return read_only(points)


def require_inside(
    quantity: str,
    state: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    labels: Sequence[str] | None = None,
) -> None:
    """Refuse a state outside a box.

    Raises:
        InvalidValueError: A coordinate is outside its bounds; the message names it.
    """
    outside = (state < lower) | (state > upper)
    if outside.any():
        i = int(np.argmax(outside))
        name = coordinate_name(quantity, i, labels)
        raise InvalidValueError(
            name, state[i], f"a value within the bounds [{lower[i]:.12g}, {upper[i]:.12g}]"
        )


def positive_number(quantity: str, value: float) -> float:
    """Return a finite number above zero as a float.

    Raises:
        InvalidValueError: It is not a number, not finite, or not above zero.
    """
    allowed = "a finite number above 0"
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(quantity, value, allowed) from None
    if not 0.0 < number < math.inf:
        raise InvalidValueError(quantity, value, allowed)
    return number


MOST_COUNT = 2**31 - 1
"""Maximum of counts, such as iterations and samples."""


def whole_number(quantity: str, value: int, least: int = 0, most: float = MOST_COUNT) -> int:
    """Return an integer within bounds (a number of iterations, of samples).

    Args:
        quantity: Name of the argument, for the message.
        value: An integer of Python or NumPy.
        least: Minimum value.
        most: Maximum value.

    Raises:
        InvalidValueError: It is not an integer, or it is out of bounds.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise InvalidValueError(quantity, value, f"an integer >= {least}") from None
    if number > most:
        raise InvalidValueError(quantity, value, f"an integer from {least} to {int(most)}")
    if number < least:
        raise InvalidValueError(quantity, value, f"an integer >= {least}")
    return number


def seed_number(value: int) -> int:
    """Return the seed of random choices, an integer of at least zero and of any size.

    Raises:
        InvalidValueError: It is not an integer, or it is negative.
    """
    return whole_number("seed", value, most=math.inf)
