"""Calls that work: an argument for every parameter of the public functions."""

from __future__ import annotations

import inspect
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from misuse_calls import SUBJECTS

import pepper_kin as pk

ONE_JOINT = """<robot name="arm"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="LArm_effector"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="HeadYaw" type="revolute"><parent link="base"/><child link="LArm_effector"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="10"/></joint></robot>"""


class Samples:
    """Objects that arguments are made of: a robot, a scene, a motion, a problem of the planners, files."""

    def __init__(self) -> None:
        self.robot, self.drive = pk.load_pepper(), pk.load_pepper(base="planar")
        self.stand = self.robot.posture("Stand")
        self.n, self.zero = self.robot.n, np.zeros(self.robot.n)
        self.raised = self.robot.joint_vector({"RShoulderPitch": 0.4, "RElbowRoll": 0.8})
        self.scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
        self.motion = pk.retime(self.robot, [self.stand, self.raised])
        self.task = pk.ik.HandPosition("left", (0.38, 0.22, 0.82))
        self.box = pk.model.Box((0.1, 0.1, 0.1))
        self.monitor = pk.twin.base.BalanceMonitor(self.robot)
        self.times = np.linspace(0, 0.1, 5)
        self.still = np.tile(self.stand, (5, 1))
        self.timeline = pk.files.naoqi_timeline(["HeadYaw"], [[0.5, 1.0]], [[0.1, 0.2]])
        self._make_problem()
        self._make_others()
        self._write_files()

    def _make_problem(self) -> None:
        """Make a problem in the plane, a line in it, a price and paths."""
        planners = pk.planners
        self.free = lambda x: np.ones(len(x), dtype=bool)
        box, ends = ([0.0, 0.0], [1.0, 1.0]), ([0.1, 0.1], [0.9, 0.9])
        self.problem = planners.Problem(*box, *ends, self.free, resolution=0.05)
        self.path = planners.Path([[0.1, 0.1], [0.5, 0.9], [0.9, 0.9]])
        self.line = planners.ConstraintManifold(
            lambda x: (x[:, :1] - x[:, 1:], np.tile([[[1.0, -1.0]]], (len(x), 1, 1))), 2, 1
        )
        self.price = planners.StateCost(lambda x: (x[:, :1] ** 2, 2 * x[:, None, :] * [1.0, 0.0]), 2)
        self.on_line = planners.Path(np.linspace(0.1, 0.9, 17)[:, None] * [1.0, 1.0])

    def _make_others(self) -> None:
        """Make a robot of one joint, and objects of other robots and of other numbers of coordinates."""
        self.arm = pk.load_robot(ONE_JOINT)
        driven = pk.retime(self.drive, [self.drive.posture("Stand"), 0.9 * self.drive.posture("Stand")])
        planners, cube = pk.planners, ([0.0] * 3, [1.0] * 3, [0.1] * 3, [0.9] * 3)
        self.others: dict[type, list[Any]] = {
            type(self.motion): [driven, pk.retime(self.arm, [[0.0], [1.0]], acceleration_limits=1.0)],
            type(self.problem): [planners.Problem(*cube, self.free, resolution=0.05)],
            type(self.path): [planners.Path([[0.1] * 3, [0.9] * 3]), planners.Path([[0.1], [0.9]])],
            type(self.line): [planners.ConstraintManifold(lambda x: (x[:, :1], x[:, None, :] * 0 + 1), 3, 1)],
            type(self.price): [planners.StateCost(lambda x: (x[:, :1] ** 2, 2 * x[:, None, :]), 3)],
            type(self.monitor): [pk.twin.base.BalanceMonitor(self.drive)],
            type(self.timeline): [pk.files.naoqi_timeline(["none"], [[0.5, 1.0]], [[0.1, 0.2]])],
        }

    def _write_files(self) -> None:
        """Write a motion and a table into a folder that is removed with this object."""
        self._temporary = tempfile.TemporaryDirectory()
        self.folder = Path(self._temporary.name)
        pk.files.save(self.motion, self.folder / "motion.csv")
        pk.files.save_table({"time": self.times, "A.position": self.times}, self.folder / "table.csv")


