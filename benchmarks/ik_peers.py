"""Targets of the comparison of inverse kinematics, the verdict on answers, and other libraries.

Each library has its own tasks and limits, and 100 steps at most from neutral.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from harness import Served

import pepper_kin as pk
from pepper_kin.ik.solvers.placo import robot_of

PEPPER = pk.load_pepper().with_requirements("limits")
LOW, HIGH = PEPPER.lower_limits, PEPPER.upper_limits
LEFT, RIGHT, CAMERA = "LArm_effector", "RArm_effector", "CameraTop_frame"
Case = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Poses of both hands, the point looked at, and the pose of the camera."""

Solver = Callable[[str, Case], np.ndarray]

CLASSES = {
    "a": "hand position",
    "b": "hand position and pointing",
    "c": "gaze",
    "d": "both hands and gaze",
    "e": "hand position clear of self-collision",
}


def cases(count: int, seed: int, clear: bool) -> list[Case]:
    """Return targets that joint positions drawn evenly within the limits meet."""
    generator = np.random.default_rng(seed)
    found: list[Case] = []
    while len(found) < count:
        q = generator.uniform(LOW, HIGH)
        if clear and pk.collision.in_collision(PEPPER, q):
            continue
        left, right, camera = (pk.kinematics.frame_pose(PEPPER, q, f) for f in (LEFT, RIGHT, CAMERA))
        point = camera[:3, 3] + generator.uniform(0.5, 3.0) * camera[:3, 0]
        found.append((left, right, point, camera))
    return found


def tasks_of(kind: str, case: Case) -> list[pk.ik.Task]:
    """Return the tasks of a class."""
    left, right, point, _ = case
    if kind == "c":
        return [pk.ik.LookAt(point)]
    hand = pk.ik.HandPosition("left", left[:3, 3])
    if kind == "b":
        return [hand, pk.ik.Point("left", left[:3, 0])]
    if kind == "d":
        return [hand, pk.ik.HandPosition("right", right[:3, 3]), pk.ik.LookAt(point)]
    return [hand]


def is_solved(kind: str, case: Case, q: np.ndarray) -> bool:
    """Whether q is within the limits and less than 1 mm and 0.5 degrees away (and clear, for class e)."""
    if not (np.isfinite(q).all() and np.all(q >= LOW - 1e-9) and np.all(q <= HIGH + 1e-9)):
        return False
    if kind == "e" and pk.collision.in_collision(PEPPER, q):
        return False
    return all(
        task.error(PEPPER, q) <= (1e-3 if task.unit == "m" else math.radians(0.5))
        for task in tasks_of(kind, case)
    )


FORWARD = np.eye(3)[0]
STEPS = 100
CLOSE = 1e-4  # [m] and [rad]


def descent_of_placo(robot, start, hands, aim=None, gaze=None, steps=STEPS) -> np.ndarray:
    """Return where placo, used directly, leads from a start; hands are points, the aim that of the left."""
    import placo

    robot.state.q = np.concatenate([(0, 0, 0, 0, 0, 0, 1), start])
    robot.model.lowerPositionLimit = np.concatenate([[-1e6] * 7, LOW])
    robot.model.upperPositionLimit = np.concatenate([[1e6] * 7, HIGH])
    robot.update_kinematics()
    solver = placo.KinematicsSolver(robot)
    solver.mask_fbase(True)
    solver.enable_joint_limits(True)
    tasks = [solver.add_position_task(frame, point) for frame, point in hands.items()]
    if aim is not None:
        tasks.append(solver.add_axisalign_task(LEFT, FORWARD, aim))
    if gaze is not None:
        tasks.append(solver.add_axisalign_task(CAMERA, FORWARD, FORWARD))
    for number, task in enumerate(tasks):
        task.configure(f"t{number}", "soft", 1.0)
    solver.add_regularization_task(1e-4)
    for _ in range(steps):
        if gaze is not None:
            line = gaze - robot.get_T_world_frame(CAMERA)[:3, 3]
            tasks[-1].targetAxis_world = line / np.linalg.norm(line)
        try:
            step = solver.solve(True)
        except RuntimeError:
            break
        robot.update_kinematics()
        if np.abs(step).max() < 1e-5:
            break
    return np.clip(np.array(robot.state.q[7:]), LOW, HIGH)


