"""Static limits of postures: holding torques and balance, including carried loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin import symbolic
from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.collision.fast import StaticLoads
from pepper_kin.collision.loads import (
    LoadParameters,
    carrying,
    load_parameters,
    load_torque,
    loads_of,
)
from pepper_kin.core.collision.curve_check import LONGEST
from pepper_kin.core.collision.layout import EDGE_NUMBERS
from pepper_kin.core.kernel_batch import evaluate
from pepper_kin.dynamics import center_of_mass, gravity_torque, total_mass
from pepper_kin.dynamics.load import STATIC_PARAMETERS, Loads, carried_words
from pepper_kin.dynamics.mass import joint_masses
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.ik import CenterOfMassOverWheels, Task
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest
from pepper_kin.model.moving_tree import moving_tree
from pepper_kin.model.requirements import HOLDING_SHARE, ROOM_TO_MOVE, Balance, TorqueScale, kept_torque_scale
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.trajectory.balance import (
    balance_margin,
    moment_matrix,
    moves_base,
    support_polygon,
)

if TYPE_CHECKING:
    import casadi

    from pepper_kin.collision import Scene


ROOM_ALONG = ROOM_TO_MOVE / 2
"""Balance reserve that curves keep, half of `ROOM_TO_MOVE`, since they cut the corners of paths [m]."""

LONGEST_ARM = 0.5
"""Assumed distance of a load from the center of mass in inverse kinematics [m]."""

LEAST_STEP, LONGEST_STEP = 0.0005, 0.1
"""Minimum and maximum motion of a body point between curve states whose holding torques are checked [m]."""

_WRENCH = [2, 3, 4]  # components of the floor's wrench: force along z, moments about x and y
_GRAVITY = 9.81  # [m/s^2]
_UNITS = {"rad": "N m", "m": "N"}

_SOURCES = (
    "pepper_kin.symbolic",
    "pepper_kin.model",
    "pepper_kin.trajectory.balance",
    "pepper_kin.dynamics.load",
)


@dataclass(frozen=True, eq=False)
class StaticLimits:
    """Limits of postures at rest, as `retime` would keep them in an infinitely slow motion.

    Attributes:
        pepper: The robot.
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m]; None if
            the base is held.
        carrying: Carried loads.
        torque_scale: Fraction of the effort limits that a motion may use; holding may use `HOLDING_SHARE` of
            it.
    """

    pepper: PepperModel
    balance: float | None = None
    carrying: Loads = ()
    torque_scale: float = 1.0

    @property
    def holding_share(self) -> float:
        """Fraction of the effort limits that holding may use."""
        return HOLDING_SHARE * self.torque_scale

    def __post_init__(self) -> None:
        """Load or compile the kernel before any clock starts."""
        _ = self.kernel  # no assert, which -O leaves out

    @cached_property
    def kernel(self) -> Kernel:
        """Kernel from a vector of configuration and load parameters to static loads, see `StaticLoads`."""
        frames, balanced = self._parameters.frames, self.balance is not None
        if not frames and not balanced:
            return kernel(self.pepper, "gravity_torque")
        return _static_kernel(self.pepper, frames, balanced)

    @cached_property
    def effort_limits(self) -> Array:
        """Maximum holding efforts of the joints [N m or N], shape (n,)."""
        return self.holding_share * self.pepper.effort_limits

    @cached_property
    def loads(self) -> StaticLoads:
        """Inputs of compiled checks of edges."""
        return self._loads(ROOM_TO_MOVE)

    @cached_property
    def loads_along(self) -> StaticLoads:
        """Inputs of compiled checks of curves, whose states are at most `step` apart."""
        return self._loads(ROOM_ALONG)

    def _loads(self, margin: float) -> StaticLoads:
        """Return inputs of compiled checks that keep a margin [m] to the edges of the wheels' triangle."""
        if self.balance is None and not self.carrying:
            return StaticLoads(self.kernel)
        return StaticLoads(self.kernel, self._parameters.static, np.ascontiguousarray(self._edges(margin)))

    def tasks(self) -> tuple[Task, ...]:
        """Return tasks that lead inverse kinematics to balanced postures with the carried loads."""
        if self.balance is None:
            return ()
        shift = LONGEST_ARM * sum(load.mass for load in self.carrying) / total_mass(self.pepper)
        margin = self.balance + ROOM_TO_MOVE + shift
        return (CenterOfMassOverWheels(margin, contacts=support_polygon(self.pepper)),)

    def hold(self, q: Array, margin: float = ROOM_TO_MOVE) -> NDArray[np.bool_]:
        """Whether postures, shape (m, n), may be states of a path; shape (m,).

        Args:
            q: Postures [rad or m], shape (m, n).
            margin: Distance to keep beyond `balance` [m]; curves keep `ROOM_ALONG`.
        """
        if self.pepper.solvers != "fast":
            robot = carrying(self.pepper, self.carrying)
            held = (np.abs(gravity_torque(robot, q)) <= self.effort_limits).all(axis=1)
            if self.balance is not None:
                placed = q.copy()
                placed[:, self._base] = 0.0
                edges, (x, y, z) = self._edges(margin), -total_mass(robot) * robot.inner_model.gravity.linear
                arms = edges[:, 1:] @ np.array([[0.0, z, -y], [-z, 0.0, x]])  # of n = c x f
                held &= (edges[:, 0] * z + center_of_mass(robot, placed) @ arms.T >= 0.0).all(axis=1)
            return np.asarray(held)
        n, inputs, carried = self.pepper.n, np.ascontiguousarray(q), self._parameters.static
        if carried.size:
            inputs = np.empty((len(q), n + carried.size))
            inputs[:, :n], inputs[:, n:] = q, carried
        found = evaluate(self.kernel, inputs)
        held = (np.abs(found[:, :n]) <= self.effort_limits).all(axis=1)
        if self.balance is not None:
            held &= (found[:, n:] @ self._edges(margin).T >= 0.0).all(axis=1)
        return np.asarray(held)

    @cached_property
    def step(self) -> float:
        """Maximum motion of any point of the body between checked states of a curve [m].

        If no mass moves farther than d, the torque of a revolute joint changes by at most g m d, with m the
        mass that it carries, and the center of mass by at most d.  Half a step thus uses at most the unused
        reserve of effort and distance.  For the robot alone without balance, steps are not shorter than those
        of the collision check.
        """
        spare = (self.torque_scale - self.holding_share) * self.pepper.effort_limits
        carried = _GRAVITY * np.maximum(self._carried_masses(), 1e-9)
        most = 2.0 * float((spare / carried).min(initial=np.inf))
        if self.balance is not None:
            most = min(most, ROOM_TO_MOVE)
        least = LONGEST if self.balance is None and not self.carrying else LEAST_STEP
        return min(max(most, least), LONGEST_STEP)

    def torque(self, q: Array) -> Array:
        """Return the effort that holds a posture, shape (n,), still, by Pinocchio [N m or N], shape (n,)."""
        none = np.zeros_like(q)
        torque = gravity_torque(self.pepper, q)
        return torque + load_torque(self.pepper, self.carrying, q, none, none) if self.carrying else torque

    def weakest(self, q: Array) -> int | None:
        """Return the index of the joint most overloaded by a posture, shape (n,); None if all can hold it."""
        joint = self.most_loaded(q)
        use = np.abs(self.torque(q)[joint]) / max(self.pepper.effort_limits[joint], 1e-12)
        return joint if use > self.holding_share else None

    def most_loaded(self, q: Array) -> int:
        """Return the index of the joint that needs most of its effort to hold a posture, shape (n,)."""
        return int(np.argmax(np.abs(self.torque(q)) / np.maximum(self.pepper.effort_limits, 1e-12)))

    def distance_inside(self, q: Array) -> float:
        """Return the distance of the center of mass inside the wheels' triangle at q, shape (n,) [m]."""
        polygon, none = support_polygon(self.pepper), np.zeros((1, q.size))
        if polygon is None:
            return float("inf")
        return float(balance_margin(self.pepper, polygon, q[None], none, none, self.carrying)[0])

    def tips(self, q: Array, margin: float = ROOM_TO_MOVE) -> bool:
        """Return whether a posture is nearer to tipping over than a path may be.

        Args:
            q: The posture [rad or m], shape (n,).
            margin: Distance to keep beyond `balance` [m].
        """
        return self.balance is not None and self.distance_inside(q) < self.balance + margin

    @property
    def carried(self) -> str:
        """Carried loads in words; empty for none."""
        return carried_words(self.carrying)

    def violation(self, q: Array, what: str, margin: float = ROOM_TO_MOVE) -> str:
        """Return a sentence on the limit that a posture exceeds most; empty if it can be held.

        Args:
            q: The posture [rad or m], shape (n,).
            what: Name of the posture, such as "start".
            margin: Distance to keep beyond `balance` [m].
        """
        joint, carried = self.weakest(q), self.carried
        if joint is not None:
            name, unit = self.pepper.joint_names[joint], _UNITS[self.pepper.joint_units[joint]]
            needed, limit = abs(self.torque(q)[joint]), self.pepper.effort_limits[joint]
            most = f"near or over the {_amount(limit)} {unit} it has"
            if needed < limit * HOLDING_SHARE:
                share = 100 * self.holding_share
                most = f"over {share:.3g} % of its {_amount(limit)} {unit}, all that torque_scale leaves"
            return f"The {what} takes {_amount(needed)} {unit} at {name}{carried}, {most}."
        if not self.tips(q, margin):
            return ""
        inside, requested = 1000 * self.distance_inside(q), 1000 * float(self.balance or 0.0)
        where = f"{inside:.1f} mm inside" if inside >= 0 else f"{-inside:.1f} mm outside"
        return (
            f"The {what} has the center of mass{carried} {where} the edge of the wheels' triangle, "
            f"and balance asks for {requested:.1f} mm and {1000 * margin:.0f} mm to move with."
        )

    def short_of(self, q: Array) -> str:
        """Return in a word or two what is insufficient for a posture, shape (n,), that cannot be held."""
        joint = self.weakest(q)
        return "balance" if joint is None else f"torque of {self.pepper.joint_names[joint]}"

    @cached_property
    def _parameters(self) -> LoadParameters:
        return load_parameters(self.pepper, self.carrying)

    def _edges(self, margin: float) -> Array:
        """Return the matrix from the floor's force and moments to edge moments, shape (k, 3)."""
        found = self._known_edges.get(margin)
        if found is None:
            polygon = support_polygon(self.pepper)
            if self.balance is None or polygon is None:
                found = np.empty((0, EDGE_NUMBERS))
            else:
                found = np.asarray(moment_matrix(polygon, self.balance + margin)[_WRENCH].T)
            self._known_edges[margin] = found
        return found

    @cached_property
    def _known_edges(self) -> dict[float, Array]:
        """Margin [m] -> matrix of `_edges`, for `ROOM_TO_MOVE`, `ROOM_ALONG` and few more."""
        return {}

    @cached_property
    def _base(self) -> list[int]:
        """Indices of the base's joints, on which balance at rest does not depend."""
        return [self.pepper.joint_index(joint) for joint in BASE_JOINTS] if moves_base(self.pepper) else []

    def _carried_masses(self) -> Array:
        """Return the mass that each joint carries [kg], shape (n,)."""
        tree, masses = moving_tree(self.pepper), joint_masses(self.pepper).copy()
        for load in self.carrying:
            masses[tree.frame_joints[load.frame]] += load.mass
        for i in range(tree.count - 1, 0, -1):
            masses[tree.parents[i]] += masses[i]
        moved = np.asarray(self.pepper.full_map) != 0.0
        return np.asarray((moved * masses[1:, None]).sum(axis=0))