def robots_and_motions(s: Samples) -> dict[str, Any]:
    """Return arguments by the names of parameters: robots, states, motions and what lies in the world."""
    return {
        "pepper": s.robot,
        "q": s.stand,
        "v": s.zero,
        "a": s.zero,
        "tau": s.zero,
        "frame": "LArm_effector",
        "frames": ["LArm_effector", "CameraTop_frame"],
        "forces": {"LArm_effector": np.zeros(6)},
        "scene": s.scene,
        "start": s.stand,
        "goal": s.raised,
        "tasks": [s.task],
        "trajectory": s.motion,
        "path": [s.stand, s.raised],
        "within": 0.1,
        "points": np.array([[1.0, 0.0, 1.0], [2.0, 0.0, 1.0]]),
        "name": "head",
        "hand": "left",
        "target": np.eye(4),
        "point": np.array([0.38, 0.22, 0.82]),
        "direction": np.array([0.0, 0.0, 1.0]),
        "reference": "RArm_effector",
        "joint": "HeadYaw",
        "value": 0.1,
        "yaw": 0.1,
        "function": lambda q: q[0],
        "monitor": s.monitor,
        "twist": np.array([0.1, 0.0, 0.0]),
        "force": np.array([1.0, 0.0, 0.0]),
        "geometry": s.box,
        "position": np.array([1.0, 0.0, 0.5]),
        "size": np.array([0.1, 0.1, 0.1]),
        "mass": 0.5,
        "timeline": s.timeline,
        "rotation": np.eye(3),
        "rpy": np.array([0.1, 0.2, 0.3]),
        "quaternion": np.array([0.0, 0.0, 0.0, 1.0]),
        "edge": 0,
        "names": ["HeadYaw"],
        "times": [[0.5, 1.0]],
        "keys": [[0.1, 0.2]],
        "lower": -1.0,
        "upper": 1.0,
        "n": s.n,
        "report": s.monitor.assess(s.times, s.still, 0 * s.still, 0 * s.still),
    }


def options(s: Samples) -> dict[str, Any]:
    """Return arguments by the names of parameters: options, and what the planners on vectors take."""
    return {
        "rate": 100.0,
        "dt": 0.01,
        "center": np.array([1.0, 0.0]),
        "duration": 4.0,
        "step": None,
        "count": 10,
        "samples": 1000,
        "resolution": 0.1,
        "problem": s.problem,
        "manifold": s.line,
        "cost": s.price,
        "states": np.array([[0.5, 0.5]]),
        "radius": 0.3,
        "end": np.array([1.0, 1.0, 0.5]),
        "timestep": 0.001,
        "weight": 1.0,
        "tolerance": 0.001,
        "restarts": 2,
        "starts": 8,
        "timeout": 5.0,
        "candidates": 8,
        "iterations": 20,
        "max_iterations": 50,
        "threads": 1,
        "seed": 0,
        "width": 64,
        "height": 48,
    }


class Values:
    """Arguments that work, by the name of a parameter; `Function.parameter` goes first."""

    def __init__(self) -> None:
        self.samples = Samples()
        self.named = {**robots_and_motions(self.samples), **options(self.samples)}
        self.special: dict[str, Any] = {}
        for calls in SUBJECTS:
            self.special |= calls(self.samples)

    def of(self, owner: str, parameter: inspect.Parameter) -> Any:
        """Return a valid argument, or the parameter's default, or `inspect.Parameter.empty`."""
        special = f"{owner}.{parameter.name}"
        if special in self.special:
            return self.special[special]
        if parameter.default is not parameter.empty and parameter.name not in KEEP_SHORT:
            return parameter.default
        return self.named.get(parameter.name, parameter.default)

    def others(self, valid: Any) -> list[Any]:
        """Return objects of the kind of a valid argument, but of other sizes: of another robot, say."""
        samples = self.samples
        if valid is samples.robot or valid is samples.drive:
            return [robot for robot in (samples.drive, samples.robot, samples.arm) if robot is not valid]
        return [other for kind, others in samples.others.items() if type(valid) is kind for other in others]


KEEP_SHORT = ("samples", "candidates", "restarts", "starts", "timeout", "iterations", "max_iterations")
"""Options whose defaults would take long; the short value goes in their place."""