def lean_placo() -> Solver:
    """Return placo used directly."""
    robot, start = robot_of(PEPPER), PEPPER.neutral()

    def solve(kind: str, case: Case) -> np.ndarray:
        left, right, point, _ = case
        hands = {LEFT: left[:3, 3]} if kind in "abde" else {}
        hands |= {RIGHT: right[:3, 3]} if kind == "d" else {}
        aim = left[:3, 0] if kind == "b" else None
        return descent_of_placo(robot, start, hands, aim, point if kind in "cd" else None)

    return solve


def _pink_direction_task(pink: Any) -> type:
    """Return a task for Pink that turns a frame's x axis to a direction, or to a point.

    With R and p the frame's pose and d the unit vector to the target, seen in the frame, e = d - x, and
    de/dq = [d]x J_w - (I - d d^T) J_v / |target - p|, J the Jacobian in the frame.
    """

    class DirectionTask(pink.tasks.Task):  # type: ignore[misc, name-defined]
        def __init__(self, frame: str, target: np.ndarray, is_point: bool) -> None:
            super().__init__(cost=1.0, lm_damping=1e-6)
            self.frame, self.target, self.is_point = frame, target, is_point

        def _poses(self, configuration: Any) -> tuple[np.ndarray, float]:
            pose = configuration.get_transform_frame_to_world(self.frame)
            line = self.target - pose.translation if self.is_point else self.target
            distance = float(np.linalg.norm(line))
            return pose.rotation.T @ line / distance, distance

        def compute_error(self, configuration: Any) -> np.ndarray:
            return self._poses(configuration)[0] - FORWARD

        def compute_jacobian(self, configuration: Any) -> np.ndarray:
            d, distance = self._poses(configuration)
            jacobian = configuration.get_frame_jacobian(self.frame)
            turn = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]]) @ jacobian[3:]
            if not self.is_point:
                return turn
            return turn - (jacobian[:3] - np.outer(d, d @ jacobian[:3])) / distance

        def __repr__(self) -> str:
            return f"DirectionTask({self.frame!r})"

    return DirectionTask


def lean_pink(qp: str, restarts: int = 0) -> Solver:
    """Return Pink with joint limits; pointing and gaze are tasks of ours, for Pink has none.

    With restarts, a descent that ends elsewhere is followed by one from joint positions drawn evenly.
    """
    import pink
    import pinocchio
    import qpsolvers

    if qp not in qpsolvers.available_solvers:
        raise ImportError(f"qpsolvers lacks {qp}")
    model = PEPPER.inner_model
    start = PEPPER.neutral()
    direction_task = _pink_direction_task(pink)

    def hand(frame: str, pose: np.ndarray) -> Any:
        task = pink.tasks.FrameTask(frame, position_cost=1.0, orientation_cost=0.0, lm_damping=1e-6)
        task.set_target(pinocchio.SE3(np.eye(3), pose[:3, 3]))
        return task

    rng = np.random.default_rng(0)

    def solve(kind: str, case: Case) -> np.ndarray:
        for attempt in range(1 + restarts):
            q, close = descended(kind, case, rng.uniform(LOW, HIGH) if attempt else start)
            if close:
                break
        return np.clip(q, LOW, HIGH)

    def descended(kind: str, case: Case, q: np.ndarray) -> tuple[np.ndarray, bool]:
        configuration = pink.Configuration(model, model.createData(), q)
        tasks = [hand(LEFT, case[0])] if kind != "c" else []
        if kind == "b":
            tasks.append(direction_task(LEFT, case[0][:3, 0], False))
        if kind == "d":
            tasks.append(hand(RIGHT, case[1]))
        if kind in "cd":
            tasks.append(direction_task(CAMERA, case[2], True))
        for _ in range(STEPS):
            try:
                velocity = pink.solve_ik(
                    configuration, tasks, 0.1, solver=qp, damping=1e-4, safety_break=False
                )
            except pink.exceptions.NoSolutionFound:
                break
            configuration.integrate_inplace(velocity, 0.1)
            if all(np.linalg.norm(task.compute_error(configuration)[:3]) < CLOSE for task in tasks):
                return configuration.q, True
        return configuration.q, False

    return solve


