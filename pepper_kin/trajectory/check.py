"""Examination of a trajectory by code other than what made it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.balance import balance_margin, support_polygon
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.jerk_limits import JerkLike, jerk_limits
from pepper_kin.trajectory.payload import AtFrames, at_frames, hand_speeds, payload_torque, wheel_speeds
from pepper_kin.trajectory.quantities import unit_of
from pepper_kin.trajectory.trajectory import State, Trajectory, sample_times

Array = NDArray[np.float64]

STEP = 0.001  # [s]
JUMP_TOLERANCE = 1e-6  # [rad, m, rad/s or m/s]
RELATIVE_TOLERANCE = 1e-7  # of a limit's range, for rounding
_TOUCH = 1e-9  # [m] depth stated for a contact whose depth is not known


def check(
    pepper: PepperModel,
    trajectory: Trajectory,
    *,
    scene: Any | None = None,
    collisions: bool = True,
    jerk: JerkLike | None = None,
    balance: float | None = 0.0,
    hand_speed: float | Mapping[str, float] | None = None,
    payload: Mapping[str, float] | None = None,
) -> Certificate:
    """Examine a trajectory at every millisecond and on both sides of every knot.

    Position, velocity and acceleration, evaluated here by NumPy, are compared with the robot's limits;
    torques are computed by `pepper_kin.dynamics.newton_euler`: neither shares code with what times
    trajectories.  Positions and velocities (and accelerations, where jerk is limited) must be continuous at
    knots; the zero-moment point must lie in the triangle of the wheels.

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        scene: The `pepper_kin.collision.Scene` around the robot; None for nothing.  The clearance of
            the robot from itself is measured in any case.
        collisions: Whether collisions are examined; False leaves them out, and the result says so.
        jerk: Jerk limits as in `retime`; None leaves jerk out.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m], as in
            `retime`; None lets the base be held from below.
        hand_speed: Greatest speed of both hands' effectors, or of "left", "right" or a frame by name [m/s];
            None leaves them out.
        payload: Point masses held at "left", "right" or frames by name [kg].

    Returns:
        The certificate.

    Raises:
        InvalidValueError: where the trajectory's joints are not the robot's, in its order; or for an option
            out of range.
    """
    from pepper_kin import dynamics
    from pepper_kin.collision.checked_world import checked_world

    if trajectory.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the trajectory", ", ".join(trajectory.joint_names), ", ".join(pepper.joint_names)
        )
    world = checked_world(scene, collisions)
    held, speeds = (
        at_frames(pepper, "payload", payload, "kg"),
        hand_speeds(pepper, hand_speed) + wheel_speeds(pepper),
    )
    time, state = _states(trajectory)
    lower, upper = pepper.lower_limits, pepper.upper_limits
    torque = dynamics.newton_euler(pepper, *state) + payload_torque(pepper, held, *state)
    polygon = None if balance is None else support_polygon(pepper)
    rate = None if jerk is None else jerk_limits(pepper, jerk)

    def against(quantity: str, value: Array, lower: Array, upper: Array) -> LimitCheck:
        return _limit_check(pepper, quantity, time, value, lower, upper)

    v, a, tau = pepper.velocity_limits, pepper.acceleration_limits, pepper.effort_limits
    return Certificate(
        duration=trajectory.duration,
        samples=time.size,
        step=STEP,
        position=against("position", state.position, lower, upper),
        velocity=against("velocity", state.velocity, -v, v),
        acceleration=against("acceleration", state.acceleration, -a, a),
        torque=against("torque", torque, -tau, tau),
        position_continuity=_continuity(trajectory, 0),
        velocity_continuity=_continuity(trajectory, 1),
        balance=None if polygon is None else _balance(pepper, polygon, time, state, balance or 0.0, held),
        clearance=None if world is None else _clearance(pepper, trajectory, world),
        jerk=None if rate is None else against("jerk", _jerks(trajectory), -rate, rate),
        acceleration_continuity=None if rate is None else _continuity(trajectory, 2),
        hand_speed=_speed(pepper, time, state, speeds) if speeds else None,
    )


def _states(trajectory: Trajectory) -> tuple[Array, State]:
    """Return times (T,) and states (T, n): every millisecond, and both sides of every knot."""
    time, segment, local = _sample_times(trajectory)
    return time, State(*_derivatives(trajectory, segment, local, 3))


def _jerks(trajectory: Trajectory) -> Array:
    """Return the jerks at the times of `_states`, shape (T, n)."""
    return _derivatives(trajectory, *_sample_times(trajectory)[1:], 4)[3]


def _sample_times(trajectory: Trajectory) -> tuple[Array, NDArray[np.intp], Array]:
    """Return times, and their pieces and times since the start of these, shape (T,)."""
    knots = trajectory.knots
    regular = sample_times(trajectory.duration, STEP)
    inside = np.clip(np.searchsorted(knots, regular, side="right") - 1, 0, knots.size - 2)
    segments, step = np.arange(knots.size - 1), np.diff(knots)
    return (
        np.concatenate([regular, knots[:-1], knots[1:]]),
        np.concatenate([inside, segments, segments]),
        np.concatenate([regular - knots[inside], 0 * step, step]),
    )


def _derivatives(trajectory: Trajectory, segment: NDArray[np.intp], local: Array, count: int) -> list[Array]:
    """Return value and first derivatives of the polynomials, shape (T, n) each.

    Horner's scheme for all of them at once: the sums of its steps are p(x), p'(x), p''(x) / 2, ...
    """
    coefficients, x = trajectory.coefficients, local[:, None]
    sums = [np.zeros((segment.size, coefficients.shape[2])) for _ in range(count)]
    order = coefficients.shape[1]
    for power in range(order - 1, -1, -1):
        # A sum is zero until as many coefficients have been met.
        for k in range(min(count - 1, order - 1 - power), 0, -1):
            sums[k] *= x
            sums[k] += sums[k - 1]
        sums[0] *= x
        sums[0] += coefficients[segment, power]
    return [total * math.factorial(k) for k, total in enumerate(sums)]


def _limit_check(
    pepper: PepperModel, quantity: str, time: Array, value: Array, lower: Array, upper: Array
) -> LimitCheck:
    distance = np.minimum(value - lower, upper - value)
    at = np.argmin(distance, axis=0)
    joints = np.arange(pepper.n)
    units = tuple(unit_of(quantity, unit) for unit in pepper.joint_units)
    with np.errstate(invalid="ignore"):
        tolerance = np.where(np.isfinite(upper - lower), RELATIVE_TOLERANCE * (upper - lower) / 2, 0.0)
    return LimitCheck(
        quantity=quantity,
        joint_names=pepper.joint_names,
        units=units,
        margin=distance[at, joints],
        value=value[at, joints],
        lower=lower,
        upper=upper,
        time=time[at],
        tolerance=tolerance,
    )


def _continuity(trajectory: Trajectory, derivative: int) -> ScalarCheck:
    quantity = ("position", "velocity", "acceleration")[derivative]
    step, segments = np.diff(trajectory.knots), np.arange(trajectory.knots.size - 1)
    before = _derivatives(trajectory, segments[:-1], step[:-1], derivative + 1)[-1]
    after = _derivatives(trajectory, segments[1:], 0.0 * step[1:], derivative + 1)[-1]
    jumps = np.abs(after - before)
    worst, time, joint = 0.0, 0.0, trajectory.joint_names[0]
    if jumps.size:
        knot, index = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
        worst, time = float(jumps[knot, index]), float(trajectory.knots[knot + 1])
        joint = trajectory.joint_names[index]
    unit = ("rad or m", "rad/s or m/s", "rad/s^2 or m/s^2")[derivative]
    detail = f"is the greatest jump at a knot ({joint})"
    return ScalarCheck(f"{quantity} continuity", JUMP_TOLERANCE - worst, worst, time, unit, detail)


def _balance(
    pepper: PepperModel, polygon: Array, time: Array, state: State, wanted: float, payload: AtFrames
) -> ScalarCheck:
    margin = balance_margin(pepper, polygon, *state, payload)
    at = int(np.argmin(margin))
    worst = float(margin[at])
    detail = "from the zero-moment point to the edge of the wheels' triangle (negative: outside)"
    return ScalarCheck("balance", worst - wanted + RELATIVE_TOLERANCE, worst, float(time[at]), "m", detail)


def _speed(pepper: PepperModel, time: Array, state: State, speeds: AtFrames) -> ScalarCheck:
    """Compare the speeds of frames, by Jacobians, with their limits; report the one that uses most."""
    from pepper_kin import kinematics

    found = []
    for frame, limit in speeds:
        jacobian = kinematics.frame_jacobian(pepper, state.position, frame)[:, :3]
        speed = np.linalg.norm(np.einsum("tij,tj->ti", jacobian, state.velocity), axis=1)
        at = int(np.argmax(speed))
        found.append((float(speed[at]) / limit, float(speed[at]), limit, float(time[at]), frame))
    _, value, limit, time_at, frame = max(found)
    margin = limit * (1 + RELATIVE_TOLERANCE) - value
    return ScalarCheck(
        "hand speed", margin, value, time_at, "m/s", f"of {frame}, whose limit is {limit:.4g} m/s"
    )


def _clearance(pepper: PepperModel, trajectory: Trajectory, scene: Any) -> ScalarCheck:
    """Find the least distance of all milliseconds; neighbors decided by joint ranges count as yes or no."""
    from pepper_kin import collision

    time, segment, local = _sample_times(trajectory)
    count = sample_times(trajectory.duration, STEP).size
    positions = _derivatives(trajectory, segment[:count], local[:count], 1)[0]
    found = collision.least_clearance(pepper, positions, scene)
    worst, at = found.distance, found.index
    pair = "" if found.pair is None else " between " + " and ".join(found.pair.names)
    detail = f"is the least distance{pair}"
    if found.forbidden is not None and worst > 0:
        worst, at = -_TOUCH, found.forbidden
        detail = "two neighboring links touch, by their joint ranges"
    return ScalarCheck("clearance", worst, worst, float(time[at]), "m", detail)
