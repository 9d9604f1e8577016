"""A base on wheels keeps the limits of its wheels, whatever its heading."""

import contextlib

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import Wheels
from pepper_kin.trajectory import OnlineMotion, Trajectory

RADIUS, FASTEST = 0.07, 6.28319  # the URDF's wheels

ROBOT = """<robot name="cart"><link name="body"/><link name="mast"><inertial><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="revolute"><parent link="body"/><child link="mast"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" velocity="2" acceleration="4" effort="50"/></joint></robot>"""


@pytest.fixture(scope="module")
def robot():
    return pk.load_pepper(base="planar")


def rolling(robot, q):
    """Centers and rolling directions of the wheels in the world, from the model's frames, (T, 3, 2) each."""
    poses = [pk.kinematics.frame_pose(robot, q, f"{name}_link") for name in ("WheelFL", "WheelFR", "WheelB")]
    centers = np.stack([pose[..., :2, 3] for pose in poses], axis=-2)
    axles = np.stack([pose[..., :2, 0] for pose in poses], axis=-2)
    return centers, np.stack([axles[..., 1], -axles[..., 0]], axis=-1)


def wheel_speeds(robot, trajectory, time, h=1e-6):
    """Speeds of the wheels by finite differences of where their centers are [rad/s], shape (T, 3)."""
    before, after = (rolling(robot, trajectory(time + s * h / 2).position) for s in (-1, 1))
    middle = rolling(robot, trajectory(time).position)[1]
    return np.einsum("tki,tki->tk", (after[0] - before[0]) / h, middle) / RADIUS


def drive(robot, *places):
    points = np.tile(robot.posture("Stand"), (len(places), 1))
    points[:, :3] = places
    return points


DRIVES = [
    [(0, 0, 0), (2, 2, 0)],
    [(0, 0, 0), (1, 0.5, 2.5)],
    [(0, 0, 0.3), (-1.5, 0.8, -6)],
    [(0, 0, 0), (1, 0, 1), (1, 1, 2), (0, 1, 4)],
]


@pytest.mark.parametrize("places", DRIVES)
@pytest.mark.parametrize("options", [{}, {"jerk": "moderate"}, {"solver": "toppra"}, {"velocity_scale": 0.5}])
def test_wheels_and_base_keep_their_limits(robot, places, options):
    """They were timed at 0.78 m/s and 13 rad/s of the wheels, and certified."""
    trajectory = pk.retime(robot, drive(robot, *places), **options)
    found = trajectory.check(robot, collisions=False, balance=None)
    assert found.success, found.report()
    share = options.get("velocity_scale", 1.0)
    time = np.linspace(1e-5, trajectory.duration - 1e-5, 4001)
    speeds = np.abs(wheel_speeds(robot, trajectory, time))
    base = np.linalg.norm(trajectory(time).velocity[:, :2], axis=1)
    assert speeds.max() <= FASTEST * share + 1e-5
    assert base.max() <= FASTEST * RADIUS * share + 1e-9
    assert max(speeds.max() / FASTEST, base.max() / (FASTEST * RADIUS)) > (0.95 if share == 1 else 0.45)
    assert speeds.max() <= found.wheel_speed.value + found.wheel_speed.resolution + 1e-5
    h = 2e-4
    inside = time[(time > h) & (time < trajectory.duration - h)]
    knots = np.abs(inside[:, None] - trajectory.breaks).min(axis=1) > h
    change = (wheel_speeds(robot, trajectory, inside + h) - wheel_speeds(robot, trajectory, inside - h)) / (
        2 * h
    )
    assert np.abs(change[knots]).max() <= 0.55 / RADIUS * 1.01


def test_the_check_finds_wheels_that_are_too_fast(robot):
    trajectory = pk.retime(robot, drive(robot, (0, 0, 0), (2, 2, 0))).scaled(0.9)
    found = trajectory.check(robot, collisions=False, balance=None)
    assert {"base_speed", "wheel_speed", "wheel_acceleration"} >= set(found.failures) >= {"base_speed"}
    assert "of the base, limit 0.4398 m/s" in found.base_speed.sentence()
    twist = np.zeros((1, 2, robot.n))
    twist[0, 0] = robot.posture("Stand")
    twist[0, 1, :3] = 0.3, 0.3, 1.0  # fast in the corner of the box that the joints allow
    corner = Trajectory(robot.joint_names, [0, 1], twist, robot.joint_units)
    found = corner.check(robot, collisions=False)
    assert found.wheel_speed.value == pytest.approx(
        np.abs(
            wheel_speeds(robot, Trajectory(robot.joint_names, [0, 1], twist), np.linspace(0.1, 0.9, 500))
        ).max(),
        rel=1e-2,
    )
    assert "wheel_speed" in found.failures


