"""Soft costs along a path: what plans state is recomputed by NumPy and Pinocchio."""

import pickle

import casadi
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.motion import PathCost, PlanStatus

EFFECTOR = "LArm_effector"
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
GOAL = [pk.ik.HandPosition("left", (0.28, 0.12, 0.8))]
UP = np.array([0.0, 0.0, 1.0])


def poses(pepper, q, frame=EFFECTOR):
    return pk.kinematics.frame_pose(pepper, q, frame)


def dense(curve, count=200):
    """Return states in the middle of short pieces of a curve, their derivatives and the pieces' spans."""
    segments = np.repeat(np.arange(len(curve.breaks) - 1), count)
    spans = np.diff(curve.breaks)[segments]
    local = np.tile((np.arange(count) + 0.5) / count, len(curve.breaks) - 1) * spans
    return curve.at(segments, local), curve.at(segments, local, 1), spans / count


def mean_height(pepper, plan):
    q, slopes, spans = dense(plan.curve)
    lengths = np.linalg.norm(slopes * motion_bounds(pepper), axis=1) * spans
    return lengths @ poses(pepper, q)[:, 2, 3] / lengths.sum()


def low_hand(pepper, **options):
    pose = pk.symbolic.frame_pose(pepper, EFFECTOR)
    return PathCost(pepper, lambda q: 50 * casadi.fmax(1.0 - pose(q)[2, 3], 0) ** 2, **options)


@pytest.fixture(scope="module")
def over_the_table(pepper):
    tasks = [pk.ik.HandPosition("left", (0.25, 0.35, 0.8))]
    found = pk.ik.solve(pepper, tasks, start=pepper.posture("Stand"), scene=TABLE, joints="left_arm")
    assert found.success
    return found.q


@pytest.mark.parametrize("joints", ["left_arm", "whole_body"])
def test_a_hand_is_led_higher(pepper, over_the_table, joints):
    free = pk.plan(pepper, over_the_table, GOAL, TABLE, joints=joints)
    plan = pk.plan(pepper, over_the_table, GOAL, TABLE, joints=joints, costs=[low_hand(pepper)])
    assert free.success
    assert plan.success
    assert mean_height(pepper, plan) > mean_height(pepper, free) + 0.02
    q, slopes, spans = dense(plan.curve)
    assert not pk.collision.in_collision(pepper, q, TABLE).any()
    assert (q >= pepper.lower_limits - 1e-9).all()
    assert (q <= pepper.upper_limits + 1e-9).all()
    lengths = np.linalg.norm(slopes * motion_bounds(pepper), axis=1) * spans
    price = 50 * np.maximum(1.0 - poses(pepper, q)[:, 2, 3], 0) ** 2
    (cost,) = plan.costs
    assert cost.integral == pytest.approx(lengths @ price, rel=1e-3)
    assert cost.mean == pytest.approx(lengths @ price / lengths.sum(), rel=1e-3)
    assert cost.highest == pytest.approx(price.max(), rel=0.01)
    assert lengths.sum() + cost.integral < 0.97 * (cost.before + lengths.sum())
    assert cost.integral < 0.9 * cost.before
    assert "without regard to them" in plan.message
    np.testing.assert_allclose(poses(pepper, plan.goal)[:3, 3], (0.28, 0.12, 0.8), atol=1e-3)
    assert pk.retime(pepper, plan).duration > 0
    assert pickle.loads(pickle.dumps(plan)).costs == plan.costs


def test_a_larger_weight_leads_higher(pepper, over_the_table):
    heights, before = [], []
    for weight in (0.2, 1.0, 5.0):
        plan = pk.plan(
            pepper, over_the_table, GOAL, TABLE, joints="left_arm", costs=[low_hand(pepper, weight=weight)]
        )
        heights.append(mean_height(pepper, plan))
        before.append(plan.costs[0].before / weight)
    assert heights[0] < heights[1] < heights[2]
    np.testing.assert_allclose(before, before[0], rtol=1e-9)


def test_tasks_are_costs_too(pepper, over_the_table):
    """The price of a task is the square of its error in tolerances."""
    point = np.array([0.8, 0.4, 0.6])
    gaze = pk.ik.LookAt(point, tolerance=0.3, weight=2.0)
    costs = [gaze, low_hand(pepper, label="low hand")]
    plan = pk.plan(pepper, over_the_table, GOAL, TABLE, joints="whole_body", costs=costs)
    assert [cost.label for cost in plan.costs] == ["low hand", "gaze of CameraTop_frame"]
    q, slopes, spans = dense(plan.curve)
    lengths = np.linalg.norm(slopes * motion_bounds(pepper), axis=1) * spans
    camera = poses(pepper, q, "CameraTop_frame")
    sight = point - camera[:, :3, 3]
    angle = np.arccos(np.einsum("ki,ki->k", sight, camera[:, :3, 0]) / np.linalg.norm(sight, axis=1))
    assert plan.costs[1].integral == pytest.approx(lengths @ (2 * angle / 0.3) ** 2, rel=1e-3)
    assert sum(cost.integral for cost in plan.costs) < 0.9 * sum(cost.before for cost in plan.costs)


