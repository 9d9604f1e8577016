"""Trajectories through points over time, and warnings where they overshoot the points' range."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, OvershootWarning, suspect_degrees
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_choice, check_positive, shown
from pepper_kin.trajectory.path import turning_points

if TYPE_CHECKING:
    from pepper_kin.model import PepperModel
    from pepper_kin.trajectory.trajectory import Trajectory


INTERPOLATIONS = ("cubic", "monotone")
OVERSHOOT = 0.01
"""Largest excess over the limits, or over the range of the samples, without a warning [rad or m]."""

_NAMED = 3  # number of joints named in one warning


def cubic_pieces(
    time: Array, position: Array, velocity: Array | None = None, ends: Array | None = None
) -> Array:
    """Return coefficients of the cubic pieces through points, constant term first, shape (T - 1, 4, n).

    Args:
        time: Increasing times [s], shape (T,).
        position: Positions [rad or m], shape (T, n).
        velocity: Velocities [rad/s or m/s], shape (T, n), or None for the cubic spline.
        ends: Velocities at the ends of the spline [rad/s or m/s], shape (2, n), or None: at rest.

    Raises:
        InvalidValueError: for points so near in time, or so far apart, that the velocities overflow.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        try:
            if velocity is None:
                first, last = np.zeros((2, position.shape[1])) if ends is None else ends
                spline = CubicSpline(time, position, bc_type=((1, first), (1, last)))
            else:
                spline = CubicHermiteSpline(time, position, velocity)
        except ValueError as error:
            far = f"{np.diff(time).min():.3g} s between two points"
            raise InvalidValueError("times", far, "times between which finite speeds lie") from error
    return np.moveaxis(spline.c[::-1], 0, 1)


def from_positions(
    kind: type[Trajectory],
    pepper: PepperModel | None,
    times: ArrayLike,
    positions: ArrayLike,
    *,
    joints: str | Sequence[str] | None,
    rest: ArrayLike | None,
    interpolation: str,
    overshoot: float,
    end_velocities: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Trajectory:
    """Return the trajectory of `Trajectory.from_positions`, which describes arguments and errors.

    `kind` is the class of the result.  Times [s] have shape (T,), positions [rad or m] a column for each
    joint given, and `rest` [rad or m] has shape (n,).
    """
    time = as_finite(times, "times", (None,))
    check_choice("interpolation", interpolation, INTERPOLATIONS)
    allowed = check_positive("overshoot", overshoot, "rad or m")
    if time.size < 2 or np.any(np.diff(time) <= 0):
        falls = np.flatnonzero(np.diff(time) <= 0)
        pair = (
            [f"{value:.9g} s" for value in time[falls[:1] + np.arange(2)]] if falls.size else [str(time.size)]
        )
        raise InvalidValueError("times", ", then ".join(pair), "two or more times that increase")
    names, place = _columns(pepper, joints)
    columns = as_finite(positions, "positions", (time.size, len(place)))
    if pepper is None:
        units, q, limits = ("rad",) * len(names), columns, (np.array(-np.inf), np.array(np.inf))
    else:
        others = pepper.neutral() if rest is None else as_joint_vectors(pepper, rest, "rest")
        q = np.tile(others, (time.size, 1))
        q[:, place] = columns
        units, limits = pepper.joint_units, (pepper.lower_limits, pepper.upper_limits)
    time, ends = time - time[0], np.zeros((2, len(names)))
    for row, name, velocity in zip(ends, ("start_velocity", "end_velocity"), end_velocities, strict=True):
        if velocity is not None:
            if interpolation == "monotone":
                raise InvalidValueError(name, shown(velocity), "None with interpolation='monotone': at rest")
            row[place] = as_finite(velocity, name, (len(place),))
    slopes = _monotone_slopes(time, q) if interpolation == "monotone" else None
    trajectory = kind(names, time, cubic_pieces(time, q, slopes, ends), units)
    _warn(trajectory, _excesses(trajectory, q, limits, allowed), interpolation)
    return trajectory


def _columns(
    pepper: PepperModel | None, joints: str | Sequence[str] | None
) -> tuple[tuple[str, ...], list[int]]:
    """Return the trajectory's joint names, and the joint index of each column of positions."""
    if pepper is not None:
        chosen = pepper.resolve_joints(joints)
        return pepper.joint_names, [pepper.joint_index(name) for name in chosen]
    if joints is None:
        raise InvalidValueError("joints", None, "the columns' names, where no robot is given that has them")
    names = (joints,) if isinstance(joints, str) else tuple(joints)
    return names, list(range(len(names)))


def _monotone_slopes(time: Array, q: Array) -> Array:
    """Return velocities with which cubic pieces stay between their ends, shape (T, n); 0 at both ends."""
    from scipy.interpolate import PchipInterpolator

    if time.size == 2:
        return np.zeros_like(q)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        try:
            slopes: Array = PchipInterpolator(time, q).derivative()(time)
        except ValueError as error:
            far = f"{np.diff(time).min():.3g} s between two points"
            raise InvalidValueError("times", far, "times between which finite speeds lie") from error
    slopes[[0, -1]] = 0.0
    return slopes


def _excesses(
    trajectory: Trajectory, q: Array, limits: tuple[Array, Array], allowed: float
) -> list[tuple[float, int, str]]:
    """Return excess [rad or m], joint index and words of each joint's worst position, the worst first.

    Args:
        trajectory: The trajectory.
        q: The samples [rad or m], shape (T, n).
        limits: Lower and upper limits [rad or m], shape (n,) or () each.
        allowed: Excess that is not reported [rad or m].
    """
    step = np.diff(trajectory.breaks)
    segment, joint, local = turning_points(step, trajectory.coefficients)
    value = trajectory.at_segments(segment, local).position[np.arange(segment.size), joint]
    time = trajectory.breaks[segment] + local
    # The samples themselves may be outside the limits, too.
    rows, columns = np.indices(q.shape).reshape(2, -1)
    joint, value = np.concatenate([joint, columns]), np.concatenate([value, q.reshape(-1)])
    time = np.concatenate([time, trajectory.breaks[rows]])
    found = []
    spans = (("the range of its samples", (q.min(axis=0), q.max(axis=0))), ("its limits", limits))
    for kind, bounds in spans:
        lower, upper = (np.broadcast_to(bound, q.shape[1:]) for bound in bounds)
        over = np.maximum(lower[joint] - value, value - upper[joint])
        for j in np.unique(joint[over > allowed]):
            at = int(np.argmax(np.where(joint == j, over, -np.inf)))
            unit = trajectory.joint_units[j]
            words = (
                f"{trajectory.joint_names[j]} is at {value[at]:.4g} {unit} at {time[at]:.3f} s, "
                f"{over[at]:.3g} {unit} outside {kind}"
                f"{suspect_degrees(float(value[at]), unit)}"
            )
            found.append((float(over[at]), int(j), words))
    return sorted(found, reverse=True)


def _warn(trajectory: Trajectory, found: list[tuple[float, int, str]], interpolation: str) -> None:
    if not found:
        return
    named = "; ".join(sentence for _, _, sentence in found[:_NAMED])
    more = f"; {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    outside = "" if interpolation == "monotone" else "; interpolation='monotone' stays between the samples"
    warnings.warn(f"positions between samples: {named}{more}{outside}", OvershootWarning, stacklevel=5)
