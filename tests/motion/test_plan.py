import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.motion import PlanStatus, goals, plan_request
from pepper_kin.planners import OMPL_PLANNERS, available_ompl_planners
from pepper_kin.trajectory.path import as_cubic_path

TABLE = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))


@pytest.fixture(scope="module")
def over_the_table():
    """From hanging arms to a hand above the table: the straight way goes through it."""
    pepper = pk.load_pepper()
    goal = pepper.joint_vector(
        {"LShoulderPitch": 0.4, "LShoulderRoll": 0.1, "LElbowRoll": -0.9, "LElbowYaw": -1.2, "HipPitch": -0.3}
    )
    return pepper, pepper.posture("Stand"), goal


ONE_JOINT = """
<robot name="one_joint">
  <link name="base"/>
  <link name="arm">
    <inertial>
      <origin xyz="0.2 0 0"/><mass value="1"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="20"/>
  </joint>
</robot>
"""


@pytest.fixture(scope="module")
def one_joint(tmp_path_factory):
    file = tmp_path_factory.mktemp("one_joint") / "one_joint.urdf"
    file.write_text(ONE_JOINT)
    return pk.load_robot(file, acceleration_limits=10.0)


def test_a_robot_of_one_joint_is_planned_timed_and_optimized(one_joint):
    """`optimize` and `minimum_torque_trajectory` ended with an IndexError."""
    plan = pk.plan(one_joint, [0.0], [1.0])
    motion = pk.retime(one_joint, plan)
    np.testing.assert_allclose(motion.end, [1.0])
    assert pk.motion.optimize(one_joint, plan).report()
    assert pk.plan(one_joint, [0.0], [1.0], smooth=True).trajectory is not None
    found = pk.motion.minimum_torque_trajectory(one_joint, [0.0], [1.0], 1.5)
    assert found.success
    np.testing.assert_allclose(found.trajectory.end, [1.0], atol=1e-9)


def spline_states(pepper, path, count=2000):
    """States along the spline that `retime` draws, by an evaluation of its own."""
    spline = as_cubic_path(pepper, path)
    s = np.linspace(spline.breaks[0], spline.breaks[-1], count)
    segment = np.clip(np.searchsorted(spline.breaks, s, side="right") - 1, 0, len(spline.breaks) - 2)
    local = s - spline.breaks[segment]
    return sum(spline.coefficients[segment, p] * local[:, None] ** p for p in range(4))


@pytest.mark.parametrize("seed", range(3))
def test_path_goes_round_and_its_spline_is_free(over_the_table, seed):
    pepper, start, goal = over_the_table
    straight = start + np.linspace(0, 1, 200)[:, None] * (goal - start)
    assert pk.collision.in_collision(pepper, straight, TABLE).any()
    found = pk.plan(pepper, start, goal, TABLE, seed=seed)
    assert found.success, found.message
    np.testing.assert_array_equal(found.path[0], start)
    np.testing.assert_allclose(found.path[-1], goal, atol=1e-12)
    states = spline_states(pepper, found.path)
    assert pk.collision.clearance(pepper, states, TABLE).min() > 0
    assert not pk.collision.in_collision(pepper, states, TABLE).any()
    assert np.all(states >= pepper.lower_limits - 1e-9)
    assert np.all(states <= pepper.upper_limits + 1e-9)
    torque = pk.dynamics.gravity_torque(pepper, states)
    assert np.all(np.abs(torque) <= pepper.effort_limits)


def test_same_seed_same_path(over_the_table):
    pepper, start, goal = over_the_table
    paths = [pk.plan(pepper, start, goal, TABLE, seed=5).path for _ in range(2)]
    np.testing.assert_array_equal(*paths)


def test_joints_that_need_not_move_do_not(over_the_table):
    pepper, start, goal = over_the_table
    path = pk.plan(pepper, start, goal, TABLE).path
    still = np.abs(goal - start) < 1e-12
    assert still.sum() >= 9
    np.testing.assert_array_equal(path[:, still], np.tile(start[still], (len(path), 1)))


