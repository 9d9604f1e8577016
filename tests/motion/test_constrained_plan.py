import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.ik import FrameInPlane
from pepper_kin.motion import PlanStatus, manifold_of, plan_constrained
from pepper_kin.planners import CompiledManifold, Problem, project
from pepper_kin.trajectory.path import as_cubic_path

POST = pk.Scene().add_box("post", size=(0.05, 0.05, 1.0), position=(0.33, 0.17, 0.85))
UP = np.array([0.0, 0.0, 1.0])
POINT = np.array([0.6, 0.1, 0.8])


def level(degrees):
    return pk.ik.AxisAlignment("LArm_effector", UP, axis=UP, tolerance=np.radians(degrees))


@pytest.fixture(scope="module")
def beside_the_post(pepper):
    tasks = [pk.ik.HandPosition("left", (0.28, 0.32, 0.85)), level(1)]
    found = pk.ik.solve(pepper, tasks, start=pepper.posture("Stand"), scene=POST, joints="left_arm")
    assert found.success
    return found.q


def dense(pepper, plan, count=40):
    spline = as_cubic_path(pepper, plan.path)
    segments = np.repeat(np.arange(len(spline.breaks) - 1), count)
    within = np.tile(np.linspace(0.0, 1.0, count), len(spline.breaks) - 1)
    return spline.at(segments, within * np.diff(spline.breaks)[segments])


def tilts(pepper, q):
    return np.arccos(np.clip(pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:, :3, 2] @ UP, -1, 1))


@pytest.mark.parametrize("degrees", [0.5, 10.0])
def test_a_tray_is_carried_level_round_a_post(pepper, beside_the_post, degrees):
    target = [0.30, 0.05, 0.85]
    plan = plan_constrained(
        pepper,
        beside_the_post,
        [pk.ik.HandPosition("left", target)],
        POST,
        [level(degrees)],
        joints="left_arm",
    )
    assert plan.status is PlanStatus.SOLVED
    q = dense(pepper, plan)
    assert tilts(pepper, q).max() <= np.radians(degrees)
    assert plan.constraint_errors[0] == pytest.approx(tilts(pepper, q).max(), rel=0.02)
    assert not pk.collision.in_collision(pepper, q, POST).any()
    np.testing.assert_allclose(
        pk.kinematics.frame_pose(pepper, plan.goal, "LArm_effector")[:3, 3], target, atol=1e-3
    )
    moved = np.flatnonzero(np.ptp(q, axis=0) > 1e-9)
    assert {pepper.joint_names[j] for j in moved} <= set(pepper.joint_group("left_arm"))
    assert "tolerance" in plan.message
    # The same motion without the constraint tips the tray.
    free = pk.plan(pepper, beside_the_post, plan.goal, POST, joints="left_arm")
    assert tilts(pepper, dense(pepper, free)).max() > np.radians(degrees)


def test_two_hands_keep_a_box_between_them(pepper):
    center = np.array([0.28, 0.0, 0.75])
    half = np.array([0.0, 0.12, 0.0])
    hands = [pk.ik.HandPosition("left", center + half), pk.ik.HandPosition("right", center - half)]
    found = pk.ik.solve(pepper, hands, start=pepper.posture("Stand"), scene=pk.Scene(), joints="both_arms")
    assert found.success

    def between(q):
        left = pk.kinematics.frame_pose(pepper, q, "LArm_effector")
        return np.linalg.inv(pk.kinematics.frame_pose(pepper, q, "RArm_effector")) @ left

    held = pk.ik.RelativePose(
        "LArm_effector", "RArm_effector", between(found.q), tolerance=0.003,
        orientation_tolerance=np.radians(3),
    )  # fmt: skip
    goal = [pk.ik.HandPosition("left", [0.30, 0.12, 1.0])]
    plan = plan_constrained(pepper, found.q, goal, None, [held], joints="both_arms")
    assert plan.success
    assert len(plan.constraint_errors) == 2
    poses = between(dense(pepper, plan))
    assert np.linalg.norm(poses[:, :3, 3] - between(found.q)[:3, 3], axis=1).max() <= 0.003
    turns = np.einsum("ij,kij->k", between(found.q)[:3, :3], poses[:, :3, :3])  # the trace of R0^T R
    assert np.arccos(np.clip((turns - 1) / 2, -1, 1)).max() <= np.radians(3)


