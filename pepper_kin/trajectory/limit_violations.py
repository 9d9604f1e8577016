"""Limit violations of a motion, by joint and time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import beside_limits
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.extremes import extremes_of
from pepper_kin.trajectory.quantities import unit_of
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.trajectory.sampling import EXAMINED_EVERY, State, examination_step, sample_times
from pepper_kin.trajectory.trajectory import Trajectory

JUMP = 1e-6  # [rad, m, rad/s or m/s] at a knot
_RELATIVE = 1e-7  # of a limit, for rounding
_INSIDE = np.linspace(0.0, 1.0, 10)[1:-1]  # of pieces that milliseconds may miss
_DERIVATIVES = ("position", "velocity")


@dataclass(frozen=True)
class LimitViolation:
    """One stretch of time in which one joint is outside one limit, or one jump.

    Attributes:
        joint: Name of the joint.
        quantity: "position", "velocity", "acceleration", "position jump" or "velocity jump".
        start: When it begins [s].
        end: When it ends [s]; of a jump the same.
        time: When it is worst [s].
        value: The value then; of a jump its height.
        limit: The limit that is exceeded; 0 for a jump.
        unit: Unit of value and limit.
    """

    joint: str
    quantity: str
    start: float
    end: float
    time: float
    value: float
    limit: float
    unit: str

    def sentence(self) -> str:
        """Say what was exceeded, when and by how much."""
        if self.quantity.endswith("jump"):
            return f"{self.joint}: {self.quantity} of {self.value:.4g} {self.unit} at {self.time:.3f} s"
        value, limit = beside_limits(self.value, self.limit, outside=True)
        return (
            f"{self.joint}: {self.quantity} {value} {self.unit} at {self.time:.3f} s, "
            f"limit {limit} (outside from {self.start:.3f} to {self.end:.3f} s)"
        )


def find_limit_violations(pepper: PepperModel, trajectory: Trajectory) -> tuple[LimitViolation, ...]:
    """Return every excess of position, velocity and acceleration limits, and every jump, in order of time.

    The motion is looked at every millisecond, on both sides of every knot, where a quantity is greatest and
    least, and more closely on pieces shorter than a millisecond.

    Args:
        pepper: The robot.
        trajectory: The motion; its joints must be the robot's.

    Raises:
        InvalidValueError: where the joints are not the robot's, in its order.
    """
    refuse_other_joints(pepper, trajectory.joint_names)
    time, state = _states(trajectory, _between(trajectory))
    v, a = pepper.velocity_limits, pepper.acceleration_limits
    found = [
        *_outside(pepper, "position", time, state.position, pepper.lower_limits, pepper.upper_limits),
        *_outside(pepper, "velocity", time, state.velocity, -v, v),
        *_outside(pepper, "acceleration", time, state.acceleration, -a, a),
        *_jumps(pepper, trajectory),
    ]
    return tuple(sorted(found, key=lambda violation: (violation.start, violation.joint, violation.quantity)))


def _between(trajectory: Trajectory) -> Array:
    """Return times besides those of every millisecond: of extremes, and on short pieces."""
    start, width = trajectory.knots[:-1], np.diff(trajectory.knots)
    short = width < 2 * EXAMINED_EVERY
    times = [(start[short, None] + width[short, None] * _INSIDE).ravel()]
    for order in range(3):
        found = extremes_of(trajectory.knots, trajectory.coefficients, order)
        times += [found.high_time, found.low_time]
    return np.unique(np.concatenate(times))


def _states(trajectory: Trajectory, besides: Array) -> tuple[Array, State]:
    """Return times in order (T,) and states (T, n), knots once for each side."""
    step = np.diff(trajectory.knots)
    segments = np.arange(step.size)
    regular = np.union1d(sample_times(trajectory.duration, examination_step(trajectory.duration)), besides)
    inside = regular[~np.isin(regular, trajectory.knots)]
    parts = [
        trajectory(inside),
        trajectory.at_segments(segments, 0 * step),
        trajectory.at_segments(segments, step),
    ]
    time = np.concatenate([inside, trajectory.knots[:-1], trajectory.knots[1:]])
    # At a knot the end of the piece before comes ahead of the start of the piece behind.
    side = np.concatenate([np.zeros(inside.size), np.ones(segments.size), -np.ones(segments.size)])
    order = np.lexsort((side, time))
    return time[order], State(*(np.concatenate(part)[order] for part in zip(*parts, strict=True)))


def _outside(
    pepper: PepperModel, quantity: str, time: Array, value: Array, lower: Array, upper: Array
) -> list[LimitViolation]:
    """Return the stretches of time in which joints are outside the limits of a quantity.

    Args:
        pepper: The robot.
        quantity: "position", "velocity" or "acceleration".
        time: In order [s], shape (T,).
        value: Of the quantity, in its unit, shape (T, n).
        lower: Lower limits, in the same unit, shape (n,).
        upper: Upper limits, in the same unit, shape (n,).
    """
    found = []
    with np.errstate(invalid="ignore"):
        slack = np.where(np.isfinite(upper - lower), _RELATIVE * (upper - lower), 0.0)
    over = np.maximum(value - upper, lower - value)
    for j, name in enumerate(pepper.joint_names):
        outside = np.concatenate([[False], over[:, j] > slack[j], [False]])
        edges = np.flatnonzero(np.diff(outside.astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            at = begin + int(np.argmax(over[begin:end, j]))
            worst = float(value[at, j])
            limit = float(upper[j] if worst > upper[j] else lower[j])
            unit = unit_of(quantity, pepper.joint_units[j])
            times = (float(time[begin]), float(time[end - 1]), float(time[at]))
            found.append(LimitViolation(name, quantity, *times, worst, limit, unit))
    return found


def _jumps(pepper: PepperModel, trajectory: Trajectory) -> list[LimitViolation]:
    step, segments = np.diff(trajectory.knots), np.arange(trajectory.knots.size - 1)
    before = trajectory.at_segments(segments[:-1], step[:-1])
    after = trajectory.at_segments(segments[1:], 0.0 * step[1:])
    found = []
    for order, quantity in enumerate(_DERIVATIVES):
        heights = after[order] - before[order]
        for knot, j in np.argwhere(np.abs(heights) > JUMP):
            time = float(trajectory.knots[knot + 1])
            unit = unit_of(quantity, pepper.joint_units[j])
            height = float(heights[knot, j])
            joint = pepper.joint_names[j]
            found.append(LimitViolation(joint, f"{quantity} jump", time, time, time, height, 0.0, unit))
    return found
