"""Whether a path from anywhere may be followed, or the first state that may not, and why."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Scene
from pepper_kin.dynamics import gravity_torque, inverse_dynamics
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.dense_states import AnyPath, DenseStates, dense_states, given_path
from pepper_kin.motion.goals import fault_of
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.trajectory import Trajectory

Array = NDArray[np.float64]

TOLERANCE = 1e-7
"""Of a limit, for rounding."""
_BLOCK = 2048


class ValidationStatus(Enum):
    """What the first invalid state breaks; `advice` says what to try."""

    VALID = "valid"
    JOINT_LIMIT = "joint_limit"
    COLLISION = "collision"
    TOO_HEAVY = "too_heavy"
    VELOCITY_LIMIT = "velocity_limit"
    ACCELERATION_LIMIT = "acceleration_limit"
    TORQUE_LIMIT = "torque_limit"

    @property
    def advice(self) -> str:
        """One sentence: what to try."""
        return _ADVICE[self]


_ADVICE = {
    ValidationStatus.VALID: "Time a path with retime(), or make it shorter with simplify_path().",
    ValidationStatus.JOINT_LIMIT: "Keep the path within the joint limits, or check the order of the joints.",
    ValidationStatus.COLLISION: "Plan between the states before and after it with plan().",
    ValidationStatus.TOO_HEAVY: "Lead the path through postures that the joints can hold against gravity.",
    ValidationStatus.VELOCITY_LIMIT: "Time its path anew with retime().",
    ValidationStatus.ACCELERATION_LIMIT: "Time its path anew with retime().",
    ValidationStatus.TORQUE_LIMIT: "Time its path anew with retime().",
}


@dataclass(frozen=True, eq=False)
class Validation:
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
    def valid(self) -> bool:
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
    pepper: PepperModel, path: AnyPath, scene: Scene | None = None, *, margin: float = 0.0
) -> Validation:
    """Check a path, a curve or a trajectory from anywhere: joint limits, collisions, torque.

    States are looked at so densely that no point of the body moves farther than half a millimetre from one to
    the next.  Of paths and curves each state has to be one that the joints can hold against gravity, as
    `plan` asks; of a trajectory, velocity, acceleration and torque have to be within their limits, in motion.

    Args:
        pepper: The robot.
        path: Way-points [rad or m], shape (k, n), which straight edges join; a piecewise cubic curve; a plan;
            or a trajectory.
        scene: The world around the robot, with what it holds; None for the robot alone.
        margin: Distance that is to be kept to the scene [m].

    Returns:
        Valid, or the first state that is not, and what it breaks.

    Raises:
        InvalidValueError: for a wrong shape, NaN, a trajectory of other joints, or a margin below zero.
        InfeasibleError: for a plan that failed, with its reason.
    """
    if not (np.isfinite(margin) and margin >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    checks, given = Checks(pepper, scene), given_path(pepper, path)
    dense = dense_states(pepper, scene, given)
    look = _Look(checks, dense, margin)
    found = look.limits(dense.positions, pepper.lower_limits, pepper.upper_limits, "position", "rad", "m")
    end = len(dense.places) if found is None else found[0]
    found = (look.motion(given, end) if isinstance(given, Trajectory) else look.heavy(end)) or found
    found = look.touching(end if found is None else found[0]) or found
    if found is None:
        return Validation(
            ValidationStatus.VALID,
            f"Valid: {len(dense.places)} states, half a millimetre apart at most.",
            states_checked=len(dense.places),
        )
    at, status, what, joint = found
    q, place = dense.positions[at], float(dense.places[at])
    contacts = checks.exact.contacts(q) if status is ValidationStatus.COLLISION else ()
    where = f"{place:.6g} s" if isinstance(given, Trajectory) else f"{place:.6g} of {dense.places[-1]:.6g}"
    message = f"Invalid from {where} on: {what}"
    return Validation(status, message, place, read_only(q.copy()), contacts, joint, at + 1)


Found = tuple[int, ValidationStatus, str, "str | None"]
"""Number of the first invalid state, what it breaks, a sentence, and the joint to blame."""


class _Look:
    """Looks at states in order; each method returns the first that breaks something, or None."""

    def __init__(self, checks: Checks, dense: DenseStates, margin: float) -> None:
        self.checks, self.dense, self.margin = checks, dense, margin
        self.pepper = checks.pepper

    def limits(
        self, values: Array, lower: Array, upper: Array, quantity: str, turning: str, sliding: str
    ) -> Found | None:
        """Compare values of the states, shape (m, n), with limits, shape (n,) each."""
        slack = TOLERANCE * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
        outside = (values < lower - slack) | (values > upper + slack)
        rows = outside.any(axis=1)
        if not rows.any():
            return None
        at = int(np.argmax(rows))
        joint = int(np.argmax(outside[at]))
        name, unit = (
            self.pepper.joint_names[joint],
            turning if self.pepper.joint_units[joint] == "rad" else sliding,
        )
        what = (
            f"the {quantity} of {name} is {values[at, joint]:.6g} {unit}, "
            f"outside [{lower[joint]:.6g}, {upper[joint]:.6g}] {unit}."
        )
        return at, _STATUS_OF[quantity], what, name

    def motion(self, trajectory: Trajectory, end: int) -> Found | None:
        """Look at velocity, acceleration and torque of the first states."""
        found: Found | None = None
        if not end:
            return found
        pepper, state = self.pepper, trajectory(self.dense.places[:end])
        for quantity, values, most, units in (
            ("velocity", state.velocity, pepper.velocity_limits, ("rad/s", "m/s")),
            ("acceleration", state.acceleration, pepper.acceleration_limits, ("rad/s^2", "m/s^2")),
            ("torque", inverse_dynamics(pepper, *state), pepper.effort_limits, ("N m", "N")),
        ):
            here = self.limits(values, -most, most, quantity, *units)
            found = here if here is not None and (found is None or here[0] < found[0]) else found
        return found

    def heavy(self, end: int) -> Found | None:
        """Look for the first state that the joints cannot hold still, among the first ones."""
        holds = self.checks.holds(self.dense.positions[:end]) if end else np.ones(0, bool)
        if holds.all():
            return None
        at = int(np.argmin(holds))
        return self._named(at, ValidationStatus.TOO_HEAVY)

    def touching(self, end: int) -> Found | None:
        """Look for the first state that touches something, among the first ones."""
        q = self.dense.positions
        if not end:
            return None
        free_of = self.checks.along(q[0], np.flatnonzero(np.ptp(q, axis=0) > 0.0), (self.margin, 0.0))
        for begin in range(0, end, _BLOCK):
            block = np.ascontiguousarray(q[begin : min(begin + _BLOCK, end)])
            free = free_of(block)
            if not free.all():
                return self._named(begin + int(np.argmin(free)), ValidationStatus.COLLISION)
        return None

    def _named(self, at: int, status: ValidationStatus) -> Found:
        """Say what is wrong with a state as `plan` says it of ends."""
        checker, q = self.checks.exact, self.dense.positions[at]
        fault = fault_of(checker, q, "state")
        if status is ValidationStatus.COLLISION and (fault is None or fault[0] is PlanStatus.GOAL_TOO_HEAVY):
            pair = checker.closest_pair(q)
            if pair is None:
                return at, status, "the state is nearer than the margin.", None
            near = f"{' and '.join(pair.names)} are {1000 * pair.distance:.1f} mm apart"
            return at, status, f"{near}, less than the margin of {1000 * self.margin:.1f} mm.", None
        sentence = "the joints can hardly hold it." if fault is None else fault[1]
        joint = None
        if status is ValidationStatus.TOO_HEAVY:
            load = np.abs(gravity_torque(self.pepper, q)) / self.pepper.effort_limits
            joint = self.pepper.joint_names[int(np.argmax(load))]
        return at, status, sentence[:1].lower() + sentence[1:], joint


_STATUS_OF = {
    "position": ValidationStatus.JOINT_LIMIT,
    "velocity": ValidationStatus.VELOCITY_LIMIT,
    "acceleration": ValidationStatus.ACCELERATION_LIMIT,
    "torque": ValidationStatus.TORQUE_LIMIT,
}
