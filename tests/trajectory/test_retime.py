"""Timing along paths: closed forms, toppra itself as oracle, limits at 1 kHz, refusals."""

import itertools
import logging

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.arrays import read_only
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError
from pepper_kin.trajectory import retime
from pepper_kin.trajectory.path import CubicPath, as_cubic_path

ONE_JOINT = """
<robot name="one">
  <link name="world"/>
  <link name="arm"><inertial><origin xyz="0.4 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="{axis}"/>
    <limit lower="-3" upper="3" velocity="{velocity}" acceleration="{acceleration}" effort="{effort}"/>
  </joint></robot>"""
INERTIA = 0.01 + 2 * 0.4**2
WEIGHT = 2 * 9.81 * 0.4  # gravity torque of the arm stretched out


def one_joint(axis="0 0 1", velocity="1000", acceleration="5", effort="1e6"):
    return pk.load_robot(
        ONE_JOINT.format(axis=axis, velocity=velocity, acceleration=acceleration, effort=effort)
    )


def random_waypoints(pepper, seed, count=5, share=0.25):
    """Waypoints away from the limits, the legs near upright where torque limits can hold the body."""
    rng = np.random.default_rng(seed)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = share * lower[:3], share * upper[:3]
    return rng.uniform(lower, upper, (count, pepper.n))


@pytest.mark.parametrize("distance", [1e-6, 1e-3, 0.1, 1.0, 2.9])
def test_one_joint_is_bang_bang(distance):
    robot = one_joint()
    trajectory = retime(robot, [[0.0], [distance]])
    assert trajectory.duration == pytest.approx(2 * np.sqrt(distance / 5), rel=1e-3)
    np.testing.assert_allclose(trajectory.end, [distance], rtol=1e-12)


def test_one_joint_with_cruising_speed():
    trajectory = retime(one_joint(velocity="2"), [[-1.5], [1.5]])
    assert trajectory.duration == pytest.approx(3 / 2 + 2 / 5, rel=1e-3)


def test_scales_act_on_their_limits():
    robot = one_joint()
    slow = retime(robot, [[0.0], [1.0]], acceleration_scale=0.25)
    assert slow.duration == pytest.approx(2 * np.sqrt(1 / 1.25), rel=1e-3)
    cruise = retime(one_joint(velocity="2"), [[-1.5], [1.5]], velocity_scale=0.5)
    assert cruise.duration == pytest.approx(3 + 1 / 5, rel=1e-3)


def test_torque_alone_limits_a_horizontal_arm():
    robot = one_joint(acceleration="1e9", effort="3")
    trajectory = retime(robot, [[0.0], [1.0]])
    assert trajectory.duration == pytest.approx(2 * np.sqrt(INERTIA / 3), rel=1e-3)
    half = retime(robot, [[0.0], [1.0]], torque_scale=0.5)
    assert half.duration == pytest.approx(2 * np.sqrt(INERTIA / 1.5), rel=1e-3)


def test_torque_against_gravity_agrees_with_a_phase_plane_integral():
    """I a = u - W cos q up with torque u, braking with -u: v dv = a dq gives both speeds in closed form."""
    effort = 12.0
    robot = one_joint(axis="0 -1 0", acceleration="1e9", effort=str(effort))
    q = np.linspace(0.0, 2.0, 400_001)
    up = 2 * (effort * q - WEIGHT * np.sin(q)) / INERTIA
    down = 2 * (effort * (2 - q) + WEIGHT * (np.sin(2.0) - np.sin(q))) / INERTIA
    speed = np.sqrt(np.maximum(np.minimum(up, down), 0))
    middle = 2 * np.diff(q) / (speed[1:] + speed[:-1])
    duration = float(middle.sum())
    trajectory = retime(robot, [[0.0], [2.0]], gridpoints=400)
    assert trajectory.duration == pytest.approx(duration, rel=1e-3)
    relaxed = retime(robot, [[0.0], [2.0]], torque=False, gridpoints=400)
    assert relaxed.duration < 0.5 * duration


