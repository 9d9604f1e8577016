"""Validation of paths: the first state that violates a limit or touches, and the reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array, BriefRepr, read_only
from pepper_kin.collision import Scene
from pepper_kin.collision.loads import inverse_dynamics_with
from pepper_kin.exceptions import beside_limits
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import ROBOT, Balance, TorqueScale
from pepper_kin.motion.checks import Checks, checks_for
from pepper_kin.motion.dense_states import AnyPath, DenseStates, checked_path, dense_states
from pepper_kin.motion.goals import fault_of
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.motion.problem import checked_margin
from pepper_kin.motion.static_limits import ROOM_ALONG, static_limits
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.balance import balance_margin, support_polygon
from pepper_kin.trajectory.samples import State

TOLERANCE = 1e-7
"""Of a limit, for rounding."""
_BLOCK = 2048


class ValidationStatus(ResultStatus):
    """What the first invalid state breaks; `advice` says what to try."""

    VALID = "valid", "Time a path with retime(), or make it shorter with simplify_path()."
    JOINT_LIMIT = "joint_limit", "Keep the path within the joint limits, or check the order of the joints."
    COLLISION = "collision", "Plan between the states before and after it with plan()."
    STATIC_TORQUE_LIMIT = "static_torque_limit", "Lead the path through postures that the joints can hold."
    TIPS_OVER = (
        "tips_over",
        "Keep the center of mass nearer to the middle of the wheels' triangle, or use retime(balance=).",
    )
    VELOCITY_LIMIT = "velocity_limit", "Time its path again with retime()."
    ACCELERATION_LIMIT = "acceleration_limit", "Time its path again with retime()."
    TORQUE_LIMIT = "torque_limit", "Time its path again with retime()."


@dataclass(frozen=True, eq=False)
class Validation(BriefRepr):
    """The outcome of `validate`.

    Attributes:
        status: What the first invalid state breaks.
        message: The same in a sentence, with names and numbers.
        place: Where the first invalid state is: for way-points the number of the one before it and the share
            of the edge between (2.25: a quarter of the way from number 2 to number 3), the curve's parameter,
            or the time [s]; None where all is valid.
        q: That state [rad or m], shape (n,), read-only; None where all is valid.
        contacts: Names of what touches there.
        joint: The joint to blame, or None.
        states_checked: Number of states looked at.
    """

    status: ValidationStatus
    message: str
    place: float | None = None
    q: Array | None = None
    contacts: tuple[tuple[str, str], ...] = ()
    joint: str | None = None
    states_checked: int = 0

    @property
    def success(self) -> bool:
        """Whether the whole path is valid."""
        return self.status is ValidationStatus.VALID

    @property
    def advice(self) -> str:
        """What to try, in a sentence."""
        return self.status.advice

    def report(self) -> str:
        """Say in plain words whether the path is valid, or where it is not, and what to try."""
        return f"{self.message} {self.advice}"


def validate(
    pepper: PepperModel,
    path: AnyPath,
    scene: Scene | None = None,
    *,
    margin: float = 0.0,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
) -> Validation:
    """Check a path, a curve or a trajectory from anywhere: joint limits, collisions, torque, balance.

    States are looked at so densely that no point of the body moves farther than half a millimeter from one to
    the next.  Of paths and curves each state has to be one that the joints can hold against gravity, as
    `plan` asks of its curves; of a trajectory, velocity, acceleration, torque and the zero-moment point have
    to be within their limits, in motion.

    Args:
        pepper: The robot.
        path: Way-points [rad or m], shape (k, n), which straight edges join; a piecewise cubic curve; a plan;
            or a trajectory.
        scene: The world around the robot, with what it holds; None for the robot alone.
        margin: Distance that is to be kept to the scene [m].
        balance: Distance that is kept from the edges of the wheels' triangle [m], as of `plan`: by the center
            of mass of paths and curves, with 2 mm more to move with, by the zero-moment point of
            trajectories, of which "robot" asks for 0 as `Trajectory.check` does; None leaves it out.
        torque_scale: Share of the effort limits, as of `plan`; of trajectories all of them count.
        payload: Point masses held at "left", "right" or a frame by name [kg], as of `plan`.

    Returns:
        Valid, or the first state that is not, and what it breaks.

    Raises:
        InvalidValueError: for a wrong shape, NaN, a trajectory of other joints, a margin below zero, a
            distance or mass that is none, balance of a robot without wheels, or a path so long that more than
            four million states would be looked at.
        UnknownNameError: for a frame of the payload that the robot lacks.
        InfeasibleError: for a plan that failed, with its reason.
    """
    margin = checked_margin(margin)
    followed = checked_path(pepper, path)
    if isinstance(followed, Trajectory) and balance == ROBOT and pepper.requirements.balance is not None:
        balance = 0.0
    checks = checks_for(pepper, scene, static_limits(pepper, balance, payload, scene, torque_scale))
    dense = dense_states(pepper, scene, followed)
    look = _Look(checks, dense, margin)
    found = look.limits(dense.positions, pepper.lower_limits, pepper.upper_limits, "position", "rad", "m")
    end = len(dense.places) if found is None else found[0]
    found = (look.motion(followed, end) if isinstance(followed, Trajectory) else look.heavy(end)) or found
    found = look.touching(end if found is None else found[0]) or found
    if found is None:
        return Validation(
            ValidationStatus.VALID,
            f"Valid: {len(dense.places)} states, half a millimeter apart at most.",
            states_checked=len(dense.places),
        )
    at, status, what, joint = found
    q, place = dense.positions[at], float(dense.places[at])
    contacts = checks.exact.contacts(q) if status is ValidationStatus.COLLISION else ()
    where = f"{place:.6g} s" if isinstance(followed, Trajectory) else f"{place:.6g} of {dense.places[-1]:.6g}"
    message = f"Invalid from {where} on: {what}"
    return Validation(status, message, place, read_only(q.copy()), contacts, joint, at + 1)


Finding = tuple[int, ValidationStatus, str, "str | None"]
"""Number of the first invalid state, what it breaks, a sentence, and the joint to blame."""


class _Look:
    """Looks at states in order; each method returns the first that breaks something, or None."""

    def __init__(self, checks: Checks, dense: DenseStates, margin: float) -> None:
        self.checks, self.dense, self.margin = checks, dense, margin
        self.pepper = checks.pepper

    def limits(
        self, values: Array, lower: Array, upper: Array, quantity: str, turning: str, sliding: str
    ) -> Finding | None:
        """Compare values of the states, shape (m, n), with limits, shape (n,) each."""
        slack = TOLERANCE * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
        outside = (values < lower - slack) | (values > upper + slack)
        rows = outside.any(axis=1)
        if not rows.any():
            return None
        at = int(np.argmax(rows))
        joint = int(np.argmax(outside[at]))
        name = self.pepper.joint_names[joint]
        unit = turning if self.pepper.joint_units[joint] == "rad" else sliding
        value, *limits = beside_limits(values[at, joint], lower[joint], upper[joint], outside=True, digits=6)
        what = f"the {quantity} of {name} is {value} {unit}, outside [{', '.join(limits)}] {unit}."
        return at, _STATUS_OF[quantity], what, name

    def motion(self, trajectory: Trajectory, end: int) -> Finding | None:
        """Look at velocity, acceleration, torque and balance of the first states."""
        found: Finding | None = None
        if not end:
            return found
        pepper, state = self.pepper, trajectory(self.dense.places[:end])
        torque = inverse_dynamics_with(pepper, self.checks.statics.carrying, *state)
        for quantity, values, most, units in (
            ("velocity", state.velocity, pepper.velocity_limits, ("rad/s", "m/s")),
            ("acceleration", state.acceleration, pepper.acceleration_limits, ("rad/s^2", "m/s^2")),
            ("torque", torque, pepper.effort_limits, ("N m", "N")),
        ):
            here = self.limits(values, -most, most, quantity, *units)
            found = here if here is not None and (found is None or here[0] < found[0]) else found
        tipping = self._tipping(state)
        return tipping if tipping is not None and (found is None or tipping[0] < found[0]) else found

    def _tipping(self, state: State) -> Finding | None:
        """Look for the first state in motion whose zero-moment point is not where balance asks for it."""
        statics, polygon = self.checks.statics, support_polygon(self.pepper)
        if statics.balance is None or polygon is None:
            return None
        inside = balance_margin(self.pepper, polygon, *state, statics.carrying)
        tips = inside < statics.balance - TOLERANCE
        if not tips.any():
            return None
        at = int(np.argmax(tips))
        what = (
            f"the zero-moment point{statics.carried} is {1000 * inside[at]:.1f} mm inside the edge of the "
            f"wheels' triangle, less than balance, {1000 * statics.balance:.1f} mm."
        )
        return at, ValidationStatus.TIPS_OVER, what, None

    def heavy(self, end: int) -> Finding | None:
        """Look for the first state that the joints or the floor cannot hold still, among the first ones."""
        statics, q = self.checks.statics, self.dense.positions[:end]
        holds = statics.hold(q, ROOM_ALONG) if end else np.ones(0, bool)
        if holds.all():
            return None
        at = int(np.argmin(holds))
        sentence = statics.violation(q[at], "state", ROOM_ALONG) or "the joints can hardly hold it."
        sentence = sentence[:1].lower() + sentence[1:]
        joint = statics.weakest(q[at])
        if joint is None and statics.tips(q[at], ROOM_ALONG):
            return at, ValidationStatus.TIPS_OVER, sentence, None
        joint_name = self.pepper.joint_names[statics.most_loaded(q[at])]
        return at, ValidationStatus.STATIC_TORQUE_LIMIT, sentence, joint_name

    def touching(self, end: int) -> Finding | None:
        """Look for the first state that touches something, among the first ones."""
        q = self.dense.positions
        if not end:
            return None
        free_of = self.checks.along(q[0], np.flatnonzero(np.ptp(q, axis=0) > 0.0), (self.margin, 0.0))
        for begin in range(0, end, _BLOCK):
            block = np.ascontiguousarray(q[begin : min(begin + _BLOCK, end)])
            free = free_of(block)
            if not free.all():
                return self._near(begin + int(np.argmin(free)))
        return None

    def _near(self, at: int) -> Finding:
        """Say what a state touches, or is nearer to than the margin, as `plan` says it of ends."""
        checker, q, status = self.checks.exact, self.dense.positions[at], ValidationStatus.COLLISION
        fault = fault_of(checker, q, "state", self.checks.statics)
        if fault is not None and fault[0] is PlanStatus.GOAL_IN_COLLISION:
            return at, status, fault[1][:1].lower() + fault[1][1:], None
        pair = checker.closest_pair(q)
        if pair is None:
            return at, status, "the state is nearer than the margin.", None
        near = f"{' and '.join(pair.names)} are {1000 * pair.distance:.1f} mm apart"
        return at, status, f"{near}, less than the margin of {1000 * self.margin:.1f} mm.", None


_STATUS_OF = {
    "position": ValidationStatus.JOINT_LIMIT,
    "velocity": ValidationStatus.VELOCITY_LIMIT,
    "acceleration": ValidationStatus.ACCELERATION_LIMIT,
    "torque": ValidationStatus.TORQUE_LIMIT,
}
