import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.motion import Cost, OptimizedStatus, optimize
from pepper_kin.motion.optimization.cost import figures_of

TABLE = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
PARTS = ("position", "velocity", "acceleration", "torque", "velocity_continuity", "self_clearance")


@pytest.fixture(scope="module")
def over_the_table():
    """A whole-body plan from hanging arms to both hands above the table, and the motion made of it."""
    pepper = pk.load_pepper().with_requirements("limits")
    goal = pepper.joint_vector(
        {
            "LShoulderPitch": 0.4, "LShoulderRoll": 0.1, "LElbowRoll": -0.9, "LElbowYaw": -1.2,
            "LWristYaw": -0.5, "RShoulderPitch": 0.5, "RShoulderRoll": -0.2, "RElbowRoll": 0.8,
            "RElbowYaw": 1.1, "RWristYaw": 0.6, "HipPitch": -0.3, "KneePitch": 0.1, "HipRoll": 0.05,
            "HeadYaw": 0.5, "HeadPitch": 0.2,
        }
    )  # fmt: skip
    plan = pk.plan(pepper, pepper.posture("Stand"), goal, TABLE, seed=1)
    assert plan.success, plan.message
    return pepper, plan, optimize(pepper, plan, TABLE)


def test_motion_is_shorter_or_smoother_and_its_certificate_is_green(over_the_table):
    pepper, plan, found = over_the_table
    assert found.status is OptimizedStatus.IMPROVED, found.message
    np.testing.assert_allclose(found.trajectory.start, plan.path[0], atol=1e-12)
    np.testing.assert_allclose(found.trajectory.end, plan.path[-1], atol=1e-9)
    assert np.ptp(plan.path, axis=0).min() > 0  # all fifteen joints move
    assert max(found.shorter_by, found.smoother_by) > 0.1
    certificate = found.trajectory.check(pepper, TABLE)
    for part in PARTS:
        check = getattr(certificate, part)
        assert check.success, check.sentence()
    assert found.clearance.obstacles == pytest.approx(certificate.obstacle_clearance.value, abs=2e-6)


def test_accelerations_are_continuous_and_vanish_at_the_ends(over_the_table):
    _, _, found = over_the_table
    motion = found.trajectory
    steps = np.diff(motion.knots)
    segments = np.arange(steps.size)
    ends = motion.at_segments(segments, steps).acceleration
    starts = motion.at_segments(segments, 0 * steps).acceleration
    np.testing.assert_allclose(ends[:-1], starts[1:], atol=1e-7)
    np.testing.assert_allclose([starts[0], ends[-1]], 0.0, atol=1e-7)


@pytest.mark.parametrize("seed", [2, 5])
def test_more_intervals_are_tried_where_few_come_too_near_between_samples(over_the_table, seed):
    pepper, plan, _ = over_the_table
    other = pk.plan(pepper, plan.path[0], plan.path[-1], TABLE, seed=seed)
    found = optimize(pepper, other, TABLE, intervals=4)
    assert found.status is OptimizedStatus.IMPROVED, found.message
    assert len(found.trajectory.knots) > 5
    certificate = found.trajectory.check(pepper, TABLE)
    for part in PARTS:
        assert getattr(certificate, part).success, getattr(certificate, part).sentence()


def test_figures_are_those_of_the_trajectories(over_the_table):
    pepper, _, found = over_the_table
    assert found.figures == figures_of(pepper, found.trajectory)
    assert found.figures_before == figures_of(pepper, found.before)
    assert found.figures.cost(found.cost) < found.figures_before.cost(found.cost)
    assert f"{found.trajectory.duration:.3f} s" in found.report()


def test_jerk_is_measured_right():
    """q = d s^3 (10 - 15 s + 6 s^2) has the squared jerk 720 d^2 / T^5."""
    pepper = pk.load_pepper().with_requirements("limits")
    stand = pepper.posture("Stand")
    goal = stand.copy()
    goal[3] += 0.8
    still = np.zeros((2, pepper.n))
    samples = pk.trajectory.Samples(pepper.joint_names, [0.0, 2.0], [stand, goal], still, still)
    expected = 720 * 0.8**2 / 2**5 / pepper.acceleration_limits[3] ** 2
    assert figures_of(pepper, samples.to_trajectory()).jerk == pytest.approx(expected, rel=0.02)


