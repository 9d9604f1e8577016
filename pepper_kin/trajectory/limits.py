"""Limits of a motion, and the torques, edge moments and frame speeds that are compared with them."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.collision.loads import carrying, load_torque, load_wrench, loads_of
from pepper_kin.core.kernel_batch import evaluate, linear_speed_share, matrix_product
from pepper_kin.core.timing.excess import EffectKernel
from pepper_kin.core.timing.tables import StateEffects
from pepper_kin.core.timing.whole_timing import TorqueKernel
from pepper_kin.dynamics import inverse_dynamics
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.kinematics import frame_velocity
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest
from pepper_kin.model.at_frames import HANDS, AtFrames, at_frames
from pepper_kin.model.joint_vectors import as_numbers, shown
from pepper_kin.model.requirements import ROBOT, Balance, TorqueScale, checked_share, kept_torque_scale
from pepper_kin.model.wheels import WHEEL_FRAMES
from pepper_kin.trajectory.balance import (
    WheelLimits,
    edge_moments,
    moment_matrix,
    moves_base,
    support_polygon,
    wheel_limits,
)
from pepper_kin.trajectory.path import is_plan

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

expressions = lazy_module("pepper_kin.symbolic.balance")

JerkLike: TypeAlias = str | float | ArrayLike

NAMED = {"gentle": 5.0, "moderate": 10.0, "brisk": 30.0}
"""Jerk limits by name, as factors on acceleration limits [1/s]: full acceleration in 0.2, 0.1, 0.033 s."""


def share_of(size: Array, limit: Array) -> Array:
    """Return absolute values over limits, shape (..., n); for a limit of zero, 0 if it is kept, else inf."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = size / limit
    return np.where((limit == 0) & (size == 0), 0.0, share)


def moving_joints(coefficients: Array) -> NDArray[np.bool_]:
    """Return which joints move along a piecewise polynomial, coefficients of shape (m, k, n)."""
    return np.asarray(np.abs(coefficients[:, 1:]).max(axis=(0, 1)) > 0)


