"""Targets out of reach: the closest point, the status, and numbers in the report that hold."""

import math
import re

import numpy as np
import pytest
from scipy.optimize import least_squares

import pepper_kin as pk
from pepper_kin.ik import IKStatus
from pepper_kin.ik.solvers import SOLVERS

PEPPER = pk.load_pepper()
LEFT = [i for i, n in enumerate(PEPPER.joint_names) if n.startswith(("L", "Knee", "Hip"))]


def hand_at(q):
    return pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3]


def closest_distance(target, generator, starts=8):
    """Least distance by a multi-start search of its own: SciPy's dogbox from the best of 2000 points."""

    def configuration(x):
        q = PEPPER.neutral()
        q[LEFT] = x
        return q

    def slope(x):
        return pk.kinematics.frame_jacobian(PEPPER, configuration(x), "LArm_effector")[:3, LEFT]

    low, high = PEPPER.lower_limits[LEFT], PEPPER.upper_limits[LEFT]
    points = generator.uniform(low, high, (250 * starts, len(LEFT)))
    q = np.tile(PEPPER.neutral(), (len(points), 1))
    q[:, LEFT] = points
    hands = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:, :3, 3]
    distances = np.linalg.norm(hands - target, axis=1)
    chosen = [
        group[np.argmin(np.take(distances, group))] for group in np.split(np.arange(len(points)), starts)
    ]
    return min(
        np.sqrt(
            2 * least_squares(
                lambda x: hand_at(configuration(x)) - target, points[k], slope, (low, high),
                method="dogbox", max_nfev=80,
            ).cost
        )
        for k in chosen
    )  # fmt: skip


def unreachable_targets(count, generator):
    """Points up to 3 m away, most of them beyond reach and some behind the robot or inside it."""
    for _ in range(count):
        direction = generator.normal(size=3)
        yield [0, 0, 0.8] + direction / np.linalg.norm(direction) * generator.uniform(0.9, 3.0)


@pytest.mark.parametrize("count", [8, pytest.param(20, marks=pytest.mark.thousand)])
def test_closest_point_is_the_closest(count):
    generator = np.random.default_rng(21)
    difference = []
    for k, target in enumerate(unreachable_targets(count, generator)):
        result = pk.ik.solve(
            PEPPER, pk.ik.HandPosition("left", target), solver=SOLVERS[k % 2], collisions=False
        )
        assert result.status in (IKStatus.CLOSEST_UNREACHABLE, IKStatus.CLOSEST_LIMITS)
        difference.append(math.dist(hand_at(result.q), target) - closest_distance(target, generator))
    assert np.mean(np.array(difference) < 5e-3) >= 0.95, difference


def test_status_solved():
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (0.4, 0.25, 0.9)), collisions=False)
    assert result.status is IKStatus.SOLVED
    assert result.success
    assert result.report().startswith("solved: every task is met\nleft hand: error ")
    assert result.blocking_limits == ()
    assert result.clearance is None
    assert result.in_collision is None


@pytest.mark.parametrize("solver", SOLVERS)
def test_status_unreachable_and_its_report(solver):
    target = np.array([0.9, 0.6, 1.2])
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), solver=solver, collisions=False)
    assert result.status is IKStatus.CLOSEST_UNREACHABLE
    assert not result.success
    assert "even without joint limits" in result.advice
    hand = hand_at(result.q)
    distance = math.dist(hand, target)
    assert result.errors[0].value == pytest.approx(distance)
    report = result.report()
    stated = re.search(r"left hand stops ([\d.]+) cm short of \(0.900, 0.600, 1.200\)", report)
    assert stated is not None, report
    assert float(stated[1]) == pytest.approx(100 * distance, abs=0.051)
    point = re.search(r"comes to point \((.*?), (.*?), (.*?)\)", report)
    assert point is not None, report
    np.testing.assert_allclose([float(x) for x in point.groups()], hand, atol=5.1e-4)
    assert result.advice in report


@pytest.mark.parametrize("solver", SOLVERS)
def test_status_limits_and_their_names(solver):
    """The hand behind the back: the arm is long enough, the elbow and shoulder do not turn so far."""
    result = pk.ik.solve(
        PEPPER,
        pk.ik.HandPosition("left", (-0.15, 0.05, 0.9)),
        joints="left_arm",
        solver=solver,
        collisions=False,
    )
    assert result.status is IKStatus.CLOSEST_LIMITS
    assert result.blocking_limits
    assert set(result.blocking_limits) <= set(result.active_limits)
    for name in result.active_limits:
        i = PEPPER.joint_index(name)
        at = min(result.q[i] - PEPPER.lower_limits[i], PEPPER.upper_limits[i] - result.q[i])
        assert at < 1e-4
    gradient = pk.kinematics.frame_jacobian(PEPPER, result.q, "LArm_effector")[:3].T @ (
        hand_at(result.q) - (-0.15, 0.05, 0.9)
    )
    for name in result.blocking_limits:
        i = PEPPER.joint_index(name)
        at_upper = PEPPER.upper_limits[i] - result.q[i] < 1e-4
        assert (gradient[i] < 0) == at_upper
        assert name in result.report()
    assert re.search(r"short of .*: .* at (its|their) limits?; comes to point", result.report())