def test_gaze_and_height_are_kept_at_once(pepper):
    gaze = pk.ik.LookAt(POINT, tolerance=np.radians(3))
    height = FrameInPlane("LArm_effector", (0, 0, 0.85), tolerance=0.002)
    tasks = [pk.ik.HandPosition("left", (0.28, 0.30, 0.85)), pk.ik.LookAt(POINT)]
    found = pk.ik.solve(pepper, tasks, start=pepper.posture("Stand"), scene=POST)
    goal = [pk.ik.HandPosition("left", (0.30, 0.05, 0.85))]
    plan = plan_constrained(pepper, found.q, goal, POST, [gaze, height])
    assert plan.success
    q = dense(pepper, plan)
    assert np.abs(pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:, 2, 3] - 0.85).max() <= 0.002
    camera = pk.kinematics.frame_pose(pepper, q, gaze.frame)
    line = POINT - camera[:, :3, 3]
    cosine = np.einsum("kij,j,ki->k", camera[:, :3, :3], gaze.axis, line) / np.linalg.norm(line, axis=1)
    assert np.arccos(cosine.min()) <= np.radians(3)
    # And the planned joints can be timed.
    assert pk.retime(pepper, plan.path).duration > 0


def test_plan_takes_the_constraints_and_hands_over(pepper, beside_the_post):
    goal = [pk.ik.HandPosition("left", [0.30, 0.05, 0.85])]
    arguments = dict(joints="left_arm", seed=2, timeout=60.0)
    plan = pk.plan(pepper, beside_the_post, goal, POST, constraints=[level(5)], **arguments)
    assert plan.planner == "cbirrt"
    assert tilts(pepper, dense(pepper, plan)).max() <= np.radians(5)
    same = plan_constrained(pepper, beside_the_post, goal, POST, [level(5)], **arguments)
    np.testing.assert_array_equal(plan.path, same.path)
    with pytest.raises(InvalidValueError, match="planner: got 'aorrtc', expected 'rrt_connect'"):
        pk.plan(pepper, beside_the_post, goal, POST, constraints=[level(5)], planner="aorrtc")
    with pytest.raises(InvalidValueError, match="tasks"):
        pk.plan(pepper, beside_the_post, goal, POST, constraints=[])


def test_the_same_seed_gives_the_same_plan(pepper, beside_the_post):
    goal = pk.ik.solve(
        pepper, [pk.ik.HandPosition("left", (0.30, 0.05, 0.85)), level(1)], start=beside_the_post,
        scene=POST, joints="left_arm", seed=1,
    ).q  # fmt: skip
    plans = [
        plan_constrained(pepper, beside_the_post, goal, POST, [level(5)], seed=3, timeout=60.0)
        for _ in range(2)
    ]
    np.testing.assert_array_equal(plans[0].path, plans[1].path)
    np.testing.assert_array_equal(plans[0].path[-1], goal)
    assert plans[0].path.flags.writeable is False


def test_ends_off_a_constraint_are_named_with_what_is_missing(pepper, beside_the_post):
    stand = pepper.posture("Stand")
    plan = plan_constrained(pepper, stand, beside_the_post, None, [level(5)])
    assert plan.status is PlanStatus.START_OFF_CONSTRAINT
    angle = np.degrees(tilts(pepper, stand[None])[0])
    assert f"{angle:.1f} deg" in plan.message
    assert "5.0 deg" in plan.message
    plan = plan_constrained(pepper, beside_the_post, stand, None, [level(5)])
    assert plan.status is PlanStatus.GOAL_OFF_CONSTRAINT
    assert "LArm_effector" in plan.message
    several = plan_constrained(pepper, beside_the_post, np.array([stand, beside_the_post]), None, [level(5)])
    assert several.status is PlanStatus.SOLVED


def test_a_goal_in_an_obstacle_and_one_out_of_reach(pepper, beside_the_post):
    wall = pk.Scene().add_box("block", size=(0.2, 0.2, 0.2), position=(0.30, 0.05, 0.85))
    goal = pk.ik.solve(
        pepper, [pk.ik.HandPosition("left", (0.30, 0.05, 0.85)), level(1)], start=beside_the_post,
        joints="left_arm",
    ).q  # fmt: skip
    plan = plan_constrained(pepper, beside_the_post, goal, wall, [level(5)])
    assert plan.status is PlanStatus.GOAL_IN_COLLISION
    assert "block" in plan.message
    far = [pk.ik.HandPosition("left", (2.0, 0.0, 1.0))]
    plan = plan_constrained(pepper, beside_the_post, far, None, [level(5)], timeout=2.0)
    assert plan.status is PlanStatus.NO_IK