def refuse_motionless(pepper: PepperModel, coefficients: Array, acceleration: Array, what: str) -> None:
    """Refuse a curve that moves joints whose velocity or acceleration limits are zero.

    Args:
        pepper: The robot.
        coefficients: Coefficients of the curve, shape (m, k, n).
        acceleration: Acceleration limits [rad/s^2 or m/s^2], shape (n,).
        what: Name of the result that is then infeasible, such as "trajectory".

    Raises:
        InfeasibleError: for such a joint, naming it and the limit.
    """
    if pepper.velocity_limits.all() and acceleration.all():
        return
    for quantity, limits in (("velocity", pepper.velocity_limits), ("acceleration", acceleration)):
        for j in np.flatnonzero(moving_joints(coefficients) & (limits == 0)):
            raise InfeasibleError(
                what,
                f"{pepper.joint_names[j]} moves along the path, and its {quantity} limit is 0",
                "keep that joint where it is, or give the robot another limit by with_limits()",
            )


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of a trajectory; inf where there is no limit.

    Attributes:
        velocity: Velocity limits [rad/s or m/s], shape (n,).
        acceleration: Acceleration limits [rad/s^2 or m/s^2], shape (n,).
        torque: Effort limits [N m or N], shape (n,); None to leave torque out.
        balance: Minimum distance of the zero-moment point from the edges of the support polygon [m]; None to
            leave balance out.
        loads: Carried loads; they act on torque and balance.
        speed: Frames with maximum speeds of their origins [m/s].
        wheels: Limits of the wheels of a planar base; None for other robots.
        jerk: Jerk limits [rad/s^3 or m/s^3], shape (n,); None to leave jerk out.
        path_speed: Maximum rate of the path's parameter [1/s].
    """

    velocity: Array
    acceleration: Array
    torque: Array | None
    balance: float | None = None
    loads: Loads = ()
    speed: AtFrames = ()
    wheels: WheelLimits | None = None
    jerk: Array | None = None
    path_speed: float = np.inf


class MotionLimits(NamedTuple):
    """Fractions of a robot's limits that a motion may use, and further limits, independent of the robot.

    Attributes:
        velocity: Fraction of the velocity limits.
        acceleration: Fraction of the acceleration limits.
        torque: Fraction of the effort limits; None to leave torque out.
        balance: Minimum distance of the zero-moment point from the edges of the support polygon [m]; None to
            leave balance out.
        loads: Carried loads.
        speeds: Frames with maximum speeds of their origins [m/s].
    """

    velocity: float
    acceleration: float
    torque: float | None
    balance: float | None = None
    loads: Loads = ()
    speeds: AtFrames = ()

    def of(self, pepper: PepperModel, acceleration: Array, *, drives: bool) -> Limits:
        """Return a robot's limits multiplied by the fractions.

        Args:
            pepper: The robot.
            acceleration: Acceleration limits [rad/s^2 or m/s^2], shape (n,).
            drives: Whether the wheels of the robot's base count.
        """
        wheels = wheel_limits(pepper) if drives else None
        return Limits(
            pepper.velocity_limits * self.velocity,
            acceleration * self.acceleration,
            None if self.torque is None else pepper.effort_limits * self.torque,
            self.balance,
            self.loads,
            self.speeds,
            None if wheels is None else wheels.scaled(self.velocity, self.acceleration),
        )


def motion_limits(
    pepper: PepperModel,
    *,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: TorqueScale = 1.0,
    torque: bool = True,
    balance: Balance = None,
    hand_speed: float | Mapping[str, float] | None = None,
    payload: Mapping[str, float] | None = None,
    scene: Scene | None = None,
    along: object = None,
) -> MotionLimits:
    """Return the limits of a motion from the options of `retime`, which describes them, after checks.

    The loads are the payload and the attached objects of the scene; without a scene, the loads of a plan
    `along` which the motion goes.  An option "robot" takes the value with which the plan was made, or else
    the robot's requirement.

    Raises:
        InvalidValueError: for a scale that is not in (0, 1]; a balance that is not a distance, or is given
            for a robot without wheels; a speed or mass that is not a finite number above 0; or a scene of
            another type.
        UnknownNameError: for a frame that the robot lacks.
    """
    loads = loads_of(pepper, scene, payload)
    if scene is None and is_plan(along):
        loads += tuple(getattr(along, "loads", ()))
    if is_plan(along):
        balance = getattr(along, "balance", ROBOT) if balance == ROBOT else balance
        torque_scale = getattr(along, "torque_scale", ROBOT) if torque_scale == ROBOT else torque_scale
    if hand_speed is not None and not isinstance(hand_speed, Mapping):
        hand_speed = dict.fromkeys(HANDS, hand_speed)
    return MotionLimits(
        checked_share("velocity_scale", velocity_scale),
        checked_share("acceleration_scale", acceleration_scale),
        kept_torque_scale(pepper, torque_scale) if torque else None,
        checked_balance(pepper, balance),
        loads,
        at_frames(pepper, "hand_speed", hand_speed, "m/s"),
    )


def jerk_limits(pepper: PepperModel, jerk: JerkLike, acceleration: Array | None = None) -> Array:
    """Return the jerk limit of each joint [rad/s^3 or m/s^3], shape (n,).

    Args:
        pepper: The robot.
        jerk: A name of `NAMED`; a factor on the acceleration limits [1/s]; or limits, shape (n,), of which
            infinite ones do not act.
        acceleration: Acceleration limits [rad/s^2 or m/s^2], shape (n,); None for the robot's.

    Raises:
        UnknownNameError: for an unknown name; the message lists the known ones.
        InvalidValueError: for a number that is not above zero, or another shape.
    """
    if isinstance(jerk, str):
        if jerk not in NAMED:
            raise UnknownNameError("jerk limit", jerk, NAMED)
        jerk = NAMED[jerk]
    try:
        value = as_numbers(jerk, "jerk")
    except InvalidValueError:
        value = np.array(np.nan)
    if value.shape not in ((), (pepper.n,)) or not np.all(value > 0):
        allowed = f"a name, a factor above 0 [1/s], or {pepper.n} limits above 0"
        raise InvalidValueError("jerk", shown(jerk), allowed)
    limits = pepper.acceleration_limits if acceleration is None else acceleration
    return np.array(value if value.ndim else value * limits)


def wheel_speeds(pepper: PepperModel) -> AtFrames:
    """Return the maximum wheel speeds of a differential base, by frame [m/s]; empty for other robots."""
    wheels = pepper.wheels
    return () if wheels is None or not wheels.differential else tuple((f, wheels.speed) for f in WHEEL_FRAMES)


@kept_for_robot(most=32)
def _moment_of_wrench(pepper: PepperModel, margin: float) -> Array:
    polygon = support_polygon(pepper)
    return np.zeros((6, 0)) if polygon is None else moment_matrix(polygon, margin)


@kept_for_robot(most=32)
def _torques_and_wrench(pepper: PepperModel) -> Kernel:
    """Return a kernel of joint torques and the base wrench, hardly slower than either one alone."""
    sources = source_digest("pepper_kin.symbolic", "pepper_kin.model")
    key = f"torques and wrench of {robot_digest(pepper)} by {sources}"
    return compile_function(lambda: expressions.torques_and_wrench(pepper), key=key)


class LimitedQuantities:
    """Evaluation of all limited quantities other than joint velocity and acceleration.

    States are arrays of finite numbers, shape (T, n).

    Attributes:
        torque_limit: Effort limits of the joints, left out if torque is not limited; then acceleration limits
            of the k wheels of a planar base, which are linear in accelerations as torques are; shape (n or 0,
            + k or 0).
        edges: Number of edges of the support polygon, or 0 if balance is not limited.
        frames: Number of limited speeds: of frames, then of wheels and base.
    """

    def __init__(self, pepper: PepperModel, limits: Limits) -> None:
        self._pepper, self._limits, self._local = pepper, limits, threading.local()
        torque = limits.torque is not None and bool(np.isfinite(limits.torque).any())
        self._joint_torques = torque
        self.torque_limit = np.array(limits.torque, dtype=float) if torque else np.zeros(0)
        wheels = limits.wheels
        if wheels is not None:
            rows = np.full(len(wheels.rows), wheels.acceleration)
            self.torque_limit = np.concatenate([self.torque_limit, rows])
        self._polygon = support_polygon(pepper) if limits.balance is not None else None
        self.edges = 0 if self._polygon is None else len(self._polygon)
        self.frames = len(limits.speed) + (0 if wheels is None else wheels.speed_count)
        self._moment_of_wrench: Array | None = None
        if self.edges and limits.balance is not None and not moves_base(pepper):
            self._moment_of_wrench = _moment_of_wrench(pepper, limits.balance)

    @property
    def torque_kernel(self) -> TorqueKernel:
        """Kernel of torques without a load, for compiled functions; a dummy if torque is not limited."""
        found: TorqueKernel | None = getattr(self._local, "kernel", None)
        if found is None:
            address, work = 0, 0
            if self.torque_limit.size:
                torque = kernel(self._pepper, "inverse_dynamics")
                n, work = self._pepper.n, torque.work_size
                address = torque.address_of("batch", inputs=3 * n, outputs=n, work=work)
            found = self._local.kernel = TorqueKernel(address, np.empty(work + 8), np.empty(8, np.int64))
        return found

    @property
    def effect_kernel(self) -> EffectKernel | None:
        """Kernel of torques and edge moments for compiled code; None with loads, wheels or a moving base."""
        limits, edges = self._limits, self._moment_of_wrench
        if limits.loads or limits.wheels is not None or (self.edges and edges is None):
            return None
        found: EffectKernel | None = getattr(self._local, "effects", None)
        if found is None:
            pepper, n = self._pepper, self._pepper.n
            made = kernel(pepper, "inverse_dynamics") if edges is None else _torques_and_wrench(pepper)
            work, size = made.work_size + 8, n if edges is None else n + 6
            address = made.address_of("batch", inputs=3 * n, outputs=size, work=work)
            found = self._local.effects = EffectKernel(
                address, np.empty(work), np.empty(8, np.int64), self.torque_limit,
                np.empty((6, 0)) if edges is None else edges,
            )  # fmt: skip
        return found

    def of(self, q: Array, v: Array, a: Array) -> StateEffects:
        """Return torques, edge moments and speeds of states q, v, a, shape (T, n) each."""
        return StateEffects(self.torque(q, v, a), self.moments(q, v, a), self.speed(q, v))

    def forces(self, q: Array, v: Array, a: Array) -> Array:
        """Return torques and edge moments side by side, shape (T, n or 0, + k or 0, + edges)."""
        edges = self._moment_of_wrench
        if edges is None or not self._joint_torques or self.effect_kernel is None:
            return np.concatenate([self.torque(q, v, a), self.moments(q, v, a)], axis=1)
        n, found = self._pepper.n, _evaluated(_torques_and_wrench(self._pepper), q, v, a)
        moments = np.empty((len(q), self.edges))
        matrix_product(np.ascontiguousarray(found[:, n:]), edges, moments)
        return np.concatenate([found[:, :n], moments], axis=1)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Return torques and accelerations of wheels, shape (T, n or 0, + k or 0): see `torque_limit`."""
        torque, wheels = np.zeros((len(q), 0)), self._limits.wheels
        held = self._limits.loads
        if self._joint_torques and self._pepper.solvers != "fast":
            torque = inverse_dynamics(carrying(self._pepper, held), q, v, a)
        elif self._joint_torques:
            torque = _evaluated(kernel(self._pepper, "inverse_dynamics"), q, v, a)
            torque = torque + load_torque(self._pepper, held, q, v, a) if held else torque
        if wheels is not None:
            torque = np.concatenate([torque, wheels.accelerations(q, v, a)], axis=1)
        return torque

    def moments(self, q: Array, v: Array, a: Array) -> Array:
        """Return edge moments, shape (T, edges)."""
        if self._polygon is None or self._limits.balance is None:
            return np.zeros((len(q), 0))
        held = self._limits.loads
        if self._moment_of_wrench is None or self._pepper.solvers != "fast":
            moments = edge_moments(self._pepper, self._polygon, q, v, a, self._limits.balance, held)
            return np.ascontiguousarray(moments)
        wrench = _evaluated(kernel(self._pepper, "base_wrench"), q, v, a)
        if held:
            wrench = wrench + load_wrench(self._pepper, held, q, v, a)
        found = np.empty((len(q), self.edges))
        matrix_product(wrench, self._moment_of_wrench, found)
        return found

    def speed(self, q: Array, v: Array) -> Array:
        """Return speeds of frames, wheels and base divided by their limits, shape (T, frames)."""
        shares = np.empty((len(q), self.frames))
        for k, (frame, limit) in enumerate(self._limits.speed):
            velocity = (
                _evaluated(kernel(self._pepper, "frame_velocity", frame), q, v)
                if self._pepper.solvers == "fast"
                else frame_velocity(self._pepper, q, v, frame)
            )
            linear_speed_share(velocity, limit, k, shares)
        if self._limits.wheels is not None:
            shares[:, len(self._limits.speed) :] = self._limits.wheels.shares(q, v)
        return shares


@kept_for_robot(most=32)
def quantities_of(pepper: PepperModel, limits: Limits) -> LimitedQuantities:
    """Return the limited quantities of a robot, reused for equal limits."""
    return LimitedQuantities(pepper, limits)


def _evaluated(of: Kernel, *states: Array) -> Array:
    """Return the result of a kernel, shape (T, size of the result), for states of shape (T, n) each."""
    return evaluate(of, *(np.ascontiguousarray(state, dtype=float) for state in states))
