"""Estimates of a robot's parameters from a recording: stiffness of servos, inertial parameters, payload."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pepper_kin import dynamics
from pepper_kin.arrays import Array, FrozenArrays, kept_read_only
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification.base_parameters import base_parameters
from pepper_kin.identification.recorded_motion import CUTOFF, RecordedMotion, Solution, recorded_motion, solve
from pepper_kin.model import PepperModel
from pepper_kin.model.at_frames import HANDS
from pepper_kin.model.moving_tree import moving_tree
from pepper_kin.twin.run import Run


@dataclass(frozen=True, eq=False)
class Estimate(FrozenArrays):
    """Parameters estimated from a recording.

    Attributes:
        names: Names of the p parameters.
        units: Units of the parameters.
        values: Values of the parameters, shape (p,).
        intervals: 95 % intervals, shape (p, 2): for errors that vary within the recording, not for constant
            ones, such as a wrong mass in the description that is assumed known.
        described: Values in the robot's description, NaN for none, shape (p,).
        residual: Joint -> root mean square of the unexplained torque [N m or N].
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    intervals: Array
    described: Array
    residual: dict[str, float]

    def __post_init__(self) -> None:
        for field in ("values", "intervals", "described"):
            object.__setattr__(self, field, kept_read_only(getattr(self, field)))

    def index(self, name: str) -> int:
        """Return the index of a parameter.

        Raises:
            UnknownNameError: for a name that is not among `names`.
        """
        if name not in self.names:
            raise UnknownNameError("parameter", name, self.names)
        return self.names.index(name)

    def report(self) -> str:
        """Return a table of the parameters with their intervals and the values of the description."""
        lines = [f"{'parameter':<24}{'value':>11}{'95 % interval':>26}{'described':>12}"]
        rows = zip(self.names, self.units, self.values, self.intervals, self.described, strict=True)
        for name, unit, value, (low, high), known in rows:
            said = "-" if np.isnan(known) else f"{known:.4g}"
            lines.append(f"{name:<24}{value:>11.4g}{f'{low:.4g} .. {high:.4g}':>26}{said:>12}  {unit}")
        return "\n".join(lines)


def estimate_stiffness(
    pepper: PepperModel, run: Run, joints: str | Iterable[str] | None = None, *, cutoff: float = CUTOFF
) -> Estimate:
    """Estimate the stiffness of servos from commanded and measured positions, without torques.

    With tau the torque that a joint needs by the description, a servo without feed-forward has the error

        q_ref - q = tau / Kp + k_1 dq_ref/dt + k_2 v + k_3 dv/dt + k_4 sign(v) + k_5 sign(v) / v^2, v = dq/dt,

    where k_1 to k_4 model damping, friction, the rotor's inertia and a latency (to first order).
    Noise of the encoders is on the left side only and does not bias 1 / Kp.  Their steps do: a servo that
    reads a position in steps of s is slow after each step and fast before the next, so that its mean reading
    is ahead by s^2 Kp / (12 Kd |v|), or by less where the inertia smooths the motion; k_5 models both cases.
    The remaining effect of steps is the same in each recording of a motion: intervals come from long blocks,
    over which it changes.

    Args:
        pepper: The robot, with the masses of its description.
        run: A recording: `time`, `position` and `reference_position` are used.
        joints: Joints and groups, see `PepperModel.resolve_joints`; all if omitted.
        cutoff: Cutoff of the low-pass filter, above the frequencies of the motion [Hz].

    Returns:
        `<joint>.stiffness` [N m/rad or N/m]; an interval ends at inf if a rigid joint fits as well.

    Raises:
        UnknownNameError: for a joint or group that the robot lacks.
        InvalidValueError: for a recording of other joints, with uneven times, or too short; a joint that does
            not move in it; or a cutoff that its rate does not allow.
    """
    names = pepper.resolve_joints(joints)
    data = recorded_motion(pepper, run, names, cutoff)
    sliding = data.sliding
    # The servo's torque depends on the joint's position at the end of the step.
    error = data.filter((run.reference_position - run.position)[1:, data.moving])
    speed = np.gradient(data.filter(run.reference_position[1:, data.moving]), data.step, axis=0)
    state = data.position, data.velocity, data.acceleration
    torque = data.filter(dynamics.inverse_dynamics(pepper, *state))
    acceleration, friction, k = data.filter(data.acceleration), data.friction, len(names)
    own = data.velocity[:, data.moving]
    ahead = data.filter(np.sign(own) * np.minimum(1.0, (data.slowest / (np.abs(own) + 1e-300)) ** 2))
    values, intervals, residual = np.empty(k), np.empty((k, 2)), {}
    for j, name in enumerate(names):
        i = data.moving[j]
        columns = np.column_stack(
            [torque[:, i], speed[:, j], acceleration[:, i], friction[:, j, j::k], ahead[:, j]]
        )
        found = solve(data, columns[:, None], error[:, [j]], sliding[:, [j]], long_blocks=True)
        (low, high), compliance = found.intervals[0], found.values[0]
        values[j], residual[name] = 1.0 / compliance, float(found.residual[0] / abs(compliance))
        intervals[j] = (1.0 / high if high > 0 else np.inf), (1.0 / low if low > 0 else np.inf)
    units = tuple("N m/rad" if pepper.joint_units[j] == "rad" else "N/m" for j in data.moving)
    called = tuple(f"{name}.stiffness" for name in names)
    return Estimate(called, units, values, intervals, np.full(k, np.nan), residual)


