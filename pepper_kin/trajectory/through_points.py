"""The trajectory through points over time, as files have them."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.trajectory.interpolation import cubic_pieces
from pepper_kin.trajectory.samples import Samples
from pepper_kin.trajectory.trajectory import Trajectory


def through_points(
    names: tuple[str, ...],
    units: tuple[str, ...],
    time: Array,
    position: Array,
    velocity: Array | None = None,
    acceleration: Array | None = None,
) -> Trajectory:
    """Return the trajectory through points, by as much as is known of them.

    Args:
        names: Joints.
        units: Of the joints.
        time: Rising from 0 [s], shape (T,).
        position: [rad or m], shape (T, n).
        velocity: [rad/s or m/s], shape (T, n), or None: the cubic spline that starts and ends at rest.
        acceleration: [rad/s^2 or m/s^2], shape (T, n), or None: cubic pieces through the velocities.

    Returns:
        The trajectory; of degree 5 where all three are known.

    Raises:
        InvalidValueError: for points so near in time, or so far apart, that the polynomials overflow.
    """
    if velocity is not None and acceleration is not None:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return Samples(names, time, position, velocity, acceleration, units).to_trajectory()
    return Trajectory(names, time, cubic_pieces(time, position, velocity), units)
