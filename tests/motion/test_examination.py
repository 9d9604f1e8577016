"""Goals found together, waypoints of a rounded path, and the examination of curves, by coal and scipy."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

import pepper_kin as pk
from pepper_kin.collision.curve_examination import cut, is_clear_along
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.core.collision.curve_check import SHORTEST
from pepper_kin.kinematics import frame_pose
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.goal_search import APART, clear_goals
from pepper_kin.planners import Path, rounded_waypoints
from pepper_kin.trajectory.path import as_cubic_path

PEPPER = pk.load_pepper()
TABLE = pk.Scene().add_box("table", (0.6, 1.2, 0.04), (0.53, 0.0, 0.72))
REACH = np.array(motion_bounds(PEPPER))
ARM = np.array([PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")])
MIDDLE = PEPPER.joint_vector({"LShoulderPitch": 0.3, "LShoulderRoll": 0.4, "LElbowRoll": -0.6})


@pytest.fixture(scope="module")
def checks():
    return Checks(PEPPER, TABLE)


def splines(count, seed=0):
    """Splines of one arm from the front of the robot, some clear and some not."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        points = np.tile(MIDDLE, (4, 1))
        points[:, ARM] += rng.uniform(-0.35, 0.35, (4, len(ARM)))
        points = np.clip(points, PEPPER.lower_limits + 0.05, PEPPER.upper_limits - 0.05)
        yield as_cubic_path(PEPPER, points)


def dense(spline, step):
    """States of a spline between which no point of the body moves farther than a step."""
    found = []
    for i, h in enumerate(np.diff(spline.breaks)):
        coarse = spline.at(np.full(40, i), np.linspace(0, h, 40))
        count = int(np.ceil((np.abs(np.diff(coarse, axis=0)) @ REACH).sum() / step)) + 1
        found.append(spline.at(np.full(count, i), np.linspace(0, h, count)))
    return np.concatenate(found)


@pytest.mark.parametrize("margins", [(0.005, 0.0006), (0.0, 0.0), (0.006, 0.0015)])
def test_what_is_clear_is_clear_by_coal_at_half_a_millimeter(checks, margins):
    coal = pk.collision.CollisionChecker(PEPPER, TABLE)
    wide = pk.collision.CollisionChecker(PEPPER, TABLE, margins[0] + 0.002, margins[1] + 0.002)
    verdicts = []
    for spline in splines(14):
        clear = is_clear_along(checks, spline, margins, motion=(MIDDLE, ARM))
        states = dense(spline, SHORTEST * 4)
        if clear:
            assert not coal.in_collision(dense(spline, SHORTEST)).any()
            assert checks.holds(states).all()
        elif checks.holds(states).all():
            assert wide.in_collision(states).any()
        verdicts.append(clear)
    assert 2 <= sum(verdicts) <= 12


def test_a_thin_pin_between_coarse_steps_is_found(checks):
    """A pin that only half a millimeter of the way touches: no margin, so that only close steps see it."""
    spline = next(splines(1, seed=3))
    middle = spline.at(np.array([1]), np.diff(spline.breaks)[1:2] / 2)[0]
    tip = frame_pose(PEPPER, middle, "LArm_effector")[:3, 3]
    free = Checks(PEPPER, pk.Scene())
    assert is_clear_along(free, spline, motion=(MIDDLE, ARM))
    pinned = Checks(PEPPER, pk.Scene().add_sphere("pin", 5e-4, tip))
    assert not is_clear_along(pinned, spline, motion=(MIDDLE, ARM))


SLIDER = """<robot name="slider">
  <link name="rail"/>
  <link name="block">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin rpy="0 0 0.785398163"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="rail"/><child link="block"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1000" velocity="1"/>
  </joint>
</robot>"""


def test_an_edge_that_passes_an_edge_within_a_tenth_of_a_millimeter_is_found(tmp_path):
    """Edges overlap by 40 um, on 80 um of the way: states half a millimeter apart mostly miss that."""
    (tmp_path / "slider.urdf").write_text(SLIDER)
    robot = pk.load_robot(tmp_path / "slider.urdf")
    spline = as_cubic_path(robot, np.linspace(-0.2, 0.2, 5)[:, None])
    diagonal = np.sqrt(0.02)
    for place in np.arange(12) * 43e-6:
        for apart, clear in ((-4e-5, False), (4e-5, True)):
            position = (place, diagonal + apart, 0.0)
            scene = pk.Scene().add_box("other", (0.1, 0.1, 0.1), position, (0.0, 0.0, np.pi / 4))
            coal = pk.collision.CollisionChecker(robot, scene)
            assert coal.in_collision(np.array([[place]]))[0] != clear
            assert is_clear_along(Checks(robot, scene), spline) == clear


