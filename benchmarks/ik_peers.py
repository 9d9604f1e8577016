"""Other libraries on the same targets, each by its own tasks and limits, 100 steps at most from neutral."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from ik_targets import CAMERA, HIGH, LEFT, LOW, PEPPER, RIGHT, Case, Solver

from pepper_kin.ik.solvers.placo import robot_of

FORWARD = np.eye(3)[0]
STEPS = 100
CLOSE = 1e-4  # [m] and [rad]


def lean_placo() -> Solver:
    """Return placo used directly."""
    import placo

    robot = robot_of(PEPPER)
    start = PEPPER.neutral()

    def solve(kind: str, case: Case) -> np.ndarray:
        left, right, point, _ = case
        robot.state.q = np.concatenate([(0, 0, 0, 0, 0, 0, 1), start])
        robot.model.lowerPositionLimit = np.concatenate([[-1e6] * 7, LOW])
        robot.model.upperPositionLimit = np.concatenate([[1e6] * 7, HIGH])
        robot.update_kinematics()
        solver = placo.KinematicsSolver(robot)
        solver.mask_fbase(True)
        solver.enable_joint_limits(True)
        parts = []
        if kind in "abde":
            parts.append((solver.add_position_task(LEFT, left[:3, 3]), 1.0))
        if kind == "b":
            parts.append((solver.add_axisalign_task(LEFT, FORWARD, left[:3, 0]), 1.0))
        if kind == "d":
            parts.append((solver.add_position_task(RIGHT, right[:3, 3]), 1.0))
        if kind in "cd":
            parts.append((solver.add_axisalign_task(CAMERA, FORWARD, FORWARD), 1.0))
        for number, (task, weight) in enumerate(parts):
            task.configure(f"t{number}", "soft", weight)
        solver.add_regularization_task(1e-4)
        for _ in range(STEPS):
            if kind in "cd":
                line = point - robot.get_T_world_frame(CAMERA)[:3, 3]
                parts[-1][0].targetAxis_world = line / np.linalg.norm(line)
            try:
                step = solver.solve(True)
            except RuntimeError:
                break
            robot.update_kinematics()
            if np.abs(step).max() < 1e-5:
                break
        return np.clip(np.array(robot.state.q[7:]), LOW, HIGH)

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


def lean_pink(qp: str, restarts: int = 0) -> Solver | None:
    """Return Pink with joint limits; pointing and gaze are tasks of ours, for Pink has none.

    With restarts, a descent that ends elsewhere is followed by one from joint positions drawn evenly.
    """
    try:
        import pink
        import pinocchio
        import qpsolvers
    except ImportError as error:
        print(f"Pink with {qp} is left out: {error}")
        return None
    if qp not in qpsolvers.available_solvers:
        print(f"Pink with {qp} is left out: qpsolvers lacks {qp}")
        return None
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


def lean_mink(qp: str = "daqp") -> Solver | None:
    """Return mink on the robot as MJCF, with its own frame, axis and look-at tasks."""
    try:
        import mink
        import mujoco
    except ImportError as error:
        print(f"mink is left out: {error}")
        return None
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


class Roboplan:
    """RoboPlan's simple IK in a process of its own, asked target by target.

    It takes whole poses only, so it gets those of the joint positions that the target was made from.

    Args:
        python: Interpreter of the environment that RoboPlan is installed in.
        restarts: Restarts that it may use.
    """

    def __init__(self, python: str, restarts: int) -> None:
        self._folder = tempfile.TemporaryDirectory()
        path = Path(self._folder.name) / "pepper.urdf"
        path.write_text(_without_collision(PEPPER.export("urdf", mesh_paths="absolute")))
        self._complaints = (Path(self._folder.name) / "stderr").open("w+")
        start = dict(zip(PEPPER.joint_names, PEPPER.neutral().tolist(), strict=True))
        server = Path(__file__).with_name("ik_roboplan_server.py")
        self._process = subprocess.Popen(
            [python, str(server), str(path), str(restarts), json.dumps(start)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            text=True,
        )
        names = json.loads(self._read())
        self._order = [names.index(name) for name in PEPPER.joint_names]
        self.time = 0.0
        """Of the last call, measured in the other process [s]."""

    def __call__(self, kind: str, case: Case) -> np.ndarray:
        """Return the joint positions that RoboPlan finds."""
        left, right, _, camera = case
        goals = {"c": [(CAMERA, camera)], "d": [(LEFT, left), (RIGHT, right), (CAMERA, camera)]}
        wanted = [(frame, pose.tolist()) for frame, pose in goals.get(kind, [(LEFT, left)])]
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(wanted) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._read())
        self.time = answer["time"]
        return np.clip(np.array(answer["q"])[self._order], LOW, HIGH)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()
        self._complaints.close()
        self._folder.cleanup()

    def _read(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._complaints.seek(0)
            raise RuntimeError(f"RoboPlan's process ended: {self._complaints.read()[-300:]}")
        return line


def _without_collision(urdf: str) -> str:
    """Return the robot without collision shapes: RoboPlan's restarts have to be clear by its own pairs."""
    root = ElementTree.fromstring(urdf)
    for link in root.iter("link"):
        for shape in link.findall("collision"):
            link.remove(shape)
    return ElementTree.tostring(root, encoding="unicode")


def roboplan(python: str | None, restarts: int) -> Roboplan | None:
    """Return RoboPlan, or None, with a message, where no environment was named or it does not run there."""
    if python is None:
        print("RoboPlan is left out: name the interpreter that has it with --roboplan-python")
        return None
    try:
        return Roboplan(python, restarts)
    except (RuntimeError, OSError) as error:
        print(f"RoboPlan is left out: {error}")
        return None
