"""Editing of trajectories: cutting, joining, blending, reversing, scaling in time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, read_only
from pepper_kin.core.splines import cut_out, shifted
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_real, check_positive, shown
from pepper_kin.trajectory.samples import TIME_TOLERANCE, known

if TYPE_CHECKING:
    from pepper_kin.trajectory.trajectory import Trajectory

_MEET = 1e-6  # largest distance at which two ends meet [rad or m] or [rad/s or m/s]


def scaled(trajectory: Trajectory, factor: float) -> Trajectory:
    """Return q(t / factor): `factor` times as long along the same path; see `Trajectory.scaled`."""
    factor = check_positive("factor", factor)
    powers = factor ** -np.arange(trajectory.coefficients.shape[1], dtype=float)
    return _like(trajectory, trajectory.breaks * factor, trajectory.coefficients * powers[:, None])


def backward(trajectory: Trajectory) -> Trajectory:
    """Return q(T - t); see `Trajectory.reversed`."""
    step = np.diff(trajectory.breaks)
    signs = (-1.0) ** np.arange(trajectory.coefficients.shape[1])
    moved = shifted(trajectory.coefficients, step) * signs[:, None]
    return _like(trajectory, trajectory.duration - trajectory.breaks[::-1], moved[::-1])


def between(trajectory: Trajectory, start: float, end: float) -> Trajectory:
    """Return the part from one time to another; see `Trajectory.between`."""
    for name, time in (("start", start), ("end", end)):
        if not math.isfinite(as_real(time)):
            raise InvalidValueError(name, shown(time), "a finite time [s]")
    duration = trajectory.duration
    if not (start >= -TIME_TOLERANCE and end <= duration + TIME_TOLERANCE and end - start > TIME_TOLERANCE):
        allowed = f"0 <= start < end <= {duration:.9g} s"
        raise InvalidValueError("start and end", f"{start} s and {end} s", allowed)
    ends = np.array([max(float(start), 0.0), min(float(end), duration)])
    knots, pieces = np.empty(trajectory.breaks.size), np.empty(trajectory.coefficients.shape)
    breaks, coefficients = trajectory.breaks, trajectory.coefficients
    count, order = cut_out.native(breaks, coefficients, ends, TIME_TOLERANCE, knots, pieces)
    return _sound(trajectory, knots[: count + 1], pieces[:count, :order])


def joined(first: Trajectory, second: Trajectory) -> Trajectory:
    """Return one trajectory after another; see `Trajectory.then`."""
    _check_meeting(first, second)
    order = max(first.coefficients.shape[1], second.coefficients.shape[1])
    breaks = np.concatenate([first.breaks, first.duration + second.breaks[1:]])
    parts = [_padded(one.coefficients, order) for one in (first, second)]
    return _sound(first, breaks, np.concatenate(parts))


def blended(first: Trajectory, second: Trajectory, overlap: float) -> Trajectory:
    """Return one trajectory that runs into another; see `Trajectory.blend`."""
    overlap = check_positive("overlap", overlap, "s")
    _check_meeting(first, second)
    most = min(first.duration, second.duration)
    if overlap > most:
        raise InvalidValueError("overlap", f"{overlap} s", f"at most the shorter duration, {most:.9g} s")
    starts = first.duration - overlap
    knots = np.concatenate([first.breaks, starts + second.breaks])
    last = starts + second.duration
    knots = np.sort(knots)
    knots = knots[np.append(np.diff(knots) > TIME_TOLERANCE, True)]
    knots[0], knots[-1] = 0.0, last
    order = max(first.coefficients.shape[1], second.coefficients.shape[1])
    total = _extended(first, knots, order, 0.0) + _extended(second, knots, order, starts)
    total[:, 0] -= second.start
    return _like(first, knots, total)


def _check_meeting(first: Trajectory, second: Trajectory) -> None:
    if not isinstance(second, type(first)):
        raise InvalidValueError("trajectory", repr(second), "a Trajectory")
    if (first.joint_names, first.joint_units) != (second.joint_names, second.joint_units):
        raise InvalidValueError(
            "joints of the second trajectory", ", ".join(second.joint_names), ", ".join(first.joint_names)
        )
    last = first(first.duration)
    for what, ours, theirs in (
        ("position", last.position, second.start),
        ("velocity", last.velocity, second(0.0).velocity),
    ):
        gap = np.abs(ours - theirs)
        if gap.max() > _MEET:
            joint = first.joint_names[int(np.argmax(gap))]
            raise InvalidValueError(
                f"start of the second trajectory, {what} of {joint}",
                f"{theirs[int(np.argmax(gap))]:.6g}",
                f"{ours[int(np.argmax(gap))]:.6g}, where the first one ends",
            )


def _like(trajectory: Trajectory, breaks: Array, coefficients: Array) -> Trajectory:
    """Return a trajectory with the same joints, breaks [s], shape (m + 1,), and coefficients, (m, k, n)."""
    return type(trajectory)(trajectory.joint_names, breaks, coefficients, trajectory.joint_units)


def _sound(trajectory: Trajectory, breaks: Array, coefficients: Array) -> Trajectory:
    """Return a trajectory of new arrays without checks, with the joints of another trajectory."""
    arrays = {"breaks": read_only(breaks), "coefficients": read_only(coefficients)}
    return known(type(trajectory), trajectory.joint_names, trajectory.joint_units, **arrays)


def _padded(coefficients: Array, order: int) -> Array:
    """Return coefficients, shape (m, k, n), with zeros for higher powers, shape (m, order, n)."""
    count, known, n = coefficients.shape
    if known == order:
        return coefficients
    found = np.zeros((count, order, n))
    found[:, :known] = coefficients
    return found


def _places(trajectory: Trajectory, knots: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the piece and local start time [s], shape (m,) each, of intervals between knots, (m + 1,)."""
    middle = (knots[1:] + knots[:-1]) / 2
    segments = np.clip(
        np.searchsorted(trajectory.breaks, middle, side="right") - 1, 0, trajectory.breaks.size - 2
    )
    return segments, knots[:-1] - trajectory.breaks[segments]


def _extended(trajectory: Trajectory, knots: Array, order: int, starts: float) -> Array:
    """Return coefficients on new knots of a trajectory that rests before its start and after its end.

    Args:
        trajectory: The trajectory.
        knots: Increasing times [s], shape (m + 1,).
        order: Number of coefficients k.
        starts: Time on the knots' clock at which the trajectory starts [s].

    Returns:
        Coefficients, constant term first, shape (m, k, n).
    """
    segments, by = _places(trajectory, knots - starts)
    found = _padded(shifted(trajectory.coefficients[segments], by), order)
    middle = (knots[1:] + knots[:-1]) / 2 - starts
    for outside, rest in ((middle < 0, trajectory.start), (middle > trajectory.duration, trajectory.end)):
        found[outside] = 0.0
        found[outside, 0] = rest
    return found
