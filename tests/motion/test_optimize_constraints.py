"""Motions that are optimized while IK tasks stay met."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import OptimizedStatus, optimize

POST = pk.Scene().add_box("post", size=(0.05, 0.05, 1.0), position=(0.33, 0.17, 0.85))
UP = np.array([0.0, 0.0, 1.0])
PEPPER = pk.load_pepper()


def level(degrees):
    return pk.ik.AxisAlignment("LArm_effector", UP, axis=UP, tolerance=np.radians(degrees))


@pytest.fixture(scope="module")
def tray():
    """A plan that carries a tray round a post, level to five degrees."""
    tasks = [pk.ik.HandPosition("left", (0.28, 0.32, 0.85)), level(1)]
    start = pk.ik.solve(PEPPER, tasks, start=PEPPER.posture("Stand"), scene=POST, joints="left_arm").q
    goal = [pk.ik.HandPosition("left", (0.30, 0.05, 0.85))]
    plan = pk.plan(PEPPER, start, goal, POST, joints="left_arm", constraints=[level(5)], timeout=30.0)
    assert plan.success, plan.message
    return plan


def worst_tilt(motion):
    """In degrees, by the hand's own pose every millisecond."""
    q = motion(np.linspace(0.0, motion.duration, int(1000 * motion.duration) + 1)).position
    pose = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")
    return np.degrees(np.arccos(np.clip(pose[:, :3, 2] @ UP, -1, 1))).max()


def test_a_tray_stays_level_in_a_motion_that_is_cheaper(tray):
    found = optimize(PEPPER, tray, POST, constraints=[level(5)])
    assert found.status is OptimizedStatus.IMPROVED, found.message
    assert worst_tilt(found.trajectory) <= 5.0
    assert np.degrees(found.constraint_errors[0]) == pytest.approx(worst_tilt(found.trajectory), abs=0.02)
    assert found.figures.cost(found.cost) < found.figures_before.cost(found.cost)
    assert found.trajectory.check(PEPPER, POST).obstacle_clearance.success
    free = optimize(PEPPER, tray, POST)
    assert free.constraint_errors == ()
    assert worst_tilt(free.trajectory) > 5.0  # without the constraint the tray tips


def test_a_hand_stays_at_a_height_and_the_gaze_on_a_point():
    point = np.array([0.6, 0.1, 0.8])
    gaze = pk.ik.LookAt(point, tolerance=np.radians(4))
    height = pk.ik.FrameInPlane("LArm_effector", (0, 0, 0.85), tolerance=0.004)
    start, goal = (
        pk.ik.solve(
            PEPPER,
            [pk.ik.HandPosition("left", hand), pk.ik.LookAt(point)],
            start=PEPPER.posture("Stand"),
            scene=POST,
        ).q
        for hand in ((0.28, 0.30, 0.85), (0.30, 0.05, 0.85))
    )
    plan = pk.plan(PEPPER, start, goal, constraints=[gaze, height], timeout=30.0)
    assert plan.success, plan.message
    found = optimize(PEPPER, plan, constraints=[gaze, height])
    assert found.success, found.message
    q = found.trajectory(np.linspace(0, found.trajectory.duration, 500)).position
    assert np.abs(pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:, 2, 3] - 0.85).max() <= 0.004
    camera = pk.kinematics.frame_pose(PEPPER, q, gaze.frame)
    line = point - camera[:, :3, 3]
    cosine = np.einsum("kij,j,ki->k", camera[:, :3, :3], gaze.axis, line) / np.linalg.norm(line, axis=1)
    assert np.arccos(cosine.min()) <= np.radians(4)


def test_a_start_that_cannot_keep_the_constraint_is_reported(tray):
    tight = pk.ik.FrameInPlane("LArm_effector", (0, 0, 0.5), tolerance=0.001)
    found = optimize(PEPPER, tray, POST, constraints=[tight])
    assert found.status is OptimizedStatus.OFF_CONSTRAINT
    assert found.trajectory is found.before
    assert "plane of LArm_effector is not kept" in found.message
    assert found.constraint_errors[0] == pytest.approx(0.35, abs=0.02)


def test_constraints_that_are_none_are_refused(tray):
    with pytest.raises(InvalidValueError, match="tolerance"):
        optimize(PEPPER, tray, POST, constraints=[pk.ik.JointPosture(tray.goal, tolerance=np.inf)])
