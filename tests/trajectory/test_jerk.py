"""Timing with jerk limits: closed forms, certificates, how far from the bound without jerk limits."""

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

import pepper_kin as pk
from pepper_kin.trajectory import retime
from pepper_kin.trajectory.limits import NAMED, jerk_limits
from pepper_kin.trajectory.path import as_cubic_path
from pepper_kin.trajectory.smooth_time import smooth_time

ONE_JOINT = """
<robot name="one">
  <link name="world"/>
  <link name="arm"><inertial><origin xyz="0.4 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="{velocity}" acceleration="{acceleration}" effort="1e6"/>
  </joint></robot>"""


def seven_segments(distance, velocity, acceleration, jerk):
    """Duration from rest to rest in closed form, by bisection on the peak velocity."""

    def rise(peak):
        time = peak / acceleration + acceleration / jerk
        return time if peak * jerk >= acceleration**2 else 2 * np.sqrt(peak / jerk)

    if velocity * rise(velocity) <= distance:
        return 2 * rise(velocity) + (distance - velocity * rise(velocity)) / velocity
    low, high = 0.0, velocity
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if middle * rise(middle) <= distance else (low, middle)
    return 2 * rise(low)


@pytest.mark.parametrize(
    ("velocity", "acceleration", "jerk", "distance"),
    [(1000, 5, 20, 1.0), (1000, 5, 100, 1.0), (2, 5, 50, 3.0), (1000, 1000, 50, 1.0), (2, 5, 15, 0.5)],
)
def test_one_joint_is_the_seven_segment_profile(velocity, acceleration, jerk, distance):
    robot = pk.load_robot(ONE_JOINT.format(velocity=velocity, acceleration=acceleration))
    trajectory = retime(robot, [[-distance / 2], [distance / 2]], jerk=[jerk])
    least = seven_segments(distance, velocity, acceleration, jerk)
    assert least * (1 - 1e-9) <= trajectory.duration <= 1.01 * least
    assert trajectory.check(robot, jerk=[jerk], collisions=False).success
    np.testing.assert_allclose(trajectory.end, [distance / 2], atol=1e-12)


@pytest.mark.parametrize(("name", "rise"), [("gentle", 1 / 5), ("moderate", 1 / 10), ("brisk", 1 / 30)])
@pytest.mark.parametrize("distance", [0.5, 1.6])
def test_a_named_limit_adds_the_same_time_to_short_motions_as_to_long_ones(pepper, name, rise, distance):
    """Ruckig's time-optimal motion, from rest to rest, is the oracle; a / j is the time of one rise."""
    joint, points = pepper.joint_index("HeadYaw"), np.array([pepper.posture("Stand")] * 2)
    points[1, joint] += distance
    without, limited = retime(pepper, points), retime(pepper, points, jerk=name)
    asked, optimum = InputParameter(1), Trajectory(1)
    asked.current_position, asked.target_position = [0.0], [distance]
    asked.max_velocity = [pepper.velocity_limits[joint]]
    asked.max_acceleration = [pepper.acceleration_limits[joint]]
    asked.max_jerk = [pepper.acceleration_limits[joint] / rise]
    Ruckig(1).calculate(asked, optimum)
    assert optimum.duration * (1 - 1e-9) <= limited.duration <= 1.01 * optimum.duration
    assert rise <= limited.duration - without.duration <= 1.25 * rise


def random_path(pepper, seed):
    rng = np.random.default_rng(seed)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    middle = (lower + upper) / 2
    return middle + 0.7 * (rng.uniform(lower, upper, (5, pepper.n)) - middle)


