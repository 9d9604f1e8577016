"""Targets of the comparison of inverse kinematics, and the verdict on answers."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

import pepper_kin as pk

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