def test_same_input_same_motion(over_the_table):
    pepper, plan, found = over_the_table
    again = optimize(pepper, plan.path, TABLE)
    np.testing.assert_array_equal(again.trajectory.coefficients, found.trajectory.coefficients)


def test_more_weight_on_jerk_is_smoother_and_longer(over_the_table):
    pepper, plan, found = over_the_table
    soft_cost = optimize(pepper, plan, TABLE, cost=Cost(jerk=3e-3))
    assert soft_cost.success, soft_cost.message
    assert soft_cost.figures.jerk < 0.8 * found.figures.jerk
    assert soft_cost.figures.duration > found.figures.duration


def test_wanted_duration_is_met_with_less_effort(over_the_table):
    pepper, plan, _ = over_the_table
    wanted = 2.0
    lazy, smooth = (
        optimize(pepper, plan, TABLE, duration=wanted, cost=cost)
        for cost in (Cost(time=0, jerk=1e-6, effort=1.0), Cost(time=0, jerk=1.0))
    )
    for found in (lazy, smooth):
        assert found.success, found.message
        assert found.trajectory.duration == pytest.approx(wanted, rel=1e-3)
    assert lazy.figures.effort < smooth.figures.effort
    assert smooth.figures.jerk < lazy.figures.jerk


def test_closeness_costs(over_the_table):
    pepper, plan, found = over_the_table
    careful = optimize(pepper, plan, TABLE, cost=Cost(clearance=3.0))
    assert careful.success, careful.message
    times = np.linspace(0, 1, 60)

    def mean_clearance(motion):
        states = motion(times * motion.duration).position
        return np.minimum(pk.collision.clearance(pepper, states, TABLE), 0.08).mean()

    assert mean_clearance(careful.trajectory) > mean_clearance(found.trajectory)


def test_scales_of_limits_are_kept(over_the_table):
    pepper, plan, found = over_the_table
    slow = optimize(pepper, plan, TABLE, velocity_scale=0.5, acceleration_scale=0.5)
    assert slow.success, slow.message
    assert slow.trajectory.duration > 1.2 * found.trajectory.duration
    state = slow.trajectory(np.linspace(0, slow.trajectory.duration, 2000))
    assert np.all(np.abs(state.velocity) <= 0.5 * pepper.velocity_limits)
    assert np.all(np.abs(state.acceleration) <= 0.5 * pepper.acceleration_limits)


def test_balance_is_kept_where_asked(over_the_table):
    pepper, plan, _ = over_the_table
    found = optimize(pepper, plan, TABLE, balance=0.005, max_iterations=80)
    assert found.success, found.message
    check = found.trajectory.check(pepper, TABLE)
    assert check.balance.success, check.balance.sentence()
    assert check.balance.value >= 0.005 - 1e-3
    assert check.obstacle_clearance.success


def test_joints_that_stand_still_in_the_path_stay_still():
    pepper = pk.load_pepper().with_requirements("limits")
    stand = pepper.posture("Stand")
    found = optimize(pepper, [stand, pepper.joint_vector({"HeadYaw": 1.0})])
    assert found.figures.duration < 1.1 * found.figures_before.duration
    others = np.arange(pepper.n) != pepper.joint_index("HeadYaw")
    np.testing.assert_array_equal(found.trajectory.coefficients[:, 1:, others], 0.0)
    np.testing.assert_array_equal(found.trajectory.coefficients[0, 0, others], stand[others])


def test_straight_line_through_an_obstacle_is_never_returned_as_improved():
    pepper = pk.load_pepper().with_requirements("limits")
    goal = pepper.joint_vector({"LShoulderPitch": 0.4, "LElbowRoll": -0.9, "LElbowYaw": -1.2})
    straight = np.stack([pepper.posture("Stand"), goal])
    dense = straight[0] + np.linspace(0, 1, 100)[:, None] * (straight[1] - straight[0])
    assert pk.collision.in_collision(pepper, dense, TABLE).any()
    found = optimize(pepper, straight, TABLE)
    if found.success:
        assert found.trajectory.check(pepper, TABLE).obstacle_clearance.success
    else:
        assert found.trajectory is found.before
        assert found.report()