def test_a_joint_at_its_limit_does_not_make_the_motion_crawl(pepper):
    """The spline would carry RShoulderRoll out of its limits; what replaces it has no jump in it."""
    stand = pepper.posture("Stand")
    raised = pepper.joint_vector({"RShoulderPitch": -0.2, "RElbowRoll": 1.0, "HeadYaw": -0.4})
    aside = pepper.joint_vector({"RShoulderPitch": 0.3, "RShoulderRoll": -0.9, "HeadYaw": -0.9})
    points = [stand, raised, aside]
    assert np.diff(as_cubic_path(pepper, points).breaks).size == 6
    fastest = retime(pepper, points)
    for jerk, longer in (("brisk", 1.1), ("gentle", 1.6)):
        smooth = retime(pepper, points, jerk=jerk)
        assert smooth.check(pepper, jerk=jerk, collisions=False).success
        assert smooth.duration < longer * fastest.duration


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("jerk", ["gentle", "brisk"])
def test_certificates_are_green(pepper, seed, jerk):
    points = random_path(pepper, seed)
    fastest, smooth = retime(pepper, points), retime(pepper, points, jerk=jerk)
    found = smooth.check(pepper, jerk=jerk, collisions=False)
    assert set(found.failures) <= {"balance"}, found.report()
    assert {"jerk", "acceleration_continuity"} <= set(found.checks)
    assert fastest.duration < smooth.duration < fastest.duration * (1.6 if jerk == "gentle" else 1.2)
    assert found.jerk.use.max() > 0.95  # no time is given away
    assert "jerk" not in fastest.check(pepper, collisions=False).checks
    assert "acceleration_continuity" in fastest.check(pepper, jerk=jerk, collisions=False).failures
    ends = smooth(np.array([0.0, smooth.duration]))
    assert np.abs(ends.velocity).max() < 1e-8
    assert np.abs(ends.acceleration).max() < 1e-6


def test_jerk_joins_torque_balance_payload_and_hand_speed(pepper):
    options = {"balance": 0.01, "payload": {"left": 0.15}, "hand_speed": {"left": 0.5, "right": 0.5}}
    for seed in (1, 4):
        trajectory = retime(pepper, random_path(pepper, seed), jerk="moderate", **options)
        found = trajectory.check(pepper, jerk="moderate", collisions=False, **options)
        assert found.success, found.report()


def test_the_path_is_followed(pepper):
    points = random_path(pepper, 2)
    curve = as_cubic_path(pepper, points)
    trajectory = retime(pepper, points, jerk="moderate")
    segments = np.repeat(np.arange(4), 5000)
    dense = curve.at(segments, (np.diff(curve.breaks)[:, None] * np.linspace(0, 1, 5000)).ravel())
    for q in trajectory(np.linspace(0, trajectory.duration, 60)).position:
        assert np.linalg.norm(dense - q, axis=1).min() < 1e-3


def test_toppra_may_be_the_start(pepper):
    points = random_path(pepper, 3)
    ours, theirs = (retime(pepper, points, jerk="moderate", solver=s).duration for s in ("fast", "toppra"))
    assert ours == pytest.approx(theirs, rel=0.02)


def test_moving_average_is_smooth_and_ends_at_the_ends():
    robot = pk.load_robot(ONE_JOINT.format(velocity=2, acceleration=5))
    curve = as_cubic_path(robot, [[-1.0], [1.0]])
    fastest = retime(robot, curve)
    s = curve.breaks[0] + (fastest(fastest.knots).position[:, 0] + 1.0)
    base = smooth_time(curve, fastest.knots, s, 0.2)
    segments, step = np.arange(base.knots.size - 1), np.diff(base.knots)
    ends, starts = base.at(segments, step), base.at(segments, 0 * step)
    for late, early in zip(ends[:3], starts[:3], strict=True):
        np.testing.assert_allclose(late[:-1], early[1:], atol=1e-7)
    assert base.knots[-1] == pytest.approx(fastest.duration + 0.2)
    assert (starts[0][0], ends[0][-1]) == (pytest.approx(0.0, abs=1e-9), pytest.approx(2.0, abs=1e-9))
    assert starts[1].min() > -1e-9  # it never goes back


def test_named_limits_are_factors_on_acceleration(pepper):
    for name, factor in NAMED.items():
        np.testing.assert_allclose(jerk_limits(pepper, name), factor * pepper.acceleration_limits)
    np.testing.assert_allclose(jerk_limits(pepper, 7.0), 7 * pepper.acceleration_limits)
    np.testing.assert_array_equal(jerk_limits(pepper, np.arange(1.0, 16.0)), np.arange(1.0, 16.0))