def test_hint_that_more_joints_would_help():
    q = PEPPER.joint_vector({"HipPitch": -0.9, "LShoulderPitch": -0.2, "LElbowRoll": -0.1})
    target = hand_at(q)
    assert pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), collisions=False).success
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), joints="left_arm", collisions=False)
    assert not result.success
    assert result.hint == "with the torso free it would be reached"
    assert result.hint in result.report()


def test_posture_beyond_the_limits_is_blocked_by_limits():
    result = pk.ik.solve(PEPPER, pk.ik.JointPosture((1.0,), joints=("KneePitch",)), collisions=False)
    assert result.status is IKStatus.CLOSEST_LIMITS
    assert result.blocking_limits == ("KneePitch",)
    assert result.q[PEPPER.joint_index("KneePitch")] == PEPPER.upper_limits[0]
    assert "KneePitch stops at 0.5149 rad, short of 1.0000 rad" in result.report()


def test_pose_reports_its_parts_apart():
    """A turned hand at a far point: the result says which part was met."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.diag([-1.0, -1.0, 1.0]), (0.35, 0.2, 0.9)
    result = pk.ik.solve(
        PEPPER, pk.ik.HandPose("left", pose, weight=10.0, orientation_weight=0.05), collisions=False
    )
    assert [error.unit for error in result.errors] == ["m", "rad"]
    assert not result.errors[1].met
    assert "left hand is turned" in result.report()


def test_status_timed_out_still_answers():
    target = (1.5, 0.5, 1.2)
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), timeout=1e-9, collisions=False)
    assert result.status is IKStatus.TIMED_OUT
    assert "Time ran out" in result.report()
    np.testing.assert_array_equal(result.q, PEPPER.neutral())
    longer = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), timeout=60.0, collisions=False)
    assert longer.status is IKStatus.CLOSEST_UNREACHABLE
    assert longer.errors[0].value < result.errors[0].value


def test_torque_use_is_that_of_gravity():
    for target in ((0.4, 0.25, 0.9), (1.2, 0.3, 0.2)):
        result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), collisions=False)
        torque = pk.dynamics.newton_euler(PEPPER, result.q, np.zeros(15), np.zeros(15))
        ratios = np.abs(torque) / PEPPER.effort_limits
        assert result.torque_use.ratio == pytest.approx(ratios.max(), abs=1e-6)
        assert result.torque_use.joint == PEPPER.joint_names[int(ratios.argmax())]
        assert f"{100 * ratios.max():.0f} %" in result.report()
        assert ("cannot hold" in result.report()) == (ratios.max() > 1)


def test_holdable_postures_are_preferred():
    """Of random reachable targets, nearly all that some restart can hold are held."""
    generator = np.random.default_rng(5)
    overloaded = 0
    for _ in range(40):
        q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", hand_at(q)), collisions=False)
        overloaded += result.torque_use.ratio > 1
    assert overloaded <= 8


def test_every_status_has_advice_of_its_own():
    assert len({status.advice for status in IKStatus}) == len(IKStatus) == 5


def test_closest_points_beside_a_search_of_another_kind():
    """Of 100 targets up to 3 m away, 99 end within 5 mm of what 60 projected descents find."""
    generator = np.random.default_rng(77)
    low, high = PEPPER.lower_limits, PEPPER.upper_limits
    behind = []
    for _ in range(100):
        direction = generator.normal(size=3)
        target = [0, 0, 0.9] + direction / np.linalg.norm(direction) * generator.uniform(0.2, 3.0)
        result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), collisions=False)
        assert np.all((low <= result.q) & (result.q <= high))
        ends = projected_descents(target, generator.uniform(low, high, (60, PEPPER.n)))
        behind.append(math.dist(hand_at(result.q), target) - ends.min())
    assert np.mean(np.array(behind) < 5e-3) >= 0.99, np.sort(behind)[-5:]


def projected_descents(target, q, steps=40):
    """Distances that damped Gauss-Newton steps cut off at the limits end at, from many starts at once."""
    low, high = PEPPER.lower_limits, PEPPER.upper_limits
    damping = np.full(len(q), 1e-2)
    residual = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:, :3, 3] - target
    for _ in range(steps):
        jacobian = pk.kinematics.frame_jacobian(PEPPER, q, "LArm_effector")[:, :3]
        gradient = np.einsum("sik,si->sk", jacobian, residual)
        rests = ((q <= low + 1e-9) & (gradient > 0)) | ((q >= high - 1e-9) & (gradient < 0))
        jacobian = np.where(rests[:, None], 0.0, jacobian)
        # Within the span of the three rows: dq = -J^T (J J^T + lambda I)^-1 r.
        matrix = jacobian @ jacobian.transpose(0, 2, 1) + damping[:, None, None] * np.eye(3)
        step = -np.einsum("sik,si->sk", jacobian, np.linalg.solve(matrix, residual[..., None])[..., 0])
        trial = np.clip(q + step, low, high)
        trial_residual = pk.kinematics.frame_pose(PEPPER, trial, "LArm_effector")[:, :3, 3] - target
        better = np.sum(trial_residual**2, axis=1) < np.sum(residual**2, axis=1)
        q = np.where(better[:, None], trial, q)
        residual = np.where(better[:, None], trial_residual, residual)
        damping = np.clip(np.where(better, damping / 3, damping * 4), 1e-7, 1e4)
    return np.linalg.norm(residual, axis=1)
