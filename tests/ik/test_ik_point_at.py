"""The arm's line through a point: by all solvers, in batches, as a goal of a plan, for another robot."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ik.tasks.direction import turn_between

PEPPER = pk.load_pepper()
POINTS = {"left": np.array([1.6, 0.9, 0.5]), "right": np.array([1.2, -0.8, 1.5])}
STARTS = {"forearm": "ElbowRoll", "arm": "ShoulderRoll"}

TWO_LINKS = """<robot name="two_links">
  <link name="base"/>
  <joint name="first" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="2"/></joint>
  <link name="upper"><inertial><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="second" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="2"/></joint>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="end" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0.3 0 0"/></joint>
  <link name="tip"/>
</robot>"""


def line_of(q, hand, line):
    """Return two points of the line by Pinocchio: the joint it begins at, and the wrist and 2.5 cm more."""
    side, model = hand[0].upper(), pinocchio.buildModelFromXML(PEPPER.urdf)
    data = model.createData()
    pinocchio.forwardKinematics(model, data, q)
    start = data.oMi[model.getJointId(side + STARTS[line])].translation
    return start, data.oMi[model.getJointId(f"{side}WristYaw")].act(np.array([0.025, 0.0, 0.0]))


def distance_and_order(start, hand, point):
    """Return how far the line passes beside the point [m], and whether the point is beyond the hand."""
    along = (hand - start) / np.linalg.norm(hand - start)
    across = np.linalg.norm(np.cross(point - start, along))
    return across, (point - hand) @ along > 0


@pytest.mark.parametrize("solver", ["fast", "placo", "proxsuite"])
@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.parametrize("line", ["forearm", "arm"])
def test_every_solver_lets_the_line_of_either_arm_meet_the_point(solver, hand, line):
    point = POINTS[hand]
    task = pk.ik.PointAt(hand, point, line=line)
    result = pk.ik.solve(PEPPER, [task], joints=f"{hand}_arm", solver=solver, collisions=False)
    assert result.success, result.report()
    start, middle = line_of(result.q, hand, line)
    beside, beyond = distance_and_order(start, middle, point)
    assert beyond
    assert beside <= np.linalg.norm(point - middle) * np.sin(task.tolerance) + 1e-9
    assert np.array_equal(np.delete(result.q, range(5, 15)), np.delete(PEPPER.neutral(), range(5, 15)))


def test_the_forearms_line_is_the_axis_of_the_wrist_and_of_the_open_fingers():
    """Which line it is: that of WristYaw by the URDF, and a mere turn of the wrist does not move it."""
    model = pinocchio.buildModelFromXML(PEPPER.urdf)
    data, task = model.createData(), pk.ik.PointAt("left", (2.0, 0.5, 0.7))
    q = np.random.default_rng(4).uniform(PEPPER.lower_limits, PEPPER.upper_limits)
    pinocchio.forwardKinematics(model, data, q)
    wrist = data.oMi[model.getJointId("LWristYaw")]
    line = task.target - wrist.act(np.array([0.025, 0.0, 0.0]))
    expected = np.arccos(wrist.rotation[:, 0] @ line / np.linalg.norm(line))
    assert task.error(PEPPER, q) == pytest.approx(expected, abs=1e-9)
    assert np.abs(task.jacobian(PEPPER, q)[:, PEPPER.joint_index("LWristYaw")]).max() < 1e-12


def test_its_tolerance_is_kept_and_reported():
    wide = pk.ik.PointAt("left", (-2.0, 0.3, 2.0), tolerance=np.radians(60))
    narrow = pk.ik.PointAt("left", (-2.0, 0.3, 2.0))
    behind = pk.ik.solve(PEPPER, [narrow], joints=("LElbowRoll", "LElbowYaw"), collisions=False)
    assert not behind.success
    assert "the line of left forearm passes" in behind.report()
    assert "beside (-2.000, 0.300, 2.000)" in behind.report()
    assert wide.error(PEPPER, behind.q) == narrow.error(PEPPER, behind.q)


def test_a_batch_of_points_agrees_with_one_by_one():
    points = np.random.default_rng(3).uniform((0.8, 0.2, 0.2), (2.0, 1.5, 1.8), (40, 3))
    task = pk.ik.PointAt("left", points)
    found = pk.ik.solve_batch(PEPPER, [task], joints="left_arm", collisions=False)
    assert found.success.mean() > 0.95
    for q, point in zip(found.q[found.success], points[found.success], strict=True):
        start, middle = line_of(q, "left", "forearm")
        beside, beyond = distance_and_order(start, middle, point)
        assert beyond
        assert beside <= np.linalg.norm(point - middle) * np.sin(task.tolerance) + 1e-9
    one = pk.ik.solve(PEPPER, [task.at(3)], joints="left_arm", collisions=False)
    np.testing.assert_allclose(found.q[3], one.q, atol=1e-12)


@pytest.mark.parametrize("hand", ["left", "right"])
def test_a_stretched_arm_points_along_one_line(hand):
    side, rng = 1 if hand == "left" else -1, np.random.default_rng(4)
    for _ in range(10):
        point = rng.uniform([0.8, -0.3, 0.3], [2.5, 1.5, 1.8]) * [1, side, 1]
        found = pk.ik.solve(PEPPER, pk.ik.straight_pointing(hand, point))
        assert found.success, found.report()
        elbow, middle = line_of(found.q, hand, "forearm")
        shoulder, _ = line_of(found.q, hand, "arm")
        upper, fore = elbow - shoulder, middle - elbow
        angle = np.arccos(upper @ fore / np.linalg.norm(upper) / np.linalg.norm(fore))
        # By the description's lengths: the forearm begins 1.5 cm beside the upper arm of 18.1 cm, and 9
        # degrees are fixed between them, about the other axis.
        assert angle < np.hypot(np.arctan(0.015 / 0.1812) + 0.025, 0.157079) + 0.01
        beside, beyond = distance_and_order(elbow, middle, point)
        assert beyond
        assert beside < np.linalg.norm(point - middle) * 0.02


def test_it_is_a_goal_of_a_plan():
    task = pk.ik.PointAt("right", POINTS["right"], tolerance=np.radians(1.0))
    scene = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.5, 0.0, 0.7))
    plan = pk.plan(PEPPER, PEPPER.neutral(), [task], scene=scene)
    assert plan.success, plan.report()
    start, middle = line_of(plan.path[-1], "right", "forearm")
    beside, beyond = distance_and_order(start, middle, POINTS["right"])
    assert beyond
    assert beside <= np.linalg.norm(POINTS["right"] - middle) * np.sin(task.tolerance) + 1e-9


def test_it_is_kept_along_a_path():
    """A hand that goes on pointing while the body moves."""
    task = pk.ik.PointAt("left", POINTS["left"], tolerance=np.radians(3.0))
    start = pk.ik.solve(PEPPER, [task, pk.ik.JointValue("HipRoll", -0.15)], scene=pk.Scene())
    goal = pk.ik.solve(PEPPER, [task, pk.ik.JointValue("HipRoll", 0.15)], scene=pk.Scene())
    assert start.success
    assert goal.success
    plan = pk.motion.plan_constrained(PEPPER, start.q, goal.q, constraints=[task])
    assert plan.success, plan.report()
    assert np.ptp(plan.path[:, PEPPER.joint_index("HipRoll")]) > 0.25
    for q in plan.path:
        from_, middle = line_of(q, "left", "forearm")
        beside, _ = distance_and_order(from_, middle, POINTS["left"])
        assert beside <= np.linalg.norm(POINTS["left"] - middle) * np.sin(task.tolerance) + 1e-9


def test_another_robots_line_by_its_frames():
    robot = pk.load_robot(TWO_LINKS)
    point = np.array([0.5, 1.5, 1.4])
    result = pk.ik.solve(robot, [pk.ik.LineThroughPoint("lower", "tip", point)], collisions=False)
    assert result.success, result.report()
    # By hand: the first joint faces the point, the second raises the lower link from (0.4, 0, 0.5) to it.
    away = np.hypot(point[0], point[1]) - 0.4
    expected = (np.arctan2(point[1], point[0]), -np.arctan2(point[2] - 0.5, away))
    np.testing.assert_allclose(result.q, expected, atol=np.radians(0.5) * 1.3)


def test_what_is_no_line_is_refused():
    with pytest.raises(InvalidValueError, match="'LBicep' twice"):
        pk.ik.LineThroughPoint("LBicep", "LBicep", (1, 0, 1))
    with pytest.raises(InvalidValueError, match="LShoulder and LBicep at the same place"):
        pk.ik.solve(PEPPER, [pk.ik.LineThroughPoint("LShoulder", "LBicep", (1, 0, 1))], collisions=False)
    with pytest.raises(UnknownNameError, match="LElbo"):
        pk.ik.solve(PEPPER, [pk.ik.LineThroughPoint("LElbo", "l_hand", (1, 0, 1))], collisions=False)
    with pytest.raises(UnknownNameError, match="middle"):
        pk.ik.PointAt("middle", (1, 0, 1))
    with pytest.raises(InvalidValueError, match="'forearm', 'arm'"):
        pk.ik.PointAt("left", (1, 0, 1), line="finger")
    with pytest.raises(InvalidValueError, match="point of left forearm"):
        pk.ik.PointAt("left", (1, 0, np.nan))


def test_the_turn_between_two_directions_grows_up_to_a_half_turn():
    first = np.array([0.36, -0.48, 0.8])
    side = np.array([0.8, 0.6, 0.0])
    for angle in (0.0, 1e-9, 9.9e-4, 1.1e-3, 0.4, 2.0, 3.1, np.pi - 1e-5):
        second = np.cos(angle) * first + np.sin(angle) * side
        turn, by_first, by_second = turn_between(first, second)
        assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-9)
        assert np.isfinite([by_first, by_second]).all()
        if angle < 3.14:
            around = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
            np.testing.assert_allclose(pinocchio.exp3(turn) @ first, second, atol=1e-9)
            np.testing.assert_allclose(around @ turn, 0.0, atol=1e-12)
    turn, by_first, _ = turn_between(first, -first)
    assert np.linalg.norm(turn) == pytest.approx(np.pi, abs=1e-6)
    assert np.abs(by_first.T @ turn).max() > 0.1