def test_tasks_as_goal():
    pepper = pk.load_pepper()
    target = np.array([0.35, 0.2, 0.85])
    found = pk.plan(pepper, pepper.posture("Stand"), [pk.ik.HandPosition("left", target)], TABLE)
    assert found.success, found.message
    palm = pk.kinematics.frame_pose(pepper, found.goal, "LArm_effector")[:3, 3]
    assert np.linalg.norm(palm - target) < 1e-3


def test_start_in_collision_names_pair_and_depth():
    pepper = pk.load_pepper()
    scene = pk.Scene().add_box("pillar", (0.2, 0.2, 2.0), (0.1, 0.2, 1.0))
    found = pk.plan(pepper, pepper.posture("Stand"), pepper.posture("StandZero"), scene)
    assert found.status is PlanStatus.START_IN_COLLISION
    assert not found.success
    assert "pillar overlap" in found.message
    assert "mm deep" in found.message
    assert found.path is None


def test_goal_in_collision():
    pepper = pk.load_pepper()
    goal = pepper.joint_vector({"HipRoll": 0.5})
    found = pk.plan(pepper, pepper.posture("Stand"), goal)
    assert found.status is PlanStatus.GOAL_IN_COLLISION
    assert "Pelvis and torso" in found.report()


def test_goal_torque_limit_names_joint_and_torque():
    pepper = pk.load_pepper()
    bow = {"KneePitch": -0.5, "HipPitch": -1.0, "LShoulderPitch": 0.0, "RShoulderPitch": 0.0}
    goal = pepper.joint_vector(bow)
    torque = pk.dynamics.gravity_torque(pepper, goal)[0]
    assert abs(torque) > pepper.effort_limits[0]
    found = pk.plan(pepper, pepper.posture("Stand"), goal)
    assert found.status is PlanStatus.GOAL_TORQUE_LIMIT
    assert f"{abs(torque):.2f} N m at KneePitch" in found.message


def test_unreachable_tasks():
    pepper = pk.load_pepper()
    found = pk.plan(pepper, pepper.posture("Stand"), [pk.ik.HandPosition("left", (2.0, 0.0, 1.0))], timeout=2)
    assert found.status is PlanStatus.NO_IK
    assert not found.ik.success


BESIDE = {"LElbowRoll": -0.05, "LShoulderRoll": 0.3}
ARM = ("LShoulderPitch", "LShoulderRoll")


def walls(pepper, q):
    """Walls around the left hand, open at its front and back."""
    palm = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
    scene = pk.Scene()
    for name, shift, size in (
        ("above", (0, 0, 0.14), (0.3, 0.3, 0.02)),
        ("below", (0, 0, -0.14), (0.3, 0.3, 0.02)),
        ("left", (0, 0.15, 0), (0.3, 0.02, 0.3)),
        ("right", (0, -0.15, 0), (0.3, 0.02, 0.3)),
    ):
        scene = scene.add_box(name, size, palm + shift)
    return scene


def test_an_end_that_is_shut_in_is_named_with_what_is_in_the_way():
    """A hand enclosed by walls cannot leave them, nor get in; one of the walls is in the way."""
    pepper = pk.load_pepper()
    inside, outside = (pepper.joint_vector({"LShoulderPitch": x, **BESIDE}) for x in (0.0, 1.5))
    scene = walls(pepper, inside)
    for ends, status, advice in (
        ((inside, outside), PlanStatus.START_SHUT_IN, "away from the start"),
        ((outside, inside), PlanStatus.GOAL_SHUT_IN, "up to the goal"),
    ):
        found = pk.plan(pepper, *ends, scene, timeout=0.5, joints=ARM)
        assert found.status is status, found.message
        assert advice in found.report()
        assert re.search(
            r"Most often in the way there: (above|below|left|right), mostly of l_", found.message
        )
        sizes = found.search.tree_sizes
        assert f"start grew to {sizes[0]} of them, that of the goal to {sizes[1]}" in found.message


def test_no_path_in_time():
    """No time at all: the right status, and nobody is said to be shut in."""
    pepper = pk.load_pepper()
    inside, outside = (pepper.joint_vector({"LShoulderPitch": x, **BESIDE}) for x in (0.0, 1.5))
    found = pk.plan(pepper, inside, outside, walls(pepper, inside), timeout=0.002, joints="left_arm")
    assert found.status is PlanStatus.NO_PATH_IN_TIME, found.message
    assert "Raise the timeout" in found.report()