class Lowered(pk.ik.FrameInPlane):
    """A class of a user's own, which is asked in Python."""

    def residual(self, pepper, q):
        return super().residual(pepper, q)


def test_classes_of_users_are_costs(pepper, over_the_table):
    found = []
    for kind in (pk.ik.FrameInPlane, Lowered):
        task = kind(EFFECTOR, (0, 0, 1.0), tolerance=0.1)
        plan = pk.plan(
            pepper, over_the_table, GOAL, TABLE, joints="left_arm",
            costs=[task, low_hand(pepper)], timeout=60,
        )  # fmt: skip
        found.append([cost.integral for cost in plan.costs])
    np.testing.assert_allclose(*found, rtol=1e-3)


def test_costs_beside_constraints(pepper, over_the_table):
    """A tray that stays level is led higher."""
    tilt = np.radians(10)
    level = pk.ik.AxisAlignment(EFFECTOR, UP, axis=UP, tolerance=tilt)
    tasks = [pk.ik.HandPosition("left", (0.28, 0.32, 0.85)), level]
    start = pk.ik.solve(pepper, tasks, start=pepper.posture("Stand"), scene=TABLE, joints="left_arm").q
    goal = [pk.ik.HandPosition("left", (0.30, 0.05, 0.85))]
    options = {"joints": "whole_body", "constraints": [level], "timeout": 20}
    free = pk.plan(pepper, start, goal, TABLE, **options)
    plan = pk.plan(pepper, start, goal, TABLE, costs=[low_hand(pepper, weight=4.0)], **options)
    assert free.success
    assert plan.success
    q = dense(plan.curve, 40)[0]
    tilts = np.arccos(np.clip(poses(pepper, q)[:, :3, 2] @ UP, -1, 1))
    assert tilts.max() <= tilt
    assert plan.constraint_errors[0] == pytest.approx(tilts.max(), rel=0.02)
    assert not pk.collision.in_collision(pepper, q, TABLE).any()
    assert mean_height(pepper, plan) > mean_height(pepper, free) + 0.01
    assert plan.costs[0].integral < 0.9 * plan.costs[0].before


def test_a_seed_gives_the_same_plan(pepper, over_the_table):
    plans = [
        pk.plan(pepper, over_the_table, GOAL, TABLE, joints="left_arm", costs=[low_hand(pepper)], timeout=60)
        for _ in range(2)
    ]
    np.testing.assert_array_equal(plans[0].path, plans[1].path)


def test_ends_without_a_path_say_why(pepper, over_the_table):
    costs = [low_hand(pepper)]
    stays = pk.plan(pepper, over_the_table, over_the_table, TABLE, costs=costs)
    assert stays.success
    assert stays.costs == ()
    inside = pk.Scene().add_box(
        "box", size=(0.2, 0.2, 0.2), position=tuple(poses(pepper, over_the_table)[:3, 3])
    )
    assert pk.plan(pepper, over_the_table, GOAL, inside, costs=costs).status is PlanStatus.START_IN_COLLISION


def test_what_is_no_cost_is_refused(pepper, over_the_table):
    def planned(*costs, **options):
        return pk.plan(pepper, over_the_table, GOAL, costs=list(costs), **options)

    with pytest.raises(InvalidValueError, match="at least one PathCost"):
        planned()
    with pytest.raises(InvalidValueError, match="tasks such as"):
        planned(3.0)
    with pytest.raises(InvalidValueError, match="tolerance"):
        planned(pk.ik.LookAt((1, 0, 1), tolerance=np.inf))
    with pytest.raises(UnknownNameError):
        planned(pk.ik.FramePosition("LPaw", (0, 0, 1)))
    with pytest.raises(InvalidValueError, match="with constraints or costs"):
        planned(low_hand(pepper), planner="aorrtc")
    with pytest.raises(InvalidValueError, match="2 values"):
        PathCost(pepper, lambda q: q[:2])
    with pytest.raises(InvalidValueError, match="weight of cost"):
        PathCost(pepper, lambda q: q[0] ** 2, weight=0.0)
    with pytest.raises(InvalidValueError, match="another robot"):
        planned(low_hand(pk.load_pepper(base="planar")))
