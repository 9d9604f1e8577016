"""Batches of states: few states are evaluated one by one, many states by a compiled kernel."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch.kernels_of import kernel
from pepper_kin.core.plain_vectors import are_three_plain, are_two_plain, is_plain
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import Kernel
from pepper_kin.kernels.compiled_function import INTERPRETED
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors

KERNEL_FROM = 24
"""Minimum number of states for which a kernel is used: for fewer, its call costs as much as the states."""

WIDE_FROM = 10_000
"""Minimum number of states for which code with the processor's widest vectors is compiled."""

WIDE_OPERATIONS = 16
"""Minimum number of operations per number of the result for which wide vectors pay: results are transposed
from vectors to rows by shuffles, which wide vectors do not speed up."""


_ABSENT: Any = object()


def state_data(pepper: PepperModel, q: Any, v: Any = _ABSENT, a: Any = _ABSENT) -> Any:
    """Return the `pinocchio.Data` if Pinocchio's functions can use the arrays unchanged, else None.

    This is the frequent case: (n,) arrays of floats within range, and a robot whose coordinates are
    Pinocchio's.

    Returns:
        The data of this thread, or None if `over_states` has to convert or refuse values or iterate over a
        batch.
    """
    try:
        if a is not _ABSENT:
            plain = _are_three(pepper.n, q, v, a)
        else:
            plain = _is_one(pepper.n, q) if v is _ABSENT else _are_two(pepper.n, q, v)
        return pepper.pinocchio_data if plain and pepper.is_direct else None
    except TypeError:  # lists, other types of numbers, other numbers of axes, rows that are not contiguous
        return None


def _are_plain(n: int, *state: Any) -> bool:
    """Whether all arguments are (n,) arrays of floats within range, which need no conversion or check."""
    try:
        return (_is_one, _are_two, _are_three)[len(state) - 1](n, *state)
    except TypeError:
        return False


def _load_tests(n: int, *state: Any) -> bool:
    """Load the compiled tests; their Python functions would accept other types, too."""
    global _is_one, _are_two, _are_three
    if INTERPRETED:
        _is_one = _are_two = _are_three = lambda *_: False
    else:
        _is_one, _are_two, _are_three = is_plain.native, are_two_plain.native, are_three_plain.native
    return _are_plain(n, *state)


_is_one: Callable[..., bool] = _load_tests
_are_two: Callable[..., bool] = _load_tests
_are_three: Callable[..., bool] = _load_tests


def over_states(
    pepper: PepperModel,
    function: Callable[..., Array],
    shape: tuple[int, ...],
    quantity: tuple[object, ...] | None,
    **quantities: ArrayLike,
) -> Array:
    """Evaluate a function of one state with one result for every state of a batch, shape (..., *shape).

    The arguments are as in `all_over_states`, which returns several results.
    """
    return all_over_states(pepper, lambda *state: (function(*state),), (shape,), quantity, **quantities)[0]


def all_over_states(
    pepper: PepperModel,
    function: Callable[..., tuple[Array, ...]],
    shapes: tuple[tuple[int, ...], ...],
    quantity: tuple[object, ...] | None,
    **quantities: ArrayLike,
) -> tuple[Array, ...]:
    """Evaluate a function of one state for every state of a batch.

    Args:
        pepper: The robot.
        function: Function of one (n,) vector per quantity that returns new arrays.
        shapes: Shape of each result for one state.
        quantity: Name of the function in `symbolic.QUANTITIES`, and its arguments after the robot; None if it
            has no kernel. For a robot with `solvers` "reference" no kernel is used.
        **quantities: Joint vectors with leading batch axes, shape (..., n), by the name used in messages;
            their batch axes broadcast against one another.

    Returns:
        The results, each of shape (..., *shape).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, numbers beyond 1e9, or batch axes that do not
            broadcast.
    """
    if _are_plain(pepper.n, *quantities.values()):
        return _exact(function(*quantities.values()), shapes)
    arrays = [_shaped(pepper, value, name) for name, value in quantities.items()]
    if all(array.ndim == 1 for array in arrays):
        return _exact(function(*_finite(pepper, arrays, quantities)), shapes)
    batch = _batch_axes(arrays, quantities)
    count = math.prod(batch)
    if quantity is not None and count >= KERNEL_FROM and pepper.solvers == "fast":
        return _by_kernel(pepper, quantity, shapes, arrays, batch, quantities)
    flat = [_rows(a, batch) for a in arrays]
    results = [np.empty((count, *shape)) for shape in shapes]
    for i, state in enumerate(zip(*_finite(pepper, flat, quantities), strict=True)):
        for result, value, shape in zip(results, function(*state), shapes, strict=True):
            exact = type(value) is np.ndarray and value.shape == shape
            result[i] = value if exact else np.reshape(value, shape)
    return tuple(result.reshape(*batch, *shape) for result, shape in zip(results, shapes, strict=True))