def test_misuse_is_refused_by_name(pepper, beside_the_post):
    q = beside_the_post
    with pytest.raises(InvalidValueError, match="at least one"):
        plan_constrained(pepper, q, q, None, [])
    vague = pk.ik.AxisAlignment("LArm_effector", UP, tolerance=np.inf)
    with pytest.raises(InvalidValueError, match="tolerance of LArm_effector"):
        plan_constrained(pepper, q, q, None, [vague])
    with pytest.raises(UnknownNameError, match="LPaw"):
        plan_constrained(pepper, q, q, None, [FrameInPlane("LPaw", (0, 0, 1))])
    with pytest.raises(InvalidValueError, match="normal of LArm_effector"):
        FrameInPlane("LArm_effector", (0, 0, 1), normal=(0, 0, 0))
    with pytest.raises(LimitError):
        plan_constrained(pepper, q + 5.0, q, None, [level(5)])
    with pytest.raises(InvalidValueError, match="margin"):
        plan_constrained(pepper, q, q, None, [level(5)], margin=-1.0)


def all_kinds():
    turn = np.eye(4)
    turn[:3, 3] = 0.0, 0.25, 0.05
    return [
        level(5),
        pk.ik.LookAt(POINT),
        pk.ik.HandPosition("right", (0.3, -0.2, 0.8)),
        pk.ik.RelativePose("LArm_effector", "RArm_effector", turn),
        pk.ik.JointPosture([0.1, -0.2], joints=["HeadYaw", "HipPitch"]),
        pk.ik.CenterOfMassOverWheels(0.02),
        FrameInPlane("RArm_effector", (0.1, 0.2, 0.8), normal=(1, 2, 2)),
    ]


def test_the_compiled_constraints_are_the_tasks(pepper):
    rng = np.random.default_rng(4)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (10, pepper.n))
    free = np.arange(pepper.n)
    tasks = [part for task in all_kinds() for part in getattr(task, "parts", (task,))]
    for task in tasks:
        manifold = manifold_of(pepper, [task], q[0], free)
        found = manifold.errors(q).max(axis=1)
        np.testing.assert_allclose(found, [task.error(pepper, x) for x in q], atol=1e-9)
        assert manifold.contains(q).tolist() == [task.error(pepper, x) <= task.tolerance for x in q]


class Shelf(FrameInPlane):
    """Not a class of the library: a hand below a height, called in Python."""

    def residual(self, pepper, q):
        return np.maximum(super().residual(pepper, q), 0.0)


def test_projection_meets_all_tasks_and_a_users_own_is_called_in_python(pepper, beside_the_post):
    free = np.array(sorted(pepper.joint_index(name) for name in pepper.joint_group("left_arm")))
    states = np.clip(
        beside_the_post[free] + np.random.default_rng(0).normal(0, 0.15, (20, free.size)),
        pepper.lower_limits[free],
        pepper.upper_limits[free],
    )
    problem = Problem(
        pepper.lower_limits[free], pepper.upper_limits[free], states[0], states[1],
        lambda rows: np.ones(len(rows), dtype=bool),
    )  # fmt: skip
    for plane in (FrameInPlane, Shelf):
        tasks = [level(1), plane("LArm_effector", (0, 0, 0.85))]
        manifold = manifold_of(pepper, tasks, beside_the_post, free)
        assert isinstance(manifold.function, CompiledManifold) == (plane is FrameInPlane)
        moved, done = project(problem, manifold, states)
        assert done.mean() > 0.8
        for state in moved[done]:
            q = beside_the_post.copy()
            q[free] = state
            assert all(task.error(pepper, q) <= task.tolerance for task in tasks)


@pytest.mark.parametrize("normal", [UP, [1.0, -2.0, 0.5]])
def test_the_jacobian_of_a_plane_is_its_slope(pepper, normal):
    task = FrameInPlane("RArm_effector", (0.1, 0.2, 0.8), normal=normal)
    q, step = pepper.posture("Stand"), 1e-6
    slope = [
        (task.residual(pepper, q + step * e) - task.residual(pepper, q - step * e))[0] / (2 * step)
        for e in np.eye(pepper.n)
    ]
    np.testing.assert_allclose(task.jacobian(pepper, q)[0], slope, atol=1e-8)
    distance = abs((pk.kinematics.frame_pose(pepper, q, "RArm_effector")[:3, 3] - task.target) @ task.normal)
    assert task.error(pepper, q) == pytest.approx(distance)
    assert "off the plane" in task.shortfall(pepper, q)
