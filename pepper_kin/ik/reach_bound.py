"""Proof that a point is out of reach, by the lengths of the links and by the limits of the joints."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.core.inverse_kinematics.reach_hull import CELLS, add_joint, write_point, write_shortfalls
from pepper_kin.ik.nearby import resting_of
from pepper_kin.ik.problem import TaskProblem
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.task import Task, words_for_length
from pepper_kin.model import PepperModel
from pepper_kin.model.digest import kept_for_robot
from pepper_kin.model.dynamics_model import working_memory
from pepper_kin.model.moving_tree import moving_tree

ROUNDING = 1e-9
"""Tolerance for rounding [m]."""


def why_beyond_reach(problem: TaskProblem) -> str:
    """Return the position task that no posture can meet, even without limits, and its least error, in words.

    Args:
        problem: The problem; joints that may not move have the positions of its q0.

    Returns:
        One clause; empty without a proof.
    """
    worst, words = 0.0, ""
    for task in problem.tasks:
        missing = least_shortfall(problem, task) if isinstance(task, FramePosition) else 0.0
        if missing > max(worst, task.tolerance):
            worst = missing
            words = f"no posture brings {task.label} nearer than {words_for_length(missing)} to its target"
    return words


def least_shortfall(problem: TaskProblem, task: FramePosition) -> float:
    """Return a lower bound on the distance between a frame and its target, over all postures [m].

    A frame behind revolute joints stays within a sphere about the first moving one, whose radius is the sum
    of the lengths from joint to joint and to the frame (triangle inequality). If a prismatic joint may move,
    the bound is 0.
    """
    import pinocchio

    pepper = problem.pepper
    model = pepper.inner_model
    frame = model.frames[pepper.frame_id(task.frame)]
    chain = [joint for joint in model.supports[frame.parentJoint] if joint > 0]
    moving = [k for k, joint in enumerate(chain) if _may_move(problem, model.names[joint])]
    if not moving:
        return task.error(pepper, problem.q0)
    chain = chain[moving[0] :]
    if not all(model.joints[joint].shortname().startswith("JointModelR") for joint in chain):
        return 0.0
    data = working_memory(model)
    pinocchio.forwardKinematics(model, data, pepper.to_full(problem.q0))
    lengths = [float(np.linalg.norm(model.jointPlacements[joint].translation)) for joint in chain[1:]]
    radius = sum(lengths) + float(np.linalg.norm(frame.placement.translation))
    distance = float(np.linalg.norm(task.target - data.oMi[chain[0]].translation))
    return max(distance - radius, 0.0)


def _may_move(problem: TaskProblem, joint: str) -> bool:
    """Whether a joint of Pinocchio's model may move; following joints, such as fingers, count as free."""
    names = problem.pepper.joint_names
    return joint not in names or bool(problem.movable[names.index(joint)])


def shortfalls(
    pepper: PepperModel, tasks: Sequence[Task], starts: Array, movable: np.ndarray | None
) -> Array:
    """Return lower bounds of frames' distances from their targets over all postures within the limits [m].

    A bound is the target's distance beyond supporting planes of the points that the frame reaches, see
    `pepper_kin.core.inverse_kinematics.reach_hull`: the distance to their convex hull within millimeters, and
    0 inside it.

    Args:
        pepper: The robot.
        tasks: Tasks with one target or N; position tasks count.
        starts: Joint positions that joints which may not move keep [rad or m], shape (N, n).
        movable: Joints that may move, shape (n,); None for all.

    Returns:
        Bounds, shape (N, tasks), 0 without a proof.
    """
    found = np.zeros((len(starts), len(tasks)))
    if not len(starts):
        return found
    rest = resting_of(pepper, starts, movable)
    if rest is None:  # each row would need its own hull
        return found
    for k, task in enumerate(tasks):
        if isinstance(task, FramePosition) and math.isfinite(task.tolerance):
            hull = _hull(pepper, task.frame, *rest)
            points = np.ascontiguousarray(np.broadcast_to(task.target, (len(starts), 3)))
            if hull is not None:
                write_shortfalls.native(hull, points, bound := np.empty(len(starts)))
                found[:, k] = bound
    return found


@kept_for_robot(most=8)
def _hull(
    pepper: PepperModel, frame: str, moves: tuple[bool, ...], resting: tuple[float, ...]
) -> Array | None:
    """Return the support function of the points that a frame reaches; None for an unbounded set.

    Following joints count as free within the range of positions to which their leaders can move them.

    Args:
        pepper: The robot.
        frame: Name of the frame.
        moves: Whether each joint may move, n values.
        resting: Positions of the joints that may not move [rad or m], n values.
    """
    tree, free = moving_tree(pepper), np.array(moves)
    least = np.where(free, pepper.lower_limits, resting)
    most = np.where(free, pepper.upper_limits, resting)
    with np.errstate(invalid="ignore"):  # 0 times infinity, for joints that are not the leader
        ends = np.nan_to_num(pepper.full_map[:, :, None] * np.stack([least, most], axis=1), nan=0.0)
    ranges = pepper.full_offset[:, None] + np.sort(ends, axis=2).sum(axis=1)
    point = np.ascontiguousarray(tree.frame_poses[frame][:3, 3])
    heights = np.empty((6 * (CELLS + 1), CELLS + 1))
    write_point.native(point, heights)
    radius = float(np.linalg.norm(point))
    for joint in reversed(tree.path(tree.frame_joints[frame])):
        low, high = ranges[joint - 1].tolist()
        if tree.slides[joint]:
            if not math.isfinite(high - low):
                return None
            radius += max(abs(low), abs(high))
        elif not high - low < 2 * math.pi:
            low, high = -math.pi, math.pi
        place = np.column_stack([tree.rotations[joint], tree.positions[joint]])
        add_joint.native(
            place, tree.axes[joint], np.array([low, high]), radius, bool(tree.slides[joint]), heights
        )
        radius += float(np.linalg.norm(tree.positions[joint]))
    return read_only(heights + ROUNDING)