def test_straight_line_that_grazes_an_obstacle_is_repaired():
    """A ball beside the way of the left hand: the search leaves it, though that costs some time."""
    pepper = pk.load_pepper().with_requirements("limits")
    arm = {"LShoulderRoll": 0.3, "LElbowRoll": -0.1}
    start, goal = (pepper.joint_vector({**arm, "LShoulderPitch": pitch}) for pitch in (1.3, 0.1))
    middle = pepper.joint_vector({**arm, "LShoulderPitch": 0.7})
    hand = pk.kinematics.frame_pose(pepper, middle, "LArm_effector")[:3, 3]
    scene = pk.Scene().add_sphere("ball", 0.04, hand + np.array([0.0, -0.06, 0.0]))
    ends = np.stack([start, goal])
    ends[1, pepper.joint_index("LShoulderRoll")] += 0.02  # lets the joint move
    straight = ends[0] + np.linspace(0, 1, 200)[:, None] * (ends[1] - ends[0])
    assert pk.collision.in_collision(pepper, straight, scene).any()
    found = optimize(pepper, ends, scene)
    assert found.success, found.message
    assert not found.before.check(pepper, scene).obstacle_clearance.success
    at_start = float(pk.collision.clearance(pepper, start, scene))  # the other wrist is near the pelvis
    assert found.trajectory.check(pepper, scene).obstacle_clearance.value >= min(0.005, 0.9 * at_start) > 0


def test_too_short_a_duration_gives_the_motion_before(over_the_table):
    pepper, plan, _ = over_the_table
    found = optimize(pepper, plan, TABLE, duration=0.05)
    assert found.status is OptimizedStatus.NO_ROOM
    assert found.trajectory is found.before
    assert "No motion of 0.05 s near the path keeps all limits." in found.message
    before = found.before.check(pepper, TABLE)
    assert found.clearance.obstacles == pytest.approx(before.obstacle_clearance.value, abs=2e-6)


def test_a_motion_that_is_given_is_slowed_to_the_scales_asked_for(over_the_table):
    """What came back, where nothing was gained, was the motion as given: twice as fast as asked."""
    pepper, plan, _ = over_the_table
    fast = pk.retime(pepper, plan)
    found = optimize(
        pepper, fast, TABLE, duration=0.05, velocity_scale=0.5, acceleration_scale=0.4, torque_scale=0.9
    )
    assert found.trajectory is found.before
    assert found.before.duration > fast.duration
    at = found.trajectory(np.linspace(0.0, found.trajectory.duration, 20_001))
    assert np.all(np.abs(at.velocity) <= 0.5 * pepper.velocity_limits * (1 + 1e-9))
    assert np.all(np.abs(at.acceleration) <= 0.4 * pepper.acceleration_limits * (1 + 1e-9))
    torque = np.abs(pk.dynamics.inverse_dynamics(pepper, *at))
    assert np.all(torque <= 0.9 * pepper.effort_limits * (1 + 1e-3))


def test_misuse_is_named(over_the_table):
    pepper, plan, _ = over_the_table
    with pytest.raises(InvalidValueError, match="solver: got 'magic', expected one of 'newton'"):
        optimize(pepper, plan, TABLE, solver="magic")
    with pytest.raises(InvalidValueError, match=r"jerk: got 10\.0, expected None with solver='ipopt'"):
        optimize(pepper, plan, TABLE, jerk=10.0, solver="ipopt")
    with pytest.raises(InvalidValueError, match="margin: got nan"):
        optimize(pepper, plan, TABLE, margin=float("nan"))
    with pytest.raises(InvalidValueError, match="duration: got -1"):
        optimize(pepper, plan, TABLE, duration=-1)
    with pytest.raises(InvalidValueError, match="torque_scale: got 2"):
        optimize(pepper, plan, TABLE, torque_scale=2)
    with pytest.raises(InvalidValueError, match="weight of jerk: got -1"):
        Cost(jerk=-1)
    with pytest.raises(InvalidValueError, match="weights: got 0 for all"):
        Cost(time=0, jerk=0)
    far = np.stack([plan.path[0], plan.path[0] + 5.0])
    with pytest.raises(LimitError):
        optimize(pepper, far, TABLE)
    failed = pk.plan(pepper, pepper.joint_vector({"HipRoll": 0.5}), plan.path[0])
    with pytest.raises(InvalidValueError, match="a plan that is start_in_collision"):
        optimize(pepper, failed)


