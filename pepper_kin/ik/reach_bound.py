"""Proof that a point is beyond reach, by the lengths of the links."""

from __future__ import annotations

import numpy as np

from pepper_kin.ik.problem import Problem
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.task import words_for_length
from pepper_kin.model.dynamics_model import working_memory


def why_beyond_reach(problem: Problem) -> str:
    """Say which position task no posture can meet, limits or not, and how much is missing at least.

    Args:
        problem: The problem; joints that may not move stand as in its q0.

    Returns:
        One clause; empty where nothing is proven.
    """
    worst, words = 0.0, ""
    for task in problem.tasks:
        missing = least_shortfall(problem, task) if isinstance(task, FramePosition) else 0.0
        if missing > max(worst, task.tolerance):
            worst = missing
            words = f"no posture brings {task.label} nearer than {words_for_length(missing)} to its target"
    return words


def least_shortfall(problem: Problem, task: FramePosition) -> float:
    """Return a lower bound on the distance between a frame and its target, over all postures [m].

    A frame behind revolute joints stays within a ball: about the first of them that moves, with the sum of
    the lengths from joint to joint and on to the frame as radius (the triangle inequality).  Where a joint
    that slides may move the bound is 0.
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


def _may_move(problem: Problem, joint: str) -> bool:
    """Whether a joint of Pinocchio's may move; those that follow others, as fingers do, count as free."""
    names = problem.pepper.joint_names
    return joint not in names or bool(problem.movable[names.index(joint)])