def static_limits(
    pepper: PepperModel,
    balance: Balance,
    payload: Mapping[str, float] | None,
    scene: Scene | None = None,
    torque_scale: TorqueScale = "robot",
) -> StaticLimits:
    """Return the limits of postures at rest from options of planning; see `plan`.

    Objects attached in the scene count as carried loads.

    Raises:
        InvalidValueError: for an invalid distance or mass, or balance of a robot without wheels.
        UnknownNameError: for a frame that the robot lacks.
    """
    share = kept_torque_scale(pepper, torque_scale)
    return _kept_limits(pepper, checked_balance(pepper, balance), loads_of(pepper, scene, payload), share)


@kept_for_robot(most=64)
def _kept_limits(
    pepper: PepperModel, balance: float | None, carrying: Loads, torque_scale: float
) -> StaticLimits:
    """Return the limits, created once for equal arguments."""
    return StaticLimits(pepper, balance, carrying, torque_scale)


@kept_for_robot(most=64)
def _static_kernel(pepper: PepperModel, frames: tuple[str, ...], balanced: bool) -> Kernel:
    """Return the compiled kernel of static loads."""
    sources = source_digest(*_SOURCES, __name__)
    key = f"static load {frames} {balanced} of {robot_digest(pepper)} by {sources}"
    return compile_function(lambda: _static_load(pepper, frames, balanced), key=key)