def test_what_cannot_be_kept_is_named(over_the_table):
    pepper, plan, _ = over_the_table
    short = optimize(pepper, plan.path[[0, -1]], duration=0.05)
    names = [name for name in pepper.joint_names if f"limit of {name} by" in short.message]
    assert len(names) == 1
    assert "It breaks the acceleration limit of" in short.message
    needed = (
        np.abs(plan.path[-1] - plan.path[0]) / pepper.acceleration_limits
    )  # of a straight line, in T^2 / 4
    assert needed[pepper.joint_index(names[0])] > 0.5 * needed.max()
    weak = optimize(pepper, plan, TABLE, jerk=1e-9)  # a thousand times the duration
    assert weak.status is OptimizedStatus.NO_ROOM
    assert "It breaks the jerk limit of" in weak.message


def test_limits_of_jerk_hold_at_every_time(over_the_table):
    pepper, plan, found = over_the_table
    limited = optimize(pepper, plan, TABLE, jerk="moderate", cost=Cost(jerk=1e-6))
    assert limited.success, limited.message
    certificate = limited.trajectory.check(pepper, TABLE, jerk="moderate")
    for part in ("jerk", "acceleration_continuity", "acceleration", "torque", "self_clearance"):
        assert getattr(certificate, part).success, getattr(certificate, part).sentence()
    free = found.trajectory.check(pepper, TABLE, jerk="moderate")
    assert not free.jerk.success
    retimed = pk.retime(pepper, plan, jerk="moderate")
    assert limited.trajectory.duration < 1.02 * retimed.duration


def test_other_starts_go_round_what_the_straight_line_hits():
    """A board stands across the straight line; by some other posture there is a way."""
    pepper = pk.load_pepper().with_requirements("limits")
    arm = {"LShoulderRoll": 0.3, "LElbowRoll": -0.1}
    start, goal = (pepper.joint_vector({**arm, "LShoulderPitch": pitch}) for pitch in (1.3, 0.1))
    goal[pepper.joint_index("LShoulderRoll")] += 0.02
    goal[pepper.joint_index("LElbowRoll")] -= 0.02
    hand = pk.kinematics.frame_pose(
        pepper, pepper.joint_vector({**arm, "LShoulderPitch": 0.7}), "LArm_effector"
    )[:3, 3]
    scene = pk.Scene().add_box("board", (0.2, 0.12, 0.06), hand)
    ends = np.stack([start, goal])
    one = optimize(pepper, ends, scene)
    many = optimize(pepper, ends, scene, starts=12)
    assert many.success, many.message
    assert many.trajectory.check(pepper, scene).obstacle_clearance.success
    np.testing.assert_allclose(many.trajectory.end, goal, atol=1e-9)
    assert not one.success or many.descent.cost <= one.descent.cost
    again = optimize(pepper, ends, scene, starts=12)
    np.testing.assert_array_equal(again.trajectory.coefficients, many.trajectory.coefficients)
    with pytest.raises(InvalidValueError, match="starts: got 0"):
        optimize(pepper, ends, scene, starts=0)


def test_a_robot_without_bodies_is_optimized():
    """Nothing can touch anything there."""
    robot = pk.load_robot(
        """<robot name="bare"><link name="base"/>
        <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
          <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
          <limit lower="-3" upper="3" effort="30" velocity="2" acceleration="5"/></joint></robot>"""
    )
    found = optimize(robot, [[0.0], [1.0]], cost=Cost(jerk=1e-3))
    assert found.success, found.report()
    assert found.clearance.least == np.inf
    assert found.trajectory.check(robot).success