def test_the_optimal_planner_says_how_long_the_path_is_and_why_it_stopped(over_the_table):
    (pepper, start, goal), scene = over_the_table, TABLE
    first = pk.plan(pepper, start, goal, scene)
    straight = pk.plan(pepper, start, goal, scene, planner="aorrtc", gap=5.0, timeout=20.0)
    assert straight.search.stop_reason is planners.StopReason.GAP_REACHED
    best = pk.plan(pepper, start, goal, scene, planner="aorrtc", timeout=1.0)
    assert best.search.stop_reason is planners.StopReason.TIME_UP
    assert 0.0 < best.search.lower_bound <= best.search.cost <= first.search.cost
    assert f"{100 * best.search.gap:.1f} % above the straight line" in best.message
    assert "the time budget is used up" in best.message
    with pytest.raises(
        InvalidValueError, match=r"gap: got -1, expected a finite number of 0 or more, or None"
    ):
        pk.plan(pepper, start, goal, scene, planner="aorrtc", gap=-1)
    with pytest.raises(InvalidValueError, match=r"gap: got 0.1, expected None with planner 'rrt_connect'"):
        pk.plan(pepper, start, goal, scene, gap=0.1)
    with pytest.raises(InvalidValueError, match=r"planner: got 'rrt_star'.*'rrt_connect', 'aorrtc'"):
        pk.plan(pepper, start, goal, scene, planner="rrt_star")


def test_bad_input_is_named():
    pepper = pk.load_pepper()
    stand = pepper.posture("Stand")
    with pytest.raises(LimitError, match="start: HeadYaw = 3 rad is outside"):
        pk.plan(pepper, pepper.joint_vector({"HeadYaw": 3.0}), stand)
    with pytest.raises(LimitError, match="goal: HeadYaw = 3 rad is outside"):
        pk.plan(pepper, stand, pepper.joint_vector({"HeadYaw": 3.0}))
    lacking = [name for name in OMPL_PLANNERS if name not in available_ompl_planners()]
    assert lacking
    for name in lacking:
        message = (
            rf"planner: got '{name}' \(the installed ompl lacks it\), expected one of 'rrt_connect'.*'RRT'"
        )
        with pytest.raises(InvalidValueError, match=message):
            pk.plan(pepper, stand, stand, planner=name)
    with pytest.raises(InvalidValueError, match=r"goal: got other values of HeadYaw"):
        pk.plan(pepper, stand, pepper.joint_vector({"HeadYaw": 1.0}), joints="left_arm")


def test_angles_beyond_what_is_examined_are_refused_by_joint():
    """They were called shut in after a hundredth of a second."""
    turning = pk.load_pepper().with_limits(lower={"HeadYaw": -np.inf}, upper={"HeadYaw": np.inf})
    near, far = turning.posture("Stand"), turning.joint_vector({"HeadYaw": 20.0}, rest="Stand")
    expected = "HeadYaw = 20 rad, expected -16 to 16 rad, less by full turns"
    assert pk.plan(turning, near, far).success  # a goal is taken within half a turn
    with pytest.raises(InvalidValueError, match=f"start: got {expected}"):
        pk.plan(turning, far, near)
    assert pk.plan(turning, near, turning.joint_vector({"HeadYaw": 15.0}, rest="Stand")).success


@pytest.mark.parametrize("constrained", [False, True])
def test_a_target_that_is_met_already_needs_no_motion(constrained):
    """Also where inverse kinematics knows other postures that meet it."""
    pepper = pk.load_pepper()
    q = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
    place = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
    tasks = [pk.ik.HandPosition("left", place)]
    constraints = [pk.ik.HandPosition("right", pk.kinematics.frame_pose(pepper, q, "RArm_effector")[:3, 3])]
    more = {"constraints": constraints} if constrained else {}
    for start in (q, q + 1e-7):
        plan = pk.plan(pepper, start, tasks, seed=1, **more)
        assert plan.success
        assert plan.message == "Start and goal are the same."
        np.testing.assert_array_equal(plan.path, start[None])