def _static_load(pepper: PepperModel, frames: tuple[str, ...], balanced: bool) -> casadi.Function:
    """Return the function from a configuration and m, m c at frames to torques and, if balanced, the wrench.

    The floor's wrench is for the base at the world's origin: on a level floor, balance at rest does not
    depend on the base's pose.
    """
    import casadi

    inputs = casadi.SX.sym("inputs", pepper.n + STATIC_PARAMETERS * len(frames))
    q, carried = inputs[: pepper.n], inputs[pepper.n :]
    pull, rest = casadi.DM(pepper.inner_model.gravity.linear), casadi.DM.zeros(pepper.n)
    torque, placed = symbolic.gravity_torque(pepper)(q), casadi.SX(q)
    for joint in BASE_JOINTS if moves_base(pepper) else ():
        placed[pepper.joint_index(joint)] = 0.0
    wrench = symbolic.base_wrench(pepper)(placed, rest, rest) if balanced else casadi.SX.zeros(6)
    for k, frame in enumerate(frames):
        mass, first = carried[STATIC_PARAMETERS * k], carried[STATIC_PARAMETERS * k + 1 :][:3]
        weight, jacobian = -mass * pull, symbolic.frame_jacobian(pepper, frame)(q)
        moment = casadi.cross(symbolic.frame_pose(pepper, frame)(q)[:3, :3] @ first, -pull)
        torque += jacobian[:3, :].T @ weight + jacobian[3:, :].T @ moment
        pose = symbolic.frame_pose(pepper, frame)(placed)
        arms = mass * pose[:3, 3] + pose[:3, :3] @ first
        wrench += casadi.vertcat(weight, casadi.cross(arms, -pull))
    found = casadi.vertcat(torque, wrench[_WRENCH]) if balanced else torque
    return casadi.Function("static_load", [inputs], [casadi.cse(casadi.densify(found))])


def _amount(value: float) -> str:
    """Return a torque or force for a message, with two decimals unless that gives 0.00."""
    return f"{value:.2f}" if 0.01 <= value < 1e6 else f"{value:.3g}"
