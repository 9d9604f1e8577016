"""Proposals of base poses, from inverse kinematics with a free base."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.base_placement.moving_base import MovingBase, wrapped
from pepper_kin.base_placement.obstacles import touches_obstacles
from pepper_kin.base_placement.task_sets import TaskSet
from pepper_kin.ik.batch import solve_batch
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.kinematics import frame_pose

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

STEPS = 60
SAMPLES = 300

# Ratio of the radius of the disk around a target, in which base poses are drawn, to the reach; minimum reach
# [m].
MARGIN = 1.1
LEAST_RADIUS = 0.5

# Ratio of drawn to kept base poses among obstacles.
SPARE = 3


def propose(
    moving: MovingBase,
    sets: tuple[TaskSet, ...],
    q0: Array,
    stand: Array,
    movable: np.ndarray,
    count: int,
    seed: int,
    obstacles: Scene | None,
) -> Array:
    """Return base poses from which at least one set of tasks is reached.

    Inverse reachability: the inverse kinematics of the robot with a free base starts from postures drawn
    uniformly from the joint box and base poses drawn uniformly from a disk around the targets. From a
    resulting base pose the targets are within reach.

    Args:
        moving: The robot with a moving base.
        sets: Sets of tasks.
        q0: Joint positions at the start, shape (n,) [rad or m].
        stand: Current base pose, shape (3,) [m, m, rad].
        movable: Mask of the joints of the moving robot that may move, without the base's, shape
            (moving.robot.n,).
        count: Number of base poses.
        seed: Seed of the base poses.
        obstacles: Scene of obstacles: base poses at which q0 is free of them come first; None for none.

    Returns:
        The current base pose, then the others: x, y [m], yaw [rad], shape (count, 3).
    """
    generator = np.random.default_rng(seed)
    places = [stand[None]]
    shares = np.full(len(sets), (count - 1) // len(sets))
    shares[: (count - 1) % len(sets)] += 1
    free = movable.copy()
    free[moving.base] = True
    for tasks, share in zip(sets, shares.tolist(), strict=True):
        if share:
            drawn = share if obstacles is None else SPARE * share
            starts = _starts(moving, tasks, q0, stand, movable, drawn, generator)
            found = _stands(moving, tasks, starts, moving.names(free))
            if obstacles is not None:
                touching = touches_obstacles(moving.robot, moving.states(q0, found), obstacles)
                found = found[np.argsort(touching, kind="stable")]
            places.append(found[:share])
    return np.concatenate(places)


def _starts(
    moving: MovingBase,
    tasks: TaskSet,
    q0: Array,
    stand: Array,
    movable: np.ndarray,
    count: int,
    generator: np.random.Generator,
) -> Array:
    """Return random joint vectors with bases on a disk around the targets, shape (count, moving.robot.n)."""
    robot = moving.robot
    points = [task.target for task in tasks if isinstance(task, FramePosition)]
    center = np.mean(points, axis=0)[:2] if points else _nearest_stand(moving, tasks, q0, stand, movable)
    frames = {task.frame for task in tasks if isinstance(task, FramePosition)}
    radius = _reach(moving, frames, q0, movable) if frames else 2 * LEAST_RADIUS
    distance = MARGIN * radius * np.sqrt(generator.random(count))
    angle, yaw = generator.uniform(-np.pi, np.pi, (2, count))
    x, y = center[0] + distance * np.cos(angle), center[1] + distance * np.sin(angle)
    places = np.clip(
        np.column_stack([x, y, yaw]), robot.lower_limits[moving.base], robot.upper_limits[moving.base]
    )
    states = moving.states(q0, places)
    states[:, movable] = _postures(moving, count, movable, generator)
    return states


def _stands(moving: MovingBase, tasks: TaskSet, starts: Array, names: tuple[str, ...]) -> Array:
    """Return the base pose found from each start, shape (N, 3) [m, m, rad]; the start's if the search fails.

    `starts` are positions of all joints of the moving robot, shape (N, robot.n) [rad or m].
    """
    found = solve_batch(
        moving.robot, tasks, starts, collisions=False, joints=names, restarts=0, max_iterations=STEPS
    )
    places = np.where(found.success[:, None], found.q[:, moving.base], starts[:, moving.base])
    places[:, 2] = wrapped(places[:, 2])
    return np.asarray(places)


def _nearest_stand(moving: MovingBase, tasks: TaskSet, q0: Array, stand: Array, movable: np.ndarray) -> Array:
    """Return the position to which tasks without a point move the base, shape (2,) [m]."""
    free = movable.copy()
    free[moving.base] = True
    start = moving.states(q0, stand[None])
    return _stands(moving, tasks, start, moving.names(free))[0, :2]


def _postures(moving: MovingBase, count: int, movable: np.ndarray, generator: np.random.Generator) -> Array:
    """Draw positions of the k movable joints evenly, shape (count, k) [rad or m].

    Joints without limits are within pi of zero; `movable` is a mask over the moving robot, shape (robot.n,).
    """
    robot = moving.robot
    low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -math.pi)[movable]
    high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, math.pi)[movable]
    return np.asarray(generator.uniform(low, high, (count, low.size)))


def _reach(moving: MovingBase, frames: Iterable[str], q0: Array, movable: np.ndarray) -> float:
    """Return the maximum distance of frames from the base's axis in random postures [m].

    `q0` has shape (n,) [rad or m]; `movable` is a mask over the moving robot, shape (robot.n,).
    """
    generator = np.random.default_rng(0)
    states = moving.states(q0, np.zeros((SAMPLES, 3)))
    states[:, movable] = _postures(moving, SAMPLES, movable, generator)
    distances = [
        np.linalg.norm(frame_pose(moving.robot, states, frame)[:, :2, 3], axis=1).max()
        for frame in sorted(frames)
    ]
    return max(LEAST_RADIUS, float(max(distances)))