def lean_mink(qp: str = "daqp") -> Solver:
    """Return mink on the robot as MJCF, with its own frame, axis and look-at tasks."""
    import mink
    import mujoco

    from pepper_kin.model.export_mjcf import mjcf_text

    model = mujoco.MjModel.from_xml_string(mjcf_text(PEPPER))
    places = [int(model.joint(name).qposadr[0]) for name in PEPPER.joint_names]
    start = np.array(model.qpos0)
    start[places] = PEPPER.neutral()
    limits = [mink.ConfigurationLimit(model)]

    def kind_of(frame: str) -> str:
        return "site" if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, frame) >= 0 else "body"

    def hand(frame: str, pose: np.ndarray) -> Any:
        task = mink.FrameTask(frame, kind_of(frame), position_cost=1.0, orientation_cost=0.0, lm_damping=1e-6)
        task.set_target(mink.SE3.from_translation(pose[:3, 3]))
        return task

    def toward(task_class: Any, frame: str, target: np.ndarray) -> Any:
        task = task_class(frame, kind_of(frame), axis=FORWARD, cost=1.0, lm_damping=1e-6)
        task.set_target(target)
        return task

    def solve(kind: str, case: Case) -> np.ndarray:
        configuration = mink.Configuration(model, start)
        tasks = [hand(LEFT, case[0])] if kind != "c" else []
        if kind == "b":
            tasks.append(toward(mink.AxisAlignTask, LEFT, case[0][:3, 0]))
        if kind == "d":
            tasks.append(hand(RIGHT, case[1]))
        if kind in "cd":
            tasks.append(toward(mink.LookAtTask, CAMERA, case[2]))
        for _ in range(STEPS):
            try:
                velocity = mink.solve_ik(configuration, tasks, 0.1, qp, damping=1e-4, limits=limits)
            except mink.NoSolutionFound:
                break
            configuration.integrate_inplace(velocity, 0.1)
            if all(np.linalg.norm(task.compute_error(configuration)[:3]) < CLOSE for task in tasks):
                break
        return np.clip(configuration.q[places], LOW, HIGH)

    return solve


class Roboplan(Served):
    """RoboPlan's simple IK in a process of its own, asked target by target.

    It takes whole poses only, so it gets those of the joint positions that the target was made from; its
    robot has no collision shapes, for its restarts have to be clear by its own pairs.
    """

    time = 0.0
    """Of the last call, measured in the other process [s]."""

    def __init__(self, python: str, restarts: int) -> None:
        root = ElementTree.fromstring(PEPPER.export("urdf", mesh_paths="absolute"))
        for link in root.iter("link"):
            for shape in link.findall("collision"):
                link.remove(shape)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "pepper.urdf"
            path.write_bytes(ElementTree.tostring(root))
            start = dict(zip(PEPPER.joint_names, PEPPER.neutral().tolist(), strict=True))
            server = Path(__file__).with_name("ik_roboplan_server.py")
            super().__init__(python, server, path, restarts, json.dumps(start))
            names = self.read()
        self._order = [names.index(name) for name in PEPPER.joint_names]

    def __call__(self, kind: str, case: Case) -> np.ndarray:
        """Return the joint positions that RoboPlan finds."""
        left, right, _, camera = case
        goals = {"c": [(CAMERA, camera)], "d": [(LEFT, left), (RIGHT, right), (CAMERA, camera)]}
        answer = self.ask([(frame, pose.tolist()) for frame, pose in goals.get(kind, [(LEFT, left)])])
        self.time = answer["time"]
        return np.clip(np.array(answer["q"])[self._order], LOW, HIGH)