def _exact(results: tuple[Array, ...], shapes: tuple[tuple[int, ...], ...]) -> tuple[Array, ...]:
    """Return the results of one state as float arrays of the given shapes."""
    return tuple(
        value
        if type(value) is np.ndarray and value.shape == shape
        else np.asarray(value, dtype=float).reshape(shape)
        for value, shape in zip(results, shapes, strict=True)
    )


def _by_kernel(
    pepper: PepperModel,
    quantity: tuple[object, ...],
    shapes: tuple[tuple[int, ...], ...],
    arrays: list[Array],
    batch: tuple[int, ...],
    quantities: dict[str, ArrayLike],
) -> tuple[Array, ...]:
    """Evaluate a quantity's kernel for a batch.

    Args:
        pepper: The robot.
        quantity: Name and arguments of the quantity, see `all_over_states`.
        shapes: Shape of each result for one state.
        arrays: Joint vectors, shape (..., n) each.
        batch: Common leading axes of the joint vectors.
        quantities: Joint vectors of the caller by name.

    Returns:
        The results, each of shape (*batch, *shape).

    Raises:
        InvalidValueError: for NaN, infinity or numbers beyond 1e9.
    """

    def refuse_large() -> None:
        _finite(pepper, arrays, quantities)

    name, *args = quantity
    compiled = kernel_for(pepper, math.prod(batch), str(name), *args)
    flat = [a if a.ndim == 1 else _rows(a, batch) for a in arrays]
    results = compiled(*flat, check_large=refuse_large)
    parts = results if isinstance(results, tuple) else (results,)
    return tuple(np.asarray(part).reshape(*batch, *shape) for part, shape in zip(parts, shapes, strict=True))


def _rows(array: Array, batch: tuple[int, ...]) -> Array:
    """Return joint vectors, shape (..., n), broadcast to all states of a batch, shape (count, n)."""
    n = array.shape[-1]
    whole = array if array.shape[:-1] == batch else np.broadcast_to(array, (*batch, n))
    return whole if whole.ndim == 2 else whole.reshape(-1, n)


def kernel_for(pepper: PepperModel, count: int, quantity: str, *args: object) -> Kernel:
    """Return the fastest kernel of a quantity for a number of states; see `kernel`."""
    found = kernel(pepper, quantity, *args)
    outputs = sum(found.signature.output_sizes)
    if count < WIDE_FROM or found.flop_count < WIDE_OPERATIONS * outputs:
        return found
    return kernel(pepper, quantity, *args, wide=True)


def _shaped(pepper: PepperModel, value: ArrayLike, name: str) -> Array:
    """Convert to floats of shape (..., n); finiteness is checked where the values are read."""
    if (
        isinstance(value, np.ndarray)
        and value.dtype == np.float64
        and value.ndim
        and value.shape[-1] == pepper.n
    ):
        return value
    return as_joint_vectors(pepper, value, name)


def _finite(pepper: PepperModel, arrays: list[Array], quantities: dict[str, ArrayLike]) -> list[Array]:
    """Return joint vectors, shape (..., n) each; refuse those with NaN or infinity by name."""
    return [as_joint_vectors(pepper, array, name) for array, name in zip(arrays, quantities, strict=True)]


def _batch_axes(arrays: list[Array], quantities: dict[str, ArrayLike]) -> tuple[int, ...]:
    """Return the common leading axes of joint vectors, shape (..., n) each."""
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    except ValueError:
        shapes = ", ".join(f"{n}: {a.shape[:-1]}" for n, a in zip(quantities, arrays, strict=True))
        raise InvalidValueError(
            "batch axes", shapes, "leading axes that broadcast against one another"
        ) from None