@pytest.mark.parametrize("seed", range(30))
def test_limits_hold_at_every_millisecond(pepper, seed):
    trajectory = retime(pepper, random_waypoints(pepper, seed))
    at = trajectory.sample(0.001)
    torque = pk.dynamics.inverse_dynamics(pepper, at.position, at.velocity, at.acceleration)
    assert np.all(at.position >= pepper.lower_limits - 1e-9)
    assert np.all(at.position <= pepper.upper_limits + 1e-9)
    assert np.all(np.abs(at.velocity) <= pepper.velocity_limits * (1 + 1e-8))
    assert np.all(np.abs(at.acceleration) <= pepper.acceleration_limits * (1 + 1e-8))
    assert np.all(np.abs(torque) <= pepper.effort_limits * (1 + 1e-8))
    assert np.abs(at.velocity[[0, -1]]).max() < 1e-9
    step = np.diff(trajectory.knots)
    ends = trajectory.at_segments(np.arange(step.size - 1), step[:-1])
    starts = trajectory.at_segments(np.arange(1, step.size), 0.0)
    np.testing.assert_allclose(ends.position, starts.position, atol=1e-10)
    np.testing.assert_allclose(ends.velocity, starts.velocity, atol=1e-8)


@pytest.mark.parametrize("seed", range(6))
def test_duration_agrees_with_toppra_used_directly(pepper, seed):
    import toppra
    from toppra.constraint import DiscretizationType, SecondOrderConstraint

    toppra.setup_logging("ERROR")
    logging.getLogger("toppra").setLevel(logging.ERROR)
    curve = as_cubic_path(pepper, random_waypoints(pepper, 100 + seed))
    breaks = curve.breaks
    from scipy.interpolate import PPoly

    spline = PPoly(np.moveaxis(curve.coefficients[:, ::-1], 1, 0), breaks)

    class Geometry(toppra.interpolator.AbstractGeometricPath):
        dof = pepper.n
        path_interval = (breaks[0], breaks[-1])

        def __call__(self, s, order=0):
            return spline(s, order)

    def inverse_dynamics(q, v, a):
        return pk.dynamics.inverse_dynamics(pepper, q, v, a)

    both = np.stack([-pepper.effort_limits, pepper.effort_limits], axis=1)
    constraints = [
        toppra.constraint.JointVelocityConstraint(pepper.velocity_limits),
        toppra.constraint.JointAccelerationConstraint(pepper.acceleration_limits),
        SecondOrderConstraint.joint_torque_constraint(
            inverse_dynamics, both, np.zeros(pepper.n), discretization_scheme=DiscretizationType.Interpolation
        ),
    ]
    segments = [np.linspace(a, b, 60) for a, b in itertools.pairwise(breaks)]
    grid = np.unique(np.concatenate(segments))
    grid[-1] = breaks[-1]
    solver = toppra.algorithm.TOPPRA(
        constraints,
        Geometry(),
        gridpoints=grid,
        parametrizer="ParametrizeConstAccel",
        solver_wrapper="seidel",
    )
    theirs = solver.compute_trajectory().duration
    assert retime(pepper, curve, gridpoints=60 * len(segments)).duration == pytest.approx(theirs, rel=2e-3)


def test_positions_lie_on_the_path(pepper):
    curve = as_cubic_path(pepper, random_waypoints(pepper, 7))
    trajectory = retime(pepper, curve)
    q = trajectory(np.linspace(0, trajectory.duration, 50)).position
    segments = np.arange(curve.breaks.size - 1).repeat(2000)
    local = (np.diff(curve.breaks)[:, None] * np.linspace(0, 1, 2000)).ravel()
    dense = curve.at(segments, local)
    speed = np.linalg.norm(np.diff(dense, axis=0), axis=1).max()
    nearest = [np.linalg.norm(dense - point, axis=1).min() for point in q]
    assert max(nearest) <= speed / 2 + 1e-12