def test_no_point_of_the_hand_moves_farther_than_a_step_between_stations():
    spline = next(splines(1))
    segments = np.array(spline.breaks), np.array(spline.coefficients, order="C")
    parts = cut(*segments, REACH, 0.008)
    segment, begin, width = parts
    assert width.sum() == pytest.approx(spline.breaks[-1])
    ends = [spline.at(segment, begin + share * width) for share in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(ends[0][1:], ends[2][:-1], atol=1e-9)
    for frame in ("LArm_effector", "l_gripper"):
        a, b, c = (frame_pose(PEPPER, q, frame)[:, :3, 3] for q in ends)
        assert np.linalg.norm(c - a, axis=1).max() <= 0.008
        assert np.linalg.norm(b - a, axis=1).max() <= 0.004


@pytest.mark.parametrize("segments", [4, 6, 13])
def test_rounded_waypoints_are_those_of_scipys_b_spline(segments):
    rng = np.random.default_rng(1)
    points = rng.normal(size=(5, 3))
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    breaks = np.linspace(0, lengths[-1], segments + 1)
    knots = np.concatenate([breaks[:1].repeat(3), breaks, breaks[-1:].repeat(3)])
    greville = np.array([knots[i + 1 : i + 4].mean() for i in range(segments + 3)])
    control = np.stack([np.interp(greville, lengths, column) for column in points.T], axis=1)
    expected = BSpline(knots, control, 3)(breaks)
    np.testing.assert_allclose(rounded_waypoints(Path(points), segments), expected, atol=1e-12)


def test_goals_meet_their_tasks_differ_and_are_clear(checks):
    start, target = PEPPER.posture("Stand"), (0.36, 0.2, 0.85)
    tasks = [pk.ik.HandPosition("left", target), pk.ik.LookAt(target)]
    goals, ik, kept = clear_goals(checks, start, tasks, None, 0.01, 3, 5.0)
    assert kept == checks.margins(start, goals, np.arange(PEPPER.n), 0.01)
    assert 1 <= len(goals) <= 4
    for task in tasks:
        assert all(task.error(PEPPER, q) <= task.tolerance for q in goals)
    coal = pk.collision.CollisionChecker(PEPPER, TABLE, 0.01)
    assert not coal.in_collision(goals).any()
    apart = np.abs(goals[:, None] - goals).max(axis=2) + np.eye(len(goals))
    assert apart.min() >= APART
    assert ik.success
    np.testing.assert_array_equal(ik.q, goals[0])
    nearest = pk.collision.clearance(PEPPER, goals[0], TABLE)
    assert min(ik.clearance.itself, ik.clearance.obstacles) == pytest.approx(nearest)
    again = clear_goals(checks, start, tasks, None, 0.01, 3, 5.0)
    np.testing.assert_array_equal(goals, again.goals)


def test_an_idle_arm_goes_out_of_the_way():
    """The right hand crosses to where the left one hangs: it has to move."""
    start, target = PEPPER.posture("Stand"), (0.318, -0.032, 0.803)
    tasks = [pk.ik.HandPosition("right", target), pk.ik.LookAt(target)]
    free = Checks(PEPPER, pk.Scene())
    goals, ik, _ = clear_goals(free, start, tasks, None, 0.01, 0, 5.0)
    for task in tasks:
        assert all(task.error(PEPPER, q) <= task.tolerance for q in goals)
    assert not pk.collision.CollisionChecker(PEPPER, pk.Scene()).in_collision(goals).any()
    assert ik.success
    arm = [PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")]
    assert np.abs(goals - start)[:, arm].max(axis=1).min() > 0.01
    still = [name for name in PEPPER.joint_names if name not in PEPPER.joint_group("left_arm")]
    found = clear_goals(free, start, tasks, still, 0.01, 0, 5.0)
    assert found is None or (found.goals[:, arm] == start[arm]).all()
    again = clear_goals(free, start, tasks, None, 0.01, 0, 5.0)
    np.testing.assert_array_equal(goals, again.goals)


def test_goals_of_a_group_leave_other_joints_alone(checks):
    start = PEPPER.posture("Stand")
    tasks = [pk.ik.HandPosition("left", (0.28, 0.35, 0.85))]
    goals, *_ = clear_goals(checks, start, tasks, "left_arm", 0.01, 0, 5.0)
    others = [k for k, name in enumerate(PEPPER.joint_names) if name not in PEPPER.joint_group("left_arm")]
    np.testing.assert_array_equal(goals[:, others], np.tile(start[others], (len(goals), 1)))


def test_no_goals_out_of_reach(checks):
    tasks = [pk.ik.HandPosition("left", (2.0, 0.2, 0.85))]
    assert clear_goals(checks, PEPPER.posture("Stand"), tasks, None, 0.01, 0, 5.0) is None
