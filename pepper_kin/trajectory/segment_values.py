"""Values of piecewise polynomials on chosen segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.core.splines import derivatives_on_segments
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_numbers


def checked_derivatives(coefficients: Array, segment: ArrayLike, local_time: ArrayLike, count: int) -> Array:
    """Return value and first derivatives of chosen polynomials, whose places and times are checked.

    Args:
        coefficients: Constant term first, shape (m, k, n).
        segment: Indices of segments, negative ones from the end, shape (...).
        local_time: Time since the start of the segment [s], shape (...).
        count: Number of derivatives, the value among them, at most 4.

    Returns:
        Shape (count, ..., n).

    Raises:
        InvalidValueError: for a segment that does not exist, a time that is not finite, or shapes that
            do not go together.
    """
    place, time = as_numbers(segment, "segment"), as_numbers(local_time, "local_time")
    most = len(coefficients)
    wrong = (place != np.floor(place)) | (place < -most) | (place >= most)
    if wrong.any():
        raise InvalidValueError("segment", place[wrong].flat[0], f"whole numbers from 0 to {most - 1}")
    if np.isinf(time).any():
        raise InvalidValueError("local_time", "infinity", "finite times [s]")
    try:
        return derivatives_on_segments(coefficients, place.astype(np.int64), time, count)
    except ValueError:
        shapes = f"shapes {place.shape} and {time.shape}"
        raise InvalidValueError("segment and local_time", shapes, "shapes that go together") from None