def test_waypoints_are_met_and_two_give_a_straight_line(pepper):
    points = random_waypoints(pepper, 11)
    curve = as_cubic_path(pepper, points)
    first = np.arange(0, curve.breaks.size - 1, (curve.breaks.size - 1) // 4)
    np.testing.assert_allclose(curve.at(first, 0.0), points[:-1], atol=1e-12)
    trajectory = retime(pepper, points[:2])
    share = (trajectory(0.3 * trajectory.duration).position - points[0]) / (points[1] - points[0])
    np.testing.assert_allclose(share, share[0], rtol=1e-9)


def test_spline_of_waypoints_has_a_continuous_second_derivative(pepper):
    middle = (pepper.lower_limits + pepper.upper_limits) / 2
    points = middle + 0.3 * (random_waypoints(pepper, 5, count=7) - middle)
    curve = as_cubic_path(pepper, points)
    h = np.diff(curve.breaks)
    for derivative in range(3):
        np.testing.assert_allclose(
            curve.at(np.arange(5), h[:-1], derivative), curve.at(np.arange(1, 6), 0.0, derivative), atol=1e-9
        )


def test_waypoints_on_the_limits_do_not_overshoot(pepper):
    low = pepper.posture("Stand")
    joint = pepper.joint_index("LShoulderRoll")
    low[joint] = pepper.lower_limits[joint]
    high = low.copy()
    high[joint] += 1.0
    trajectory = retime(pepper, [low, high, low, low + 0.2 * (np.arange(pepper.n) == 4), high])
    position = trajectory.sample(0.001).position[:, joint]
    assert position.min() >= pepper.lower_limits[joint] - 1e-9
    assert trajectory.check(pepper, collisions=False).acceleration.success


@pytest.mark.parametrize("seed", range(4))
def test_joints_with_way_points_on_their_limits_are_monotone_and_smooth(pepper, seed):
    """Where the spline would leave the limits: between waypoints no turn, and two derivatives that meet."""
    rng = np.random.default_rng(seed)
    points = random_waypoints(pepper, seed)
    joint = pepper.joint_index("LShoulderRoll")
    low, high = pepper.lower_limits[joint], pepper.upper_limits[joint]
    points[:, joint] = np.where(rng.uniform(size=len(points)) < 0.5, low, rng.uniform(low, high, len(points)))
    points[1, joint] = points[2, joint] = low
    curve = as_cubic_path(pepper, points)
    h = np.diff(curve.breaks)
    assert h.size == 3 * (len(points) - 1)
    segments = np.arange(h.size)
    np.testing.assert_allclose(curve.at(segments[::3], 0 * h[::3]), points[:-1], atol=1e-12)
    np.testing.assert_allclose(curve.at(segments[-1:], h[-1:]), points[-1:], atol=1e-9)
    for derivative in range(3):
        ends, starts = (
            curve.at(segments[:-1], h[:-1], derivative),
            curve.at(segments[1:], 0 * h[1:], derivative),
        )
        np.testing.assert_allclose(ends, starts, atol=1e-9)
    speed = curve.at(segments[:, None], np.linspace(0, 1, 30) * h[:, None], 1)[..., joint].reshape(-1, 90)
    way = np.sign(np.diff(points[:, joint]))[:, None]
    assert np.all(speed * way >= -1e-12)
    assert np.all(speed[way[:, 0] == 0] == 0)


@pytest.mark.parametrize("base", ["planar"])
def test_joints_in_meters_keep_their_unit(base):
    robot = pk.load_pepper(base=base)
    goal = robot.posture("Stand")
    goal[0] += 0.05
    trajectory = retime(robot, [robot.posture("Stand"), goal])
    assert trajectory.joint_units[0] == "m"


def test_mimic_hands_are_timed_too():
    robot = pk.load_pepper(hands="mimic")
    goal = robot.posture("Stand")
    goal[robot.joint_index("LHand")] = 0.9
    goal[robot.joint_index("LElbowRoll")] -= 0.3
    trajectory = retime(robot, [robot.posture("Stand"), goal])
    at = trajectory.sample(0.001)
    torque = pk.dynamics.inverse_dynamics(robot, at.position, at.velocity, at.acceleration)
    assert np.all(np.abs(torque) <= robot.effort_limits * (1 + 1e-8))


def test_path_that_stops_at_a_cusp(pepper):
    """q'(s) vanishes where a path turns back on itself: the trajectory passes there with finite limits."""
    q = pepper.posture("Stand")
    step = 0.5 * (np.arange(pepper.n) == 3)
    out = np.array([q, 0 * q, -3 * step, 2 * step])[None]  # q' = 0 at its start
    back = CubicPath([0.0, 1.0], out)
    trajectory = retime(pepper, back)
    assert np.abs(trajectory.sample(0.001).acceleration / pepper.acceleration_limits).max() <= 1 + 1e-8


def test_refusals_name_what_is_wrong(pepper):
    q = pepper.posture("Stand")
    goal = q.copy()
    goal[5] -= 0.5
    outside = goal.copy()
    outside[3] = 5.0
    for points, error, message in [
        ([q], InvalidValueError, r"waypoints: got 1 waypoint\(s\), expected at least 2"),
        ([q, q], InvalidValueError, "a start that equals the goal"),
        ([q, goal, goal], InvalidValueError, "rows 1 and 2 are equal"),
        (q, InvalidValueError, r"waypoints: got shape \(15,\)"),
        ([q, goal * np.nan], InvalidValueError, "nan at joint KneePitch"),
        ([q[:4], goal[:4]], InvalidValueError, "one value per joint"),
        ([q, outside], LimitError, r"waypoint 1: HeadYaw = 5 rad is outside"),
    ]:
        with pytest.raises(error, match=message):
            retime(pepper, points)


def test_refused_options(pepper):
    q = pepper.posture("Stand")
    goal = q - 0.5 * (np.arange(pepper.n) == 5)
    for options, message in [
        ({"velocity_scale": 0}, "velocity_scale: got 0"),
        ({"acceleration_scale": 1.5}, r"acceleration_scale: got 1.5, expected a number in \(0, 1\]"),
        ({"torque_scale": float("nan")}, "torque_scale: got nan"),
        ({"gridpoints": 1}, "gridpoints: got 1"),
        ({"gridpoints": 10.5}, "gridpoints: got 10.5"),
        ({"solver": "magic"}, "solver: got 'magic', expected one of 'robot', 'fast', 'toppra'"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            retime(pepper, [q, goal], **options)


def test_curve_of_no_length_or_outside_is_refused(pepper):
    q = pepper.posture("Stand")
    still = np.zeros((1, 4, pepper.n))
    still[0, 0] = q
    with pytest.raises(InvalidValueError, match="path of zero length"):
        retime(pepper, CubicPath([0.0, 1.0], still))
    away = still.copy()
    away[0, 1:3, 3] = 9.0, -9.0  # the head turns 2.25 rad and back: its ends are inside
    with pytest.raises(LimitError, match=r"path: HeadYaw = 2.24"):
        retime(pepper, CubicPath([0.0, 1.0], away))
    with pytest.raises(InvalidValueError, match="3 joints, expected 15 joints"):
        retime(pepper, CubicPath([0.0, 1.0], still[..., :3]))
    jump = np.concatenate([still, still + 0.1])
    with pytest.raises(InvalidValueError, match=r"a jump of 0.1 at parameter 1, expected segments that meet"):
        CubicPath([0.0, 1.0, 2.0], jump)
    with pytest.raises(InvalidValueError, match="breaks of the path"):
        CubicPath([0.0, 0.0], still)


def test_torque_that_cannot_hold_is_named(pepper):
    q = pepper.posture("Stand")
    bent = q.copy()
    bent[:2] = -0.5, -1.03
    held = pk.dynamics.gravity_torque(pepper, bent)[0]
    assert abs(held) > 27.702
    with pytest.raises(InfeasibleError) as caught:
        retime(pepper, [q, bent])
    message = str(caught.value)
    assert "KneePitch needs" in message
    assert f"{held:.4g} N m to hold still against gravity 100% along the path" in message
    assert "its limit is 27.7 N m" in message
    assert retime(pepper, [q, bent], torque=False).duration > 0


def test_a_path_without_any_limit_is_refused():
    text = ONE_JOINT.format(axis="0 0 1", velocity=2, acceleration=0, effort=0).replace(
        "revolute", "continuous"
    )
    start, end = text.index("<limit"), text.index("</joint>")
    with pytest.raises(InvalidValueError, match="no finite velocity, acceleration or torque limit"):
        retime(pk.load_robot(text[:start] + text[end:]), [[0.0], [1.0]], acceleration_limits=np.inf)
    only_velocity = pk.load_robot(text[:start] + '<limit velocity="2"/>' + text[end:])
    duration = retime(only_velocity, [[0.0], [1.0]], acceleration_limits=np.inf).duration
    assert duration == pytest.approx(0.5, rel=0.05)


TWO_JOINTS = (
    one_joint()
    .urdf.replace('acceleration="5"', "")
    .replace(
        "</robot>",
        '<link name="tip"/><joint name="K" type="prismatic"><parent link="arm"/><child link="tip"/>'
        '<limit lower="0" upper="1" velocity="100" effort="1e6"/></joint></robot>',
    )
)


def test_missing_acceleration_limits_are_named_and_can_be_given():
    """As makers' URDFs are: a torque that would allow 3000 rad/s^2 is no word about acceleration."""
    robot = pk.load_robot(TWO_JOINTS)
    with pytest.raises(InvalidValueError, match="none for J, K, and the robot's description has none"):
        retime(robot, [[0.0, 0.0], [1.0, 0.5]])
    with pytest.raises(InvalidValueError, match=r"none for K, .* by joint name .* or in load_robot"):
        retime(robot, [[0.0, 0.0], [1.0, 0.5]], acceleration_limits={"J": 5.0})
    bang_bang = pytest.approx(2 * np.sqrt(1 / 5), rel=1e-3)
    assert retime(robot, [[0.0, 0.0], [1.0, 0.0]], acceleration_limits={"J": 5.0}).duration == bang_bang
    both = retime(robot, [[0.0, 0.0], [1.0, 0.5]], acceleration_limits={"J": 50.0, "K": 2.5})
    assert both.duration == bang_bang
    assert retime(robot, [[0.0, 0.0], [1.0, 0.5]], acceleration_limits=5.0).duration == bang_bang
    half = retime(robot, [[0.0, 0.0], [1.0, 0.5]], acceleration_limits=20.0, acceleration_scale=0.25)
    assert half.duration == bang_bang


def test_given_acceleration_limits_scale_the_limits_of_jerk():
    robot, path = pk.load_robot(TWO_JOINTS), [[0.0, 0.0], [1.0, 0.0]]
    limited = retime(robot, path, acceleration_limits=5.0, jerk="moderate")
    known = retime(one_joint(), [[0.0], [1.0]], jerk="moderate")
    assert limited.duration == pytest.approx(known.duration, rel=1e-4)  # the search ends at a gap
    with pytest.raises(pk.exceptions.UnknownNameError, match="unknown joint 'L'; available: J, K"):
        retime(robot, path, acceleration_limits={"L": 1.0})
    with pytest.raises(InvalidValueError, match=r"acceleration_limits of J: got -1\.0"):
        retime(robot, path, acceleration_limits={"J": -1.0})


def test_toppra_keeps_its_logging_level(pepper):
    logger = logging.getLogger("toppra")
    before = logger.level
    logger.setLevel(logging.INFO)
    try:
        retime(pepper, random_waypoints(pepper, 0))
        assert logger.level == logging.INFO
    finally:
        logger.setLevel(before)


def test_path_is_duck_typed(pepper):
    class Curve:
        def __init__(self, path):
            self.breaks, self.coefficients = path.breaks, path.coefficients

    curve = as_cubic_path(pepper, random_waypoints(pepper, 2))
    assert retime(pepper, Curve(curve)) == retime(pepper, curve)
    assert not read_only(curve.breaks).flags.writeable


def test_smooth_paths_of_the_planners_are_followed_exactly(pepper):
    from pepper_kin import planners

    points = random_waypoints(pepper, 21, count=3)
    box = planners.Problem(
        start=points[0],
        goals=points[-1:],
        lower=pepper.lower_limits,
        upper=pepper.upper_limits,
        validity=lambda q: np.ones(len(q), dtype=bool),
    )
    curve = planners.smooth(box, planners.Path(points))
    trajectory = retime(pepper, curve)
    assert trajectory.check(pepper, collisions=False).acceleration.success
    np.testing.assert_allclose(trajectory.start, curve.start, atol=1e-12)
    np.testing.assert_allclose(trajectory.end, curve.goal, atol=1e-9)
    dense = curve.sample(curve.length / 20_000)
    for q in trajectory(np.linspace(0, trajectory.duration, 20)).position:
        assert np.linalg.norm(dense - q, axis=1).min() < 1e-3


def test_the_motion_stops_at_kinks():
    """Along straight edges, which a spline would leave, it lasts as long as along each of them alone."""
    robot = one_joint()
    way = [0.0, 1.0, 0.4, 2.0]
    edges = np.zeros((3, 4, 1))
    edges[:, 0, 0], edges[:, 1, 0] = way[:-1], np.diff(way)
    trajectory = retime(robot, CubicPath(np.arange(4.0), edges))
    alone = [retime(robot, [[a], [b]]).duration for a, b in itertools.pairwise(way)]
    assert trajectory.duration == pytest.approx(sum(alone), rel=1e-9)
    for when, where in zip(np.cumsum(alone)[:-1], way[1:-1], strict=True):
        state = trajectory(when)
        assert state.position[0] == pytest.approx(where, abs=1e-9)
        assert state.velocity[0] == pytest.approx(0.0, abs=1e-6)
    assert trajectory.check(robot, collisions=False).success
    smooth = retime(robot, CubicPath(np.arange(4.0), edges), jerk="moderate")
    assert smooth.check(robot, jerk="moderate", collisions=False).success
