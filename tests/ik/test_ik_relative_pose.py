"""One frame as seen from another, recomputed by Pinocchio alone."""

import math

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ik.solvers import ALL_SOLVERS
from pepper_kin.model.shapes import rotation_rpy, transform

PEPPER = pk.load_pepper()
LEFT, RIGHT = "LArm_effector", "RArm_effector"
APART = transform((0.0, 0.25, 0.0), (0.1, -0.2, 0.3))


def relative_pose(pepper, q, frame, reference):
    """Pose of one frame in another, as Pinocchio's own algebra of placements has it."""
    model = pepper.pinocchio_model
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, pepper.to_full(q))
    placements = [data.oMf[pepper.frame_id(name)] for name in (reference, frame)]
    return placements[0].actInv(placements[1])


def states(pepper, count, seed):
    low, high = np.maximum(pepper.lower_limits, -3), np.minimum(pepper.upper_limits, 3)
    return np.random.default_rng(seed).uniform(low, high, (count, pepper.n))


def feasible(count, seed, frame=LEFT, reference=RIGHT):
    return np.array(
        [relative_pose(PEPPER, q, frame, reference).homogeneous for q in states(PEPPER, count, seed)]
    )


def test_errors_are_those_of_pinocchio():
    task = pk.ik.RelativePose(LEFT, RIGHT, APART)
    for q in states(PEPPER, 10, 3):
        pose = relative_pose(PEPPER, q, LEFT, RIGHT)
        position, orientation = (part.error(PEPPER, q) for part in task.parts)
        assert position == pytest.approx(np.linalg.norm(pose.translation - APART[:3, 3]))
        cosine = (np.trace(APART[:3, :3].T @ pose.rotation) - 1) / 2
        assert orientation == pytest.approx(math.acos(cosine), abs=1e-7)


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_both_hands_on_one_box(solver):
    """The right hand goes somewhere, the left one keeps its place relative to it: both are met."""
    names = ("ShoulderPitch", "ShoulderRoll", "ElbowRoll")
    values = {"L": (0.6, 0.1, -1.0), "R": (0.6, -0.1, 1.0)}
    q0 = PEPPER.joint_vector({s + n: x for s, row in values.items() for n, x in zip(names, row, strict=True)})
    hold = pk.ik.RelativePose.as_at(PEPPER, q0, LEFT, RIGHT)
    wanted = relative_pose(PEPPER, q0, LEFT, RIGHT).homogeneous
    np.testing.assert_allclose(hold.target, wanted, atol=1e-12)
    lifted = pk.kinematics.frame_pose(PEPPER, q0, RIGHT)[:3, 3] + (0.02, 0.0, 0.08)
    result = pk.ik.solve(
        PEPPER, [hold, pk.ik.HandPosition("right", lifted)], q0, solver=solver, collisions=False
    )
    assert result.success, result.report()
    found = relative_pose(PEPPER, result.q, LEFT, RIGHT).homogeneous
    assert np.linalg.norm(found[:3, 3] - wanted[:3, 3]) < 1e-3
    cosine = (np.trace(found[:3, :3].T @ wanted[:3, :3]) - 1) / 2
    assert math.acos(min(cosine, 1.0)) < math.radians(0.5)
    right = pk.kinematics.frame_pose(PEPPER, result.q, RIGHT)[:3, 3]
    assert np.linalg.norm(right - lifted) < 1e-3
    assert result.met[:2] == tuple(
        f"{what} of {LEFT} seen from {RIGHT}" for what in ("position", "orientation")
    )
    assert f"{LEFT} seen from {RIGHT}: error" in result.report()


def test_a_batch_of_relative_poses_is_met():
    poses = feasible(60, 5)
    found = pk.ik.solve_batch(PEPPER, pk.ik.RelativePose(LEFT, RIGHT, poses), collisions=False)
    assert found.success.all()
    for q, pose, errors in zip(found.q, poses, found.errors, strict=True):
        placement = relative_pose(PEPPER, q, LEFT, RIGHT)
        assert np.linalg.norm(placement.translation - pose[:3, 3]) == pytest.approx(errors[0], abs=1e-9)
        assert errors[0] <= 1e-3
        cosine = (np.trace(pose[:3, :3].T @ placement.rotation) - 1) / 2
        assert math.cos(errors[1]) == pytest.approx(cosine, abs=1e-9)
    row = pk.ik.solve(PEPPER, pk.ik.RelativePose(LEFT, RIGHT, poses[7]), collisions=False)
    np.testing.assert_array_equal(row.q, found.q[7])


def test_either_part_may_be_left_out():
    for without, kind in (("orientation", "RelativePosition"), ("position", "RelativeOrientation")):
        task = pk.ik.RelativePose(LEFT, RIGHT, APART, without=without)
        assert [type(part).__name__ for part in task.parts] == [kind]
        assert getattr(task, without) is None
        result = pk.ik.solve(PEPPER, task, collisions=False)
        assert result.success, result.report()
        assert len(result.errors) == 1
        pose = relative_pose(PEPPER, result.q, LEFT, RIGHT)
        if without == "orientation":
            assert np.linalg.norm(pose.translation - APART[:3, 3]) < 1e-3
        else:
            assert np.trace(APART[:3, :3].T @ pose.rotation) > 1 + 2 * math.cos(math.radians(0.5))


def test_joints_that_carry_both_frames_keep_still():
    result = pk.ik.solve(PEPPER, pk.ik.RelativePose(LEFT, RIGHT, APART), collisions=False)
    carry = [PEPPER.joint_index(name) for name in ("KneePitch", "HipPitch", "HipRoll")]
    np.testing.assert_array_equal(result.q[carry], PEPPER.neutral()[carry])


def test_out_of_reach_says_how_far():
    task = pk.ik.RelativePosition(LEFT, RIGHT, (0.0, 3.0, 0.0))
    result = pk.ik.solve(PEPPER, task, collisions=False)
    assert not result.success
    gap = np.linalg.norm(relative_pose(PEPPER, result.q, LEFT, RIGHT).translation - (0.0, 3.0, 0.0))
    assert result.errors[0].value == pytest.approx(gap)
    assert f"{LEFT} seen from {RIGHT} stops {gap:.2f} m short of (0.000, 3.000, 0.000)" in result.report()
    turned = pk.ik.RelativeOrientation("Head", "torso", rotation_rpy(0, math.pi, 0))
    report = pk.ik.solve(PEPPER, turned, collisions=False).report()
    assert "Head seen from torso is turned" in report
    assert "deg about the axes of torso" in report


def test_unknown_frames_are_refused():
    for frames in [("nose", RIGHT), (LEFT, "nose")]:
        with pytest.raises(UnknownNameError, match="unknown frame 'nose'; available: "):
            pk.ik.solve(PEPPER, pk.ik.RelativePose(*frames, APART), collisions=False)
        with pytest.raises(UnknownNameError, match="unknown frame 'nose'"):
            pk.ik.RelativePose.as_at(PEPPER, PEPPER.neutral(), *frames)