def test_arms_alone_are_timed_as_before(robot):
    points = drive(robot, (1, 2, 3), (1, 2, 3))
    points[1, robot.joint_index("LShoulderPitch")] -= 1.0
    fixed = pk.load_pepper()
    assert pk.retime(robot, points).duration == pytest.approx(
        pk.retime(fixed, points[:, 3:]).duration, rel=1e-9
    )


def test_any_base_on_wheels_keeps_their_speed():
    wheels = Wheels(speed=0.5, acceleration=1.0, track=0.4)
    robot = pk.load_robot(ROBOT, base="planar", wheels=wheels)
    trajectory = pk.retime(robot, [[0, 0, 0, 0], [1, 1, 2, 0.5]])
    state = trajectory(np.linspace(0, trajectory.duration, 5001))
    speed = np.linalg.norm(state.velocity[:, :2], axis=1) + 0.2 * np.abs(state.velocity[:, 2])
    assert 0.49 < speed.max() <= 0.5 + 1e-6
    assert trajectory.check(robot, collisions=False).success


@pytest.mark.parametrize("seed", range(6))
def test_online_motion_keeps_the_wheels_limits(robot, seed):
    rng = np.random.default_rng(seed)
    start = robot.posture("Stand")
    online = OnlineMotion(robot, start)
    for _ in range(3):
        target = start.copy()
        target[:3] = rng.uniform([-2, -2, -3], [2, 2, 3])
        with contextlib.suppress(InfeasibleError):
            online.set_target(target)
        online.step(rng.uniform(0.3, 2.0))
    motion = online.to_trajectory()
    time = np.linspace(1e-5, motion.duration - 1e-5, 6001)
    assert np.abs(wheel_speeds(robot, motion, time)).max() <= FASTEST * (1 + 1e-4)
    assert np.linalg.norm(motion(time).velocity[:, :2], axis=1).max() <= FASTEST * RADIUS * (1 + 1e-4)
    found = motion.check(robot, collisions=False, balance=None)
    for check in (found.wheel_speed, found.wheel_acceleration, found.base_speed):
        assert check.margin > -1e-4 * check.value, check.sentence()


def test_online_motion_drives_straight_as_fast_as_its_wheels(robot):
    start = robot.posture("Stand")
    online = OnlineMotion(robot, start)
    target = start.copy()
    target[0] = 3.0
    online.set_target(target)
    motion = online.to_trajectory()
    speed = np.abs(motion(np.linspace(0, motion.duration, 2001)).velocity[:, 0]).max()
    assert 0.4 < speed <= FASTEST * RADIUS * (1 + 1e-9)
    v = np.zeros(robot.n)
    v[:2] = 0.5, 0.5
    with pytest.raises(InvalidValueError, match=r"v: got .* times the speed of"):
        OnlineMotion(robot, start, v)


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_limit_that_acts_on_a_base_is_that_of_its_wheels(robot, share):
    """Only joints were looked at, of which none was near a limit."""
    start = robot.posture("Stand")
    target = start.copy()
    target[:3] = 1.0, 0.5, 2.0
    scales = {"velocity_scale": share, "acceleration_scale": share}
    found = pk.retime(robot, [start, target], **scales).active_limits(robot, **scales)
    assert found.active.mean() > 0.95
    assert found.share.max() <= 1 + 1e-6
    assert {name.split()[-1] for name in found.names[found.active]} <= {
        "WheelFL",
        "WheelFR",
        "WheelB",
        "base",
    }


@pytest.mark.parametrize("seed", [0, 1])
def test_a_base_that_is_too_fast_is_slowed_to_what_its_wheels_can(robot, seed):
    """Such a motion failed its certificate: only the joints' limits were enforced."""
    rng = np.random.default_rng(seed)
    points = np.tile(robot.posture("Stand"), (3, 1))
    points[1:, :3] = rng.uniform(-2, 2, (2, 3))
    fast = pk.retime(robot, points).scaled(0.5)
    assert not fast.check(robot, collisions=False).success
    motion = pk.trajectory.enforce_limits(robot, fast)
    found = motion.check(robot, collisions=False)
    assert found.success, found.report()
    time = np.linspace(1e-5, motion.duration - 1e-5, 6001)
    assert np.abs(wheel_speeds(robot, motion, time)).max() <= FASTEST * (1 + 1e-4)
