"""Calls that most programs make: a wheel has their kernels, and `warm_up` compiles them."""

from __future__ import annotations

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.batch import kernel
from pepper_kin.collision import Scene
from pepper_kin.jobs.demo import run_demo
from pepper_kin.model import load_pepper
from pepper_kin.motion import plan
from pepper_kin.plugins import plugins
from pepper_kin.trajectory import retime
from pepper_kin.twin import Twin

PATIENCE = 900.0
"""Time budget of a plan whose code is compiled meanwhile [s]."""

BATCHES = (
    "center_of_mass",
    "forward_dynamics",
    "gravity_torque",
    "inverse_dynamics",
    "mass_matrix",
    "zero_moment_point",
)
"""Quantities whose kernels a wheel has."""


def everyday_calls() -> None:
    """Make the calls whose kernels a wheel has, in the order of a first session."""
    own = (_motion_calls, _ik_calls, _payload_calls, _batch_calls, _calls_of_other_robots)
    for calls in (*own, *(entry.load() for entry in plugins("everyday_calls").values())):
        calls()


def _ik_calls() -> None:
    """Solve the usual combinations of hand and gaze tasks."""
    pepper = load_pepper()
    left, right, pose = (0.35, 0.2, 0.85), (0.35, -0.2, 0.85), np.eye(4)
    pose[:3, 3] = left
    for tasks in (
        [ik.HandPosition("left", left), ik.LookAt(left)],
        [ik.HandPosition("left", left)],
        [ik.HandPosition("right", right)],
        [ik.HandPosition("right", right), ik.LookAt(right)],
        [ik.HandPosition("left", left), ik.HandPosition("right", right)],
        [ik.HandPosition("left", left), ik.HandPosition("right", right), ik.LookAt(left)],
        [ik.HandPose("left", pose)],
        [ik.HandPose("right", pose)],
        [ik.LookAt(left)],
    ):
        ik.solve(pepper, tasks)


def _motion_calls() -> None:
    """Plan, time, check, replan and execute a motion, and run the demonstration."""
    pepper = load_pepper()
    tasks = [ik.HandPosition("left", _POINT), ik.LookAt(_POINT)]
    found = plan(pepper, pepper.posture("Stand"), tasks, _scene(), seed=0, timeout=PATIENCE)
    trajectory = retime(pepper, found, balance=0.01)
    trajectory.check(pepper, scene=_scene())
    trajectory.replaced(pepper, 0.5 * trajectory.duration, trajectory.start, balance=0.01)
    Twin(pepper, scene=_scene()).execute(trajectory)
    run_demo(pepper)


def _payload_calls() -> None:
    """Plan and time motions with payloads, with and without balance."""
    pepper = load_pepper()
    for payload in (None, {"left": 0.3}, {"right": 0.3}, {"left": 0.3, "right": 0.3}):
        for balance in (None, 0.005):
            held = plan(
                pepper, pepper.posture("Stand"), [ik.HandPosition("left", _POINT)], _scene(),
                balance=balance, payload=payload, timeout=PATIENCE,
            )  # fmt: skip
            retime(pepper, held, balance=balance, payload=payload)


def _batch_calls() -> None:
    """Evaluate kinematics and collisions of batches, and load the kernels of `BATCHES`."""
    pepper = load_pepper()
    q = np.tile(pepper.neutral(), (64, 1))
    for frame in ("LArm_effector", "RArm_effector"):
        kinematics.frame_pose(pepper, q, frame)
        kinematics.frame_jacobian(pepper, q, frame)
    kinematics.frame_poses(pepper, q, tuple(dict.fromkeys(shape.link for shape in pepper.visual_shapes)))
    for quantity in BATCHES:
        kernel(pepper, quantity)
    collision.in_collision(pepper, q, _scene())


def _calls_of_other_robots() -> None:
    """Make typical calls for Pepper with a planar base and with moving hands."""
    planar = load_pepper(base="planar")
    collision.in_collision(planar, np.tile(planar.neutral(), (64, 1)), _scene())
    for other in (planar, load_pepper(hands="mimic")):
        state = np.tile(other.neutral(), (64, 1))
        dynamics.inverse_dynamics(other, state, state, state)
        ik.solve(other, [ik.HandPosition("left", _POINT), ik.LookAt(_POINT)])


_POINT = (0.38, 0.22, 0.82)


def _scene() -> Scene:
    return Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
