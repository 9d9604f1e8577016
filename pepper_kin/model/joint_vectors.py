"""Checks of arguments: joint vectors of the right length, numbers in range, and within limits."""

from __future__ import annotations

import math
from fractions import Fraction
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.exceptions import InvalidValueError, LimitError, did_you_mean, suspect_degrees

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from pepper_kin.model.pepper_model import PepperModel


MOST = 1e9
"""Maximum magnitude of a position, velocity, acceleration or torque [rad, m, ..., N m or N].

Sines of larger angles have lost half of their digits, and products of far larger numbers overflow.
"""
_MOST_TURNS = 100  # maximum number of turns of a joint until its followers are back at their positions


def as_finite(
    value: ArrayLike, quantity: str, shape: tuple[int | None, ...], most: float = math.inf
) -> NDArray[np.float64]:
    """Convert to an array of finite floats of a given shape.

    Args:
        value: Array-like of numbers; truth values and texts are refused.
        quantity: Name for the message.
        shape: Expected shape; None stands for any length.
        most: Maximum magnitude allowed.

    Returns:
        The array (a view where no conversion was needed).

    Raises:
        InvalidValueError: naming the quantity and the fault.
    """
    array = _of_shape(value, quantity, shape)
    if not np.isfinite(array).all():
        raise InvalidValueError(
            quantity, array[~np.isfinite(array)][0], "finite numbers (no NaN, no infinity)"
        )
    if most < math.inf and array.size and np.abs(array).max() > most:
        raise InvalidValueError(
            quantity, array[np.abs(array) > most][0], f"numbers from -{most:g} to {most:g}"
        )
    return array


def as_numbers(
    value: ArrayLike, quantity: str, shape: tuple[int | None, ...] | None = None
) -> NDArray[np.float64]:
    """Convert to an array of floats, some of which may be infinite; see `as_finite`.

    Args:
        value: Array-like of numbers.
        quantity: Name for the message.
        shape: Expected shape; None stands for any length, or any shape.

    Raises:
        InvalidValueError: naming the quantity and the fault; for NaN too.
    """
    array = _of_shape(value, quantity, shape)
    if np.isnan(array).any():
        raise InvalidValueError(quantity, math.nan, "numbers (no NaN)")
    return array


def _of_shape(value: ArrayLike, quantity: str, shape: tuple[int | None, ...] | None) -> NDArray[np.float64]:
    """Return numbers, which may be NaN or infinite, as an array of the expected shape (None: any)."""
    try:
        array = _as_floats(value)
    except (TypeError, ValueError, OverflowError, RecursionError, RuntimeError) as error:
        expected = "numbers" if shape is None else f"numbers of shape {_shape_text(shape)}"
        raise InvalidValueError(quantity, shown(value), f"{expected}{_gradient_advice(value)}") from error
    if shape is None or array.shape == shape:
        return array
    if len(array.shape) != len(shape) or any(
        s is not None and s != a for s, a in zip(shape, array.shape, strict=True)
    ):
        raise InvalidValueError(quantity, f"shape {array.shape}", f"shape {_shape_text(shape)}")
    return array


def shown(value: object) -> str:
    """Return a value for a message, texts in quotes; a value that is too long is named by its type."""
    try:
        return repr(value)
    except (ValueError, RecursionError):  # integers of thousands of digits, lists that contain themselves
        return f"a value of type {type(value).__name__} that is too long to be shown"


def as_batch(
    value: ArrayLike, quantity: str, shape: tuple[int | None, ...], most: float = math.inf
) -> NDArray[np.float64]:
    """Convert to an array of finite floats whose last axes have a given shape; see `as_finite`.

    Args:
        value: Array-like of numbers, shape (..., *shape).
        quantity: Name for the message.
        shape: Expected shape of the last axes; None stands for any length.
        most: Maximum magnitude allowed.

    Raises:
        InvalidValueError: naming the quantity and the fault.
    """
    try:
        leading = max(np.ndim(value) - len(shape), 0)
    except ValueError:  # lists of unequal lengths, which `as_finite` refuses by name
        leading = 0
    return as_finite(value, quantity, (*(None,) * leading, *shape), most)


_MOST_SQUARED = MOST**2


