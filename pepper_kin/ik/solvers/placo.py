"""Steps by placo's task solver."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.inverse_kinematics.local_solver import STEP_BOUND
from pepper_kin.exceptions import InvalidValueError, ModelError, optional
from pepper_kin.ik.problem import POSTURE_WEIGHT, TaskProblem
from pepper_kin.ik.solver import HalfSpaces, StepSolver
from pepper_kin.ik.tasks.center_of_mass import CenterOfMass
from pepper_kin.ik.tasks.frame_orientation import FrameOrientation
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.relative_orientation import RelativeOrientation
from pepper_kin.ik.tasks.relative_position import RelativePosition
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels.working_time import not_counted
from pepper_kin.model import PepperModel, RobotMemory
from pepper_kin.model.plain_urdf import plain_urdf

# placo's robots have a floating base: its seven coordinates and six velocities come first, and are fixed.
BASE_POSITION = 7
BASE_VELOCITY = 6
HOME = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)

# Position limit that stands for none [rad or m]: placo needs finite bounds.
UNBOUNDED = 1e6

_robots: RobotMemory[str, threading.local] = RobotMemory()


class PlacoSolver(StepSolver):
    """Solver of steps by `placo.KinematicsSolver`.

    Positions, orientations (in the world or relative to another frame), the center of mass and postures are
    placo's own tasks, mimic joints its gears. Other tasks enter as pairs of soft joint-space half-spaces, J
    dq + r <= 0 and >= 0, whose penalties add up to |J dq + r|^2: placo's axis task leaves out how a camera's
    motion shifts the direction to a point.

    Rhoban, PlaCo: rigid body planning and control (software).

    Args:
        problem: The problem.

    Raises:
        InvalidValueError: for a robot with mimic joints that placo does not support.
        MissingDependencyError: if placo is not installed.
    """

    def __init__(self, problem: TaskProblem) -> None:
        placo = _placo()
        self._problem = problem
        pepper = problem.pepper
        self._robot = robot_of(pepper)
        self._rows = _full_rows(pepper)
        self._follows: np.ndarray = np.abs(pepper.full_map[:, problem.movable]).max(axis=1, initial=0.0) > 0
        self._solver = placo.KinematicsSolver(self._robot)
        self._solver.mask_fbase(True)
        self._solver.enable_joint_limits(True)
        self._solver.enable_velocity_limits(False)
        self._linearized: list[tuple[int, Task, Any]] = []
        for place, task in enumerate(problem.tasks):
            self._add(place, task)
        self._posture = self._solver.add_joints_task()
        self._posture.configure("posture", "soft", POSTURE_WEIGHT**2)
        self._damping = self._solver.add_regularization_task(1.0)
        self._lock_and_couple()

    def step(
        self,
        q: Array,
        residuals: Sequence[Array],
        reference: Array,
        damping: float,
        half_spaces: HalfSpaces | None = None,
    ) -> Array | None:
        """Return the step dq from q, shape (n,) each [rad or m]; see `StepSolver`."""
        problem, pepper = self._problem, self._problem.pepper
        if not problem.movable.any():
            return np.zeros(pepper.n)
        self._enter(q)
        for place, task, pair in self._linearized:
            pair.A, pair.b = self._pair(q, task.strength, residuals[place], task.jacobian(pepper, q))
        self._posture.set_joints(
            {pepper.joint_names[i]: float(reference[i]) for i in np.flatnonzero(problem.movable)}
        )
        for i in np.flatnonzero(problem.movable):
            self._damping.set_joint_weight(pepper.joint_names[i], float(damping * problem.scale[i] ** 2))
        constraint = None if half_spaces is None else self._constrain(q, half_spaces)
        try:
            full = np.array(self._solver.solve(False))[BASE_VELOCITY:]
        except RuntimeError:
            return None
        finally:
            if constraint is not None:
                self._solver.remove_constraint(constraint)
        step = np.where(problem.movable, full[self._rows], 0.0)
        return np.clip(step, -STEP_BOUND, STEP_BOUND) if np.isfinite(step).all() else None

    def _enter(self, q: Array) -> None:
        """Set the robot's state to q, shape (n,) [rad or m], and its limits to the box of this step.

        All solvers of a thread share the robot.
        """
        problem, model = self._problem, self._robot.model
        self._robot.state.q = np.concatenate([HOME, problem.pepper.to_full(q)])
        lower = np.full(model.nq, -UNBOUNDED)
        upper = np.full(model.nq, UNBOUNDED)
        places = BASE_POSITION + self._rows
        lower[places] = np.maximum(problem.lower, q - STEP_BOUND)
        upper[places] = np.minimum(problem.upper, q + STEP_BOUND)
        model.lowerPositionLimit, model.upperPositionLimit = lower, upper
        self._robot.update_kinematics()

    def _constrain(self, q: Array, half_spaces: HalfSpaces) -> Any:
        """Add normals (q + dq) <= offsets + normals q, placo's form, at q, shape (n,) [rad or m]."""
        normals = np.zeros((half_spaces.offsets.size, self._robot.model.nq))
        normals[:, BASE_POSITION + self._rows] = half_spaces.normals
        constraint = self._solver.add_joint_space_half_spaces_constraint(
            normals, half_spaces.offsets + half_spaces.normals @ q
        )
        constraint.configure("half-spaces", "hard", 1.0)
        return constraint

    def _add(self, place: int, task: Task) -> None:
        """Add placo's own task if it has one, else half-spaces, as for a user's task class."""
        own = self._own_task(task) if task.structure() is not None else None
        if own is not None:
            own.configure(f"{task.label} {place}", "soft", task.strength**2)
            return
        pair = self._solver.add_joint_space_half_spaces_constraint(np.zeros((1, 1)), np.zeros(1))
        pair.configure(f"{task.label} {place}", "soft", 1.0)
        self._linearized.append((place, task, pair))

    def _own_task(self, task: Task) -> Any:
        """Return a new task of placo's for a task of this library, or None."""
        pepper, solver = self._problem.pepper, self._solver
        match task:
            case FramePosition():
                return solver.add_position_task(task.frame, task.target)
            case FrameOrientation():
                return solver.add_orientation_task(task.frame, task.target)
            case RelativePosition():
                return solver.add_relative_position_task(task.reference, task.frame, task.target)
            case RelativeOrientation():
                return solver.add_relative_orientation_task(task.reference, task.frame, task.target)
            case CenterOfMass():
                own = solver.add_com_task(np.append(task.target, 0.0))
                own.mask.set_axises("xy")
                return own
            case JointPosture():
                names = [pepper.joint_names[i] for i in task.indices(pepper)]
                own = solver.add_joints_task()
                own.set_joints(dict(zip(names, task.target.tolist(), strict=True)))
                return own
        return None

    def _pair(self, q: Array, weight: float, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """Return A and b of the inequalities A (q + dq) <= b that stand for w (J dq + r) = 0.

        Args:
            q: Joint positions [rad or m], shape (n,).
            weight: w.
            residual: r, shape (m,).
            jacobian: J, shape (m, n).

        Returns:
            A, shape (2 m, N), with a column for each of placo's N coordinates, and b, shape (2 m,).
        """
        rows = np.zeros((residual.size, self._robot.model.nq))
        rows[:, BASE_POSITION + self._rows] = weight * jacobian
        right = weight * (jacobian @ q - residual)
        return np.vstack([rows, -rows]), np.concatenate([right, -right])

    def _lock_and_couple(self) -> None:
        """Fix joints that may not move, and couple mimic joints to their leaders by gears."""
        pepper = self._problem.pepper
        gears = None
        for row, name in enumerate(_full_names(self._robot)):
            if not self._follows[row]:
                self._solver.mask_dof(name)
            elif name not in pepper.joint_names:
                self._damping.set_joint_weight(name, 0.0)
                gears = gears if gears is not None else self._solver.add_gear_task()
                leader = int(np.argmax(np.abs(pepper.full_map[row])))
                gears.add_gear(name, pepper.joint_names[leader], float(pepper.full_map[row, leader]))
        if gears is not None:
            gears.configure("mimic joints", "hard", 1.0)


def _placo() -> Any:
    """Return the module `placo`.

    Raises:
        MissingDependencyError: where it is not installed.
    """
    with not_counted():
        return optional("placo", extra="reference", need='solver="placo"')


def robot_of(pepper: PepperModel) -> Any:
    """Return placo's robot for a model, built once per thread and cached while the model lives.

    Raises:
        ModelError: if placo orders the joints differently.
        InvalidValueError: for mimic joints with an offset, which placo's gears lack.
    """
    placo = _placo()
    local = _robots.of(pepper).setdefault("", threading.local())
    robot: Any = getattr(local, "robot", None)
    if robot is None:
        if np.abs(pepper.full_offset).max() > 0:
            raise InvalidValueError(
                "solver", "'placo'", "'proxsuite' for a robot whose mimic joints have an offset"
            )
        with not_counted():
            robot = placo.RobotWrapper("", placo.Flags.ignore_collisions, plain_urdf(pepper.document))
        if _full_names(robot) != list(pepper.inner_model.names)[1:]:
            raise ModelError(f"placo orders the joints of robot {pepper.name!r} in another way")
        changed = pepper.dynamics_model.changed()
        if changed is not None:
            _change(robot.model, changed)
        local.robot = robot
    return robot


def _change(model: Any, changed: Any) -> None:
    """Copy inertias, placements and gravity of a changed model to placo's, which has a floating base."""
    for joint, inertia in enumerate(changed.inertias):
        model.inertias[joint + 1] = inertia
        if joint > 0:
            model.jointPlacements[joint + 1] = changed.jointPlacements[joint]
    for frame in changed.frames:
        if model.existFrame(frame.name):
            model.frames[model.getFrameId(frame.name)].placement = frame.placement
    model.gravity = changed.gravity


def _full_names(robot: Any) -> list[str]:
    """Return the names of placo's joints without the world and the floating base."""
    return list(robot.model.names)[2:]


def _full_rows(pepper: PepperModel) -> np.ndarray:
    """Return the index of each joint among all joints, mimic joints included, shape (n,)."""
    full = list(pepper.inner_model.names)[1:]
    return np.array([full.index(name) for name in pepper.joint_names])