def estimate_inertia(
    pepper: PepperModel, run: Run, joints: str | Iterable[str] | None = None, *, cutoff: float = CUTOFF
) -> Estimate:
    """Estimate base parameters of joints that move, and their friction, from recorded torques.

    tau = Y(q, v, a) beta + J a + d v + c sign(v), with J a rotor's inertia behind its gear, v and a by
    differences of filtered positions, and torques and columns through the same filter (Gautier 1997).
    `LElbowRoll.mc_x` is the parameter of the body behind the joint, including the parameters that torques
    cannot distinguish from it.

    Args:
        pepper: The robot; its masses are used for `described` only.
        run: A recording: `time`, `position` and `torque` are used.
        joints: Joints and groups that move; the others are at rest.  All if omitted.
        cutoff: Cutoff of the low-pass filter, above the frequencies of the motion [Hz].

    Returns:
        The base parameters, including rotor inertias (`<joint>.rotor`) that torques distinguish from the
        bodies' parameters, then `<joint>.viscous` and `<joint>.coulomb`.

    Raises:
        UnknownNameError: for a joint or group that the robot lacks.
        InvalidValueError: as `estimate_stiffness`.
    """
    names = pepper.resolve_joints(joints)
    data = recorded_motion(pepper, run, names, cutoff)
    base = base_parameters(pepper, names, data.position[0])
    columns = data.regressor(np.eye(base.grouping.shape[1] + len(names))[:, base.columns])
    found = solve(data, np.concatenate([columns, data.friction], axis=2), data.torque, data.sliding)
    return _with_friction(data, found, (base.names, base.units, base.of(pepper)))


def estimate_payload(
    pepper: PepperModel,
    run: Run,
    frame: str,
    joints: str | Iterable[str] | None = None,
    *,
    cutoff: float = CUTOFF,
) -> Estimate:
    """Estimate mass and center of the load of a frame from recorded torques.

    The torques minus the torques of the description are linear in mass and first moment of the load, with
    the inertia of a point near the frame's origin; friction and rotors are estimated with them.

    Args:
        pepper: The robot, with the masses of its description.
        run: A recording: `time`, `position` and `torque` are used.
        frame: "left" or "right" for a hand, or the link or frame that carries it.
        joints: Joints and groups whose torques are used; all if omitted.
        cutoff: Cutoff of the low-pass filter, above the frequencies of the motion [Hz].

    Returns:
        `mass` [kg], `x`, `y` and `z` of its center in the frame's axes [m], then friction as in
        `estimate_inertia`.

    Raises:
        UnknownNameError: for a joint, group or frame that the robot lacks.
        InvalidValueError: as `estimate_stiffness`; or for a frame that no joint moves.
    """
    names, tree, frame = pepper.resolve_joints(joints), moving_tree(pepper), HANDS.get(frame, frame)
    if frame not in tree.frame_joints:
        raise UnknownNameError("frame", frame, (*HANDS, *pepper.frame_names))
    body = tree.frame_joints[frame] - 1
    if body < 0:
        raise InvalidValueError("frame", frame, "a frame that a joint moves")
    data = recorded_motion(pepper, run, names, cutoff)
    known = dynamics.inertial_parameters(pepper)
    of = np.zeros((known.size + len(names), 5 + len(names)))
    of[known.size :, 5:] = np.eye(len(names))  # the rotors' columns
    of[10 * body : 10 * body + 10, :4] = _point_columns(tree.frame_poses[frame])
    of[: known.size, 4] = known
    load, described, rotors = np.split(data.regressor(of), [4, 5], axis=2)
    target = data.torque - described[..., 0]
    found = solve(data, np.concatenate([load, data.friction, rotors], axis=2), target, data.sliding)
    mass, moment, k = found.values[0], found.values[1:4], len(names)
    # Center = first moment / mass, with its covariance to first order.
    change = np.eye(len(found.values))
    change[1:4, 0], change[1:4, 1:4] = -moment / mass**2, np.eye(3) / mass
    center = np.concatenate([[mass], moment / mass, found.values[4:]])
    found = found._replace(values=center, covariance=change @ found.covariance @ change.T)
    found = found._replace(values=found.values[:-k], covariance=found.covariance[:-k, :-k])
    return _with_friction(data, found, (("mass", "x", "y", "z"), ("kg", "m", "m", "m"), np.full(4, np.nan)))


def _point_columns(place: Array) -> Array:
    """Return D with pi = D (m, m d), shape (10, 4), for a mass m at the position d in a frame, for small d.

    pi are the mass's `dynamics.inertial_parameters`.

    Args:
        place: Pose of the frame on its body, shape (4, 4).
    """
    p, columns = place[:3, 3], np.zeros((10, 4))
    for k in range(4):
        mass, moment = (1.0, np.zeros(3)) if k == 0 else (0.0, place[:3, k - 1])
        second = mass * np.outer(p, p) + np.outer(p, moment) + np.outer(moment, p)
        inertia = np.trace(second) * np.eye(3) - second
        columns[:, k] = mass, *(mass * p + moment), *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return columns


def _with_friction(
    data: RecordedMotion, found: Solution, first: tuple[tuple[str, ...], tuple[str, ...], Array]
) -> Estimate:
    """Return the estimate of a solution; `first` has names, units and described values before friction."""
    names, units, described = first
    joint_units = [data.pepper.joint_units[j] for j in data.moving]
    force = ["N m" if unit == "rad" else "N" for unit in joint_units]
    return Estimate(
        (*names, *(f"{name}.{kind}" for kind in ("viscous", "coulomb") for name in data.names)),
        (*units, *(f"{f} s/{unit}" for f, unit in zip(force, joint_units, strict=True)), *force),
        found.values,
        found.intervals,
        np.concatenate([described, np.full(2 * len(force), np.nan)]),
        dict(zip(data.names, found.residual.tolist(), strict=True)),
    )