def _shape_text(shape: tuple[int | None, ...]) -> str:
    """Return a shape for a message; k stands for any length."""
    return (
        "(" + ", ".join("k" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
    )


def _as_floats(value: ArrayLike) -> NDArray[np.float64]:
    """Convert numbers, in an array or nested lists of any shape, to float64; refuse everything else.

    NumPy would turn dates, texts, truth values and complex numbers into floats; they are refused in lists and
    arrays of objects as well.

    Raises:
        TypeError: for anything but real numbers.
    """
    array = np.asarray(value)
    if array.dtype.kind == "O":
        if not all(isinstance(item, Real) and not isinstance(item, bool | np.bool_) for item in array.flat):
            raise TypeError("an array of other things than numbers")
    elif array.dtype.kind not in "iuf" or (isinstance(value, list | tuple) and _holds_truth(value)):
        raise TypeError(f"an array of {array.dtype}")
    return array.astype(np.float64, copy=False)


def _holds_truth(value: list[Any] | tuple[Any, ...]) -> bool:
    """Whether nested lists of numbers hold a truth value, which NumPy would convert to a number."""
    kinds = set(map(type, value))
    if bool in kinds or np.bool_ in kinds:
        return True
    if not (list in kinds or tuple in kinds or np.ndarray in kinds):
        return False
    return any(
        _holds_truth(item) if isinstance(item, list | tuple) else getattr(item, "dtype", None) == np.bool_
        for item in value
    )


def refuse_degrees(angles: ArrayLike, quantity: str) -> None:
    """Refuse angles of more than a whole turn [rad], which are probably degrees.

    Raises:
        InvalidValueError: with the largest magnitude of the angles.
    """
    greatest = float(np.abs(np.asarray(angles, float)).max(initial=0.0))
    if question := suspect_degrees(greatest):
        raise InvalidValueError(quantity, f"{greatest:.6g} rad", f"at most a whole turn, 2 pi{question}")


def _gradient_advice(value: object) -> str:
    """Return advice for a tensor with a gradient, which NumPy refuses; empty for other values."""
    return "; of a tensor with gradient, its detach()" if getattr(value, "requires_grad", False) else ""


def _in_order(pepper: PepperModel, value: Any, quantity: str) -> Any:
    """Return labeled numbers, such as a pandas Series or DataFrame, in the order of the robot's joints.

    Values whose labels are not texts are taken in their order.

    Raises:
        InvalidValueError: for labels other than the robot's joints.
    """
    if type(value).__module__.partition(".")[0] != "pandas":
        return value
    labels = list(value.columns if value.ndim == 2 else value.index)
    if tuple(labels) == pepper.joint_names or not any(isinstance(label, str) for label in labels):
        return value
    if len(labels) != pepper.n or set(labels) != set(pepper.joint_names):
        allowed = f"those of the joints, each once: {', '.join(pepper.joint_names)}"
        raise InvalidValueError(f"labels of {quantity}", ", ".join(map(str, labels)), allowed)
    return value[list(pepper.joint_names)]


def as_joint_vectors(pepper: PepperModel, value: ArrayLike, quantity: str) -> NDArray[np.float64]:
    """Convert to joint vectors with leading batch axes, shape (..., n).

    Args:
        pepper: The robot, which gives n and the joint names.
        value: Array-like whose last axis has length n.
        quantity: Name for the message, such as "q".

    Returns:
        Array of floats from -MOST to MOST, shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, or naming the joint that is NaN, infinite or beyond MOST.
    """
    # One vector of floats is the usual case; a large sum of squares is checked below.
    if (
        type(value) is np.ndarray
        and value.dtype == np.float64
        and value.shape == (pepper.n,)
        and np.vdot(value, value) < _MOST_SQUARED  # `dot` warns where it overflows
    ):
        return value
    value = _in_order(pepper, value, quantity)
    try:
        array = _as_floats(value)
    except (TypeError, ValueError, OverflowError, RecursionError, RuntimeError) as error:
        allowed = f"numbers of shape (..., {pepper.n}){_gradient_advice(value)}"
        raise InvalidValueError(quantity, shown(value), allowed) from error
    if array.ndim == 0 or array.shape[-1] != pepper.n:
        raise InvalidValueError(
            quantity,
            f"shape {array.shape}",
            f"shape (..., {pepper.n}), one value per joint: {', '.join(pepper.joint_names)}",
        )
    if array.size and not (array.max() <= MOST and array.min() >= -MOST):
        index = tuple(np.argwhere(~(np.abs(array) <= MOST))[0])
        wrong, joint = float(array[index]), pepper.joint_names[index[-1]]
        allowed = f"numbers from -{MOST:g} to {MOST:g}" if math.isfinite(wrong) else "finite numbers"
        raise InvalidValueError(quantity, f"{wrong} at joint {joint}", allowed)
    return array


def as_joint_vector(pepper: PepperModel, value: ArrayLike, quantity: str) -> NDArray[np.float64]:
    """Convert to one joint vector, shape (n,).

    Raises:
        InvalidValueError: for the errors of `as_joint_vectors`, and for more than one vector.
    """
    vector = as_joint_vectors(pepper, value, quantity)
    if vector.ndim != 1:
        raise InvalidValueError(quantity, f"shape {vector.shape}", f"shape ({pepper.n},)")
    return vector


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
        LimitError: naming the joint with the largest violation, its value and its limits.
    """
    low, high = pepper.lower_limits, pepper.upper_limits
    # For one vector, clipping costs less than comparisons followed by `all`.
    if q.ndim == 1 and np.minimum(np.maximum(q, low), high).tobytes() == q.tobytes():
        return
    if (q >= low).all() and (q <= high).all():
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


def full_turns(pepper: PepperModel, change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the full turns nearest to a change of position, for revolute joints without limits [rad].

    With the turns added to one of two positions whose difference is the change, the remaining difference is
    at most half a period; a period is the number of turns after which the joint's followers are back at their
    positions, too. Zero for joints with limits, prismatic joints, and joints with a follower that never
    returns.

    Args:
        pepper: The robot.
        change: Differences of joint positions, shape (..., n).
    """
    turns = _turns_until_all_are_back(pepper)
    period = 2 * np.pi * np.maximum(turns, 1.0)
    return np.where(turns > 0, period * np.round(change / period), 0.0)


def _turns_until_all_are_back(pepper: PepperModel) -> NDArray[np.float64]:
    """Return the number of turns after which a joint and its followers are back, 0 for never, shape (n,)."""
    endless = np.isinf(pepper.lower_limits) & np.isinf(pepper.upper_limits)
    found = (endless & (np.array(pepper.joint_units) == "rad")).astype(float)
    if pepper.is_coupled and found.any():
        kinds = {joint.name: joint.type for joint in pepper.document.joints}
        for name, row in zip(list(pepper.inner_model.names)[1:], pepper.full_map, strict=True):
            for j in np.flatnonzero((row != 0.0) & (found > 0)):
                ratio = Fraction(row[j]).limit_denominator(_MOST_TURNS)
                exact = kinds[name] != "prismatic" and abs(ratio - row[j]) < 1e-12
                found[j] = math.lcm(int(found[j]), ratio.denominator) if exact else 0.0
    return found


def check_choice(quantity: str, value: str, choices: tuple[str, ...]) -> str:
    """Return `value` if it is one of `choices`.

    Raises:
        InvalidValueError: listing the choices, and suggesting the most similar one.
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
    number = as_real(value)
    if not (math.isfinite(number) and number > 0):
        raise InvalidValueError(
            quantity, shown(value), f"a finite number above 0{' ' + unit if unit else ''}"
        )
    return number


MOST_COUNT = 2**31 - 1
"""Maximum number of iterations, starts, samples and other counts."""


def check_whole(quantity: str, value: object, least: int = 1, most: float = MOST_COUNT) -> int:
    """Return `value` if it is an integer from `least` to `most`.

    Args:
        quantity: Name for the message.
        value: An integer of Python or NumPy; truth values are refused.
        least: Minimum allowed value.
        most: Maximum allowed value; `math.inf` for seeds.

    Raises:
        InvalidValueError: naming the quantity.
    """
    if type(value) is int and least <= value <= most:
        return value
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (whole and least <= value <= most):  # type: ignore[operator]
        allowed = f"an integer of at least {least}"
        if whole and value > most:  # type: ignore[operator]
            allowed = f"an integer from {least} to {int(most)}"
        raise InvalidValueError(quantity, shown(value), allowed)
    return int(value)  # type: ignore[call-overload]


def check_rows(rows: ArrayLike, count: int) -> NDArray[np.int64]:
    """Return the indices of selected robots of a batch, shape (k,).

    Args:
        rows: Indices from 0, shape (k,), each once, or a mask, shape (count,).
        count: Number of robots of the batch.

    Raises:
        InvalidValueError: for anything else.
    """
    allowed = f"numbers from 0 to {count - 1}, each once, or a mask of shape ({count},)"
    try:
        array = np.asarray(rows)
    except (ValueError, OverflowError, RecursionError):  # ragged rows, lists that contain themselves
        raise InvalidValueError("rows", shown(rows), allowed) from None
    if array.dtype == bool and array.shape == (count,):
        return np.flatnonzero(array)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise InvalidValueError("rows", f"{array.dtype} of shape {array.shape}", allowed)
    places = array.astype(np.int64)
    if np.unique(places).size < places.size or np.any((places < 0) | (places >= count)):
        raise InvalidValueError("rows", np.array2string(places, threshold=8), allowed)
    return places


def check_seed(value: object) -> int:
    """Return the seed of random choices: an integer of at least 0, of any size.

    Raises:
        InvalidValueError: for any other value.
    """
    return check_whole("seed", value, 0, math.inf)


def as_real(value: object) -> float:
    """Return one number as a float; NaN for anything else, such as truth values, texts and lists."""
    if isinstance(value, float):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan
