"""Conversion of arrays to rows that compiled code can read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.instructions import Signature
from pepper_kin.kernels.memory import empty


@dataclass(frozen=True)
class RowView:
    """An array as rows of contiguous numbers.

    Attributes:
        array: Shape (count, size), or (1, size) for a row that all states share.
        address: Address of the first row.
        stride: Distance of rows in elements; 0 for a shared row.
    """

    array: NDArray[np.floating]
    address: int
    stride: int


def core_shape(shape: tuple[int, int]) -> tuple[int, ...]:
    """Shape of one state's array: (rows,) of a column vector, else (rows, columns)."""
    return shape[:1] if shape[1] == 1 else shape


def read_inputs(
    signature: Signature, dtype: np.dtype, values: Sequence[ArrayLike]
) -> tuple[tuple[int, ...], list[RowView]]:
    """Check and convert the inputs of a call.

    Args:
        signature: Names and shapes of the inputs.
        dtype: Number format of the rows.
        values: One array per input, shape (..., rows) or (..., rows, columns).

    Returns:
        Leading axes of the inputs (inputs with leading axes must agree), and the rows of each input.

    Raises:
        InvalidValueError: Wrong number of inputs, wrong shape, or not real numbers.
    """
    names = signature.input_names
    if len(values) != len(names):
        raise InvalidValueError(
            f"arguments of {signature.name}", len(values), f"{len(names)} ({', '.join(names) or 'none'})"
        )
    arrays, batches = [], []
    for name, shape, value in zip(names, signature.input_shapes, values, strict=True):
        array = _real_array(name, value)
        core = core_shape(shape)
        axes = array.ndim - len(core)
        if axes < 0 or array.shape[axes:] != core:
            expected = ", ".join(("...", *map(str, core)))
            raise InvalidValueError(name, f"shape {array.shape}", f"shape ({expected})")
        arrays.append(array)
        batches.append(array.shape[:axes])
    leading = _common_batch(names, batches)
    count = math.prod(leading)
    rows = [
        _as_rows(array, count if batch else 1, size, dtype, shared=not batch)
        for array, batch, size in zip(arrays, batches, signature.input_sizes, strict=True)
    ]
    return leading, rows


def make_outputs(
    signature: Signature, dtype: np.dtype, leading: tuple[int, ...], out: object, inputs: Sequence[RowView]
) -> list[NDArray[np.floating]]:
    """The arrays that receive the results: new ones, or the caller's after a check.

    Raises:
        InvalidValueError: `out` has the wrong number, shape or format, is read-only, has gaps or overlaps an
            input.
    """
    shapes = [leading + core_shape(shape) for shape in signature.output_shapes]
    if out is None:
        return [empty(shape, dtype) for shape in shapes]
    outputs: list[Any] = list(out) if isinstance(out, (tuple, list)) else [out]
    if len(outputs) != len(shapes):
        raise InvalidValueError("out", f"{len(outputs)} arrays", f"{len(shapes)}")
    for name, shape, array in zip(signature.output_names, shapes, outputs, strict=True):
        quantity = f"out ({name})"
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != dtype:
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            raise InvalidValueError(quantity, found, f"a NumPy array of {dtype} {shape}")
        if not (array.flags.c_contiguous and array.flags.writeable and array.flags.aligned):
            raise InvalidValueError(
                quantity, "a read-only or non-contiguous array", "a writeable C-contiguous one"
            )
        if any(np.may_share_memory(array, rows.array) for rows in inputs):
            raise InvalidValueError(quantity, "memory shared with an input", "an array that shares none")
    return outputs


def refuse_not_finite(signature: Signature, inputs: Sequence[RowView]) -> None:
    """Name the first NaN or infinity among the inputs.

    Raises:
        InvalidValueError: There is one.
    """
    for name, shape, rows in zip(signature.input_names, signature.input_shapes, inputs, strict=True):
        bad = np.flatnonzero(~np.isfinite(rows.array))
        if bad.size:
            row, element = divmod(int(bad[0]), rows.array.shape[1])
            place = np.unravel_index(element, core_shape(shape))
            where = f"state {row}, element {', '.join(str(int(k)) for k in place)}"
            raise InvalidValueError(name, f"{rows.array[row, element]} ({where})", "finite numbers")


def _real_array(name: str, value: ArrayLike) -> np.ndarray:
    """Return an array of real numbers of any shape and dtype; refuse anything else by name."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:
        raise InvalidValueError(name, type(value).__name__, "an array of real numbers") from error
    if array.dtype.kind not in "biuf":
        raise InvalidValueError(name, f"an array of {array.dtype}", "real numbers")
    return array


def _common_batch(names: Sequence[str], batches: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """Return the leading axes that inputs have in common; inputs without leading axes hold for all states."""
    leading: tuple[int, ...] = ()
    first = ""
    for name, batch in zip(names, batches, strict=True):
        if batch and not leading:
            leading, first = batch, name
        elif batch and batch != leading:
            raise InvalidValueError(name, f"leading axes {batch}", f"{leading} as in {first}, or none")
    return leading


def _as_rows(array: np.ndarray, count: int, size: int, dtype: np.dtype, *, shared: bool) -> RowView:
    """Return an array of shape (..., *core) as rows, shape (count, size), copied only if necessary."""
    if array.dtype != dtype:
        with np.errstate(over="ignore"):  # numbers too large for a float become infinite and are refused
            array = array.astype(dtype)
    rows = array.reshape(count, size)
    item = dtype.itemsize
    between_rows, between_elements = rows.strides
    if (between_elements != item and size > 1) or between_rows % item or not rows.flags.aligned:
        rows = np.ascontiguousarray(rows)
    stride = 0 if shared or count <= 1 else rows.strides[0] // item
    return RowView(rows, rows.ctypes.data, stride)