def test_a_plan_that_stays_advises_nothing_that_refuses(pepper):
    """It advised `retime`, which refuses what has no length."""
    start = pepper.posture("Stand")
    plan = pk.plan(pepper, start, start)
    assert plan.advice == "Nothing has to move, so there is nothing to time."
    assert plan.path.shape == (1, pepper.n)
    assert plan.length == 0
    assert "retime" not in plan.report()


def test_where_nothing_is_near_the_report_names_no_infinite_clearance(one_joint):
    report = pk.plan(one_joint, [0.0], [1.0]).report()
    assert "inf" not in report
    assert "Clearance: no obstacles." in report


def test_a_failure_counts_what_was_done_at_all_margins(one_joint):
    """It named the time of the last of several searches: 0.63 s of the 5 s that had passed."""
    wall = pk.Scene().add_box("wall", (0.1, 0.1, 0.1), (0.3, 0.0, -0.2))
    plan = pk.plan(one_joint, [-1.0], [1.0], wall, timeout=0.5)
    assert plan.status is PlanStatus.NO_PATH_IN_TIME
    assert f"No path: {plan.states_checked} configurations were checked in " in plan.message
    assert float(re.search(r"checked in ([\d.]+) s", plan.message)[1]) > 0.4


def test_tasks_that_need_it_get_all_of_the_time(pepper, monkeypatch):
    """Inverse kinematics gave up after two thirds of the time, and said that time had run out."""
    budgets, solve = [], goals.solve

    def recorded(*arguments, timeout, **options):
        budgets.append(timeout)
        return solve(*arguments, timeout=timeout, **options)

    monkeypatch.setattr(goals, "clear_goals", lambda *_: None)
    monkeypatch.setattr(goals, "solve", recorded)
    pk.plan(
        pepper, pepper.posture("Stand"), [pk.ik.FramePosition("l_gripper", [0.3, 0.2, 0.9])], timeout=50.0
    )
    assert len(budgets) == 1
    assert 40.0 < budgets[0] <= 50.0


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"planner": "aorrtc", "timeout": 0.2},
        {"costs": [pk.ik.FramePosition("r_gripper", [0.2, -0.2, 0.8])]},
        {"constraints": [pk.ik.FrameInPlane("r_gripper", (0, 0, 0.7), tolerance=0.5)]},
    ],
)
def test_code_is_loaded_before_the_clock_starts(pepper, monkeypatch, options):
    """The time that it takes was taken from the search: the first plan of a process was another."""
    order = []
    for name in ("load_code_for", "Ending"):
        function = getattr(plan_request, name)
        monkeypatch.setattr(
            plan_request,
            name,
            lambda *a, _name=name, _function=function: order.append(_name) or _function(*a),
        )
    goal = [pk.ik.FramePosition("l_gripper", [0.3, 0.2, 0.9])]
    pk.plan(pepper, pepper.posture("Stand"), goal, **options)
    assert order == ["load_code_for", "Ending"]


@pytest.mark.parametrize("distance", [1.1e-9, 1e-8, 9e-8, 1e-6])
@pytest.mark.parametrize("smooth", [False, True])
def test_goals_that_are_all_but_the_start_are_no_error(distance, smooth):
    """Waypoints between them were refused as equal."""
    pepper = pk.load_pepper()
    start = pepper.posture("Stand")
    goal = start.copy()
    goal[pepper.joint_index("HeadYaw")] += distance
    plan = pk.plan(pepper, start, goal, smooth=smooth)
    assert plan.success
    if len(plan.path) > 1:
        assert pk.retime(pepper, plan).duration > 0.0


@pytest.mark.parametrize(
    ("joint", "distance"),
    [("LShoulderPitch", 3e-7), ("HipPitch", -1.01e-7), ("LElbowYaw", 2e-7), ("LElbowYaw", 9e-7)],
)
def test_smoothing_from_hardly_any_motion_is_no_error(joint, distance):
    """The search went astray, to motions of days, whose states were refused as too many."""
    pepper = pk.load_pepper()
    start = pepper.posture("Stand")
    goal = start.copy()
    goal[pepper.joint_index(joint)] += distance
    plan = pk.plan(pepper, start, goal, smooth=True)
    assert plan.success
    assert plan.trajectory.duration < 1.0
