"""The servo's promises at every tick: limits, acceleration, determinism; over random streams of commands."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.core.braking import (
    VelocityInterval,
    bound_velocities,
    brake_joints,
    brake_path,
    stopping_speed,
)
from pepper_kin.core.quadratic_program import solve_program
from pepper_kin.servo.motion_limits import motion_limits

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")


def assert_limits_hold(pepper, path, dt, rest_before=True):
    """Positions, velocities (first differences) and accelerations (second differences) of a path."""
    path = np.vstack([path[:1], path]) if rest_before else path
    assert np.all(path >= pepper.lower_limits)
    assert np.all(path <= pepper.upper_limits)
    velocity, acceleration = np.diff(path, axis=0) / dt, np.diff(path, 2, axis=0) / dt**2
    assert np.all(np.abs(velocity) <= pepper.velocity_limits * (1 + 1e-9))
    assert np.all(np.abs(acceleration) <= pepper.acceleration_limits * (1 + 1e-8))


def random_commands(servo, generator, ticks):
    """Feed jumps, streams, targets out of reach and inside the body, postures, twists, and silence."""
    path = [servo.q]
    point, speed = np.array([0.3, 0.2, 0.9]), np.zeros(3)
    for tick in range(ticks):
        if tick % 20 == 0:
            point = generator.uniform((-0.6, -0.8, 0.0), (1.2, 0.8, 1.8))
            speed = generator.normal(size=3) * generator.choice([0.0, 0.3, 3.0])
            mode = generator.integers(6)
        point = point + speed / servo.rate
        if mode == 0:
            servo.set_target([pk.ik.HandPosition("left", point), pk.ik.LookAt(point)])
        elif mode == 1:
            other = point * (1, -1, 1)
            servo.set_target([pk.ik.HandPosition("left", point), pk.ik.HandPosition("right", other)])
        elif mode == 2:
            servo.set_target(pk.ik.JointPosture(generator.uniform(-4, 4, servo.pepper.n)))
        elif mode == 3:
            axes = ("world", "hand")[tick % 2]
            servo.set_twist("right", generator.normal(size=3) * 2, generator.normal(size=3), axes)
        elif mode == 4:
            pose = np.eye(4)
            pose[:3, 3] = point
            servo.set_target(pk.ik.HandPose("left", pose))
        elif tick % 20 == 0:
            servo.stop()
        path.append(servo.step().q)
    return np.array(path)


def test_a_joint_made_to_brake_for_others_brakes_in_time_for_its_own_limit():
    """The gentle brake that balance allows would have left a limit of which the bounds knew."""
    rng = np.random.default_rng(0)
    limits, dt = motion_limits(PEPPER, acceleration_scale=0.5), 0.04
    everywhere = np.ones(PEPPER.n, dtype=bool)
    harder = 0
    for _ in range(200):
        v = rng.uniform(-1, 1, PEPPER.n) * limits.velocity
        way = brake_path(np.abs(v), limits.acceleration, dt)[-1]
        way = (way + np.abs(v) * dt) * rng.uniform(1.0, 1.2, PEPPER.n)
        q = np.where(
            v > 0,
            np.maximum(limits.upper - way, limits.lower),
            np.minimum(limits.lower + way, limits.upper),
        )
        bounds = VelocityInterval(*np.empty((3, PEPPER.n)), *np.empty((2, PEPPER.n), dtype=np.int64))
        bound_velocities(q, v, limits, dt, bounds)
        gentle = np.copysign(np.maximum(np.abs(v) - 0.1 * limits.acceleration * dt, 0.0), v)
        found = VelocityInterval(*(part.copy() for part in bounds))
        brake_joints(found, everywhere, gentle)
        assert (found.low >= bounds.low).all()
        assert (found.high <= bounds.high).all()
        assert (found.low <= found.high).all()
        harder += ((gentle > bounds.high) | (gentle < bounds.low)).sum()
    assert harder > 100


@pytest.mark.parametrize("rate", [20.0, 100.0, 400.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_limits_hold_at_every_tick_whatever_is_commanded(rate, seed):
    servo = pk.servo.Servo(PEPPER, STAND, rate, collisions=False)
    path = random_commands(servo, np.random.default_rng(seed), 600)
    assert_limits_hold(PEPPER, path, 1 / rate)
    used = np.abs(np.diff(path, 2, axis=0)) * rate**2 / PEPPER.acceleration_limits
    assert used.max() > 0.99  # the commands were hard enough to press the limit


def test_limits_hold_from_random_postures_and_with_a_share_of_them():
    generator = np.random.default_rng(3)
    for _ in range(3):
        start = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        servo = pk.servo.Servo(PEPPER, start, velocity_scale=0.5, acceleration_scale=0.4, collisions=False)
        path = random_commands(servo, generator, 200)
        assert_limits_hold(PEPPER, path, 0.01)
        assert np.all(np.abs(np.diff(path, axis=0)) * 100 <= 0.5 * PEPPER.velocity_limits)
        assert np.all(np.abs(np.diff(path, 2, axis=0)) * 1e4 <= 0.4 * PEPPER.acceleration_limits * (1 + 1e-8))


@pytest.mark.parametrize("kind", [{"base": "planar", "hands": "mimic"}])
def test_limits_hold_with_a_moving_base_and_coupled_hands(kind):
    pepper = pk.load_pepper(**kind)
    servo = pk.servo.Servo(pepper, pepper.neutral(), collisions=False)
    path = random_commands(servo, np.random.default_rng(4), 300)
    assert_limits_hold(pepper, path, 0.01)


def test_limits_hold_with_self_collision_and_balance():
    servo = pk.servo.Servo(PEPPER, STAND, scene=pk.Scene(), balance=0.02)
    path = random_commands(servo, np.random.default_rng(5), 250)
    assert_limits_hold(PEPPER, path, 0.01)
    assert not pk.collision.in_collision(PEPPER, path).any()


def test_starts_at_a_limit():
    start = PEPPER.upper_limits.copy()
    servo = pk.servo.Servo(PEPPER, start, collisions=False)
    path = random_commands(servo, np.random.default_rng(6), 100)
    assert_limits_hold(PEPPER, path, 0.01)


def test_same_commands_give_the_same_numbers():
    scene = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
    paths = [
        random_commands(pk.servo.Servo(PEPPER, STAND, scene=scene), np.random.default_rng(7), 80)
        for _ in range(2)
    ]
    assert np.array_equal(*paths)


def test_comes_to_rest_in_the_time_that_the_limits_allow():
    """After the timeout every joint brakes with all it has: max |v| / a, rounded up to whole ticks."""
    servo = pk.servo.Servo(PEPPER, STAND, command_timeout=0.1, collisions=False)
    servo.set_target([pk.ik.HandPosition("left", (0.3, 0.5, 1.3)), pk.ik.LookAt((1.0, 1.0, 1.0))])
    states = [servo.step() for _ in range(10)]
    assert states[-1].status is not pk.servo.ServoStatus.STOPPING
    speed = np.abs(states[-1].v)
    expected = int(np.ceil((speed / (PEPPER.acceleration_limits * 0.01)).max() - 1e-6))
    assert expected >= 5
    states = [servo.step() for _ in range(expected + 2)]
    moving = [state.status is pk.servo.ServoStatus.STOPPING for state in states]
    assert moving == [True] * (expected - 1) + [False] * 3
    assert states[-1].status is pk.servo.ServoStatus.RESTING
    assert not states[-1].v.any()
    assert "waits for a command" in states[-1].report()


def test_a_command_counts_for_as_long_as_the_timeout():
    servo = pk.servo.Servo(PEPPER, STAND, command_timeout=0.05, collisions=False)
    servo.set_twist("left", (0.0, 0.0, 0.1))
    statuses = [servo.step().status for _ in range(7)]
    counted = [s not in (pk.servo.ServoStatus.STOPPING, pk.servo.ServoStatus.RESTING) for s in statuses]
    assert counted == [True] * 5 + [False] * 2
    forever = pk.servo.Servo(PEPPER, STAND, command_timeout=float("inf"), collisions=False)
    forever.set_twist("left", (0.0, 0.0, 0.01))
    assert [forever.step() for _ in range(300)][-1].v.any()


def test_stopping_speed_is_the_inverse_of_the_distance_to_rest():
    generator = np.random.default_rng(8)
    for _ in range(200):
        a, dt, v = generator.uniform(0.5, 60), generator.choice([0.001, 0.01, 0.05]), generator.uniform(0, 20)
        traveled, speed = 0.0, v
        while speed > 0:
            traveled += dt * speed
            speed -= a * dt
        assert stopping_speed(traveled, a, dt) == pytest.approx(v, rel=1e-9)
        assert brake_path(np.array([-v]), np.array([a]), dt)[-1, 0] == pytest.approx(-traveled)
    assert stopping_speed(np.inf, 1.0, 0.01) == np.inf
    assert stopping_speed(0.3, np.inf, 0.01) == pytest.approx(30.0)
    assert stopping_speed(0.0, 5.0, 0.01) == 0.0


def test_program_finds_the_minimum():
    """Against ProxSuite: no objective is higher, no constraint broken; also with parallel, empty rows."""
    from proxsuite import proxqp

    generator, n = np.random.default_rng(9), 12
    for _ in range(40):
        k = int(generator.integers(7, 30))
        tasks = generator.normal(size=(5, n))
        hessian = tasks.T @ tasks + np.diag(generator.uniform(1e-4, 1e-3, n))
        gradient = generator.normal(size=n)
        low, high = -generator.uniform(0, 1, n), generator.uniform(0, 1, n)
        rows, least = (
            generator.normal(size=(k, n)),
            -generator.uniform(0, 0.4, k) * (generator.random(k) < 0.6),
        )
        rows[3], rows[4], rows[6], least[6] = rows[2], 2 * rows[5], 0.0, -1.0
        x = solve_program(hessian, gradient, low, high, rows, least)
        assert np.all(x >= low)
        assert np.all(x <= high)
        assert np.all(rows @ x >= least - 1e-8)
        peer = proxqp.dense.QP(n, 0, k, True)
        peer.settings.eps_abs, peer.settings.max_iter = 1e-9, 2000
        peer.init(hessian, gradient, None, None, rows, least, np.full(k, 1e20), low, high)
        peer.solve()
        other = np.array(peer.results.x)
        values = [0.5 * y @ hessian @ y + gradient @ y for y in (x, other)]
        assert values[0] <= values[1] + 1e-6
    nothing = solve_program(np.eye(2), np.zeros(2), -np.ones(2), np.ones(2), np.eye(2)[:1], np.array([3.0]))
    assert nothing is None


TWO_LINKS = """<robot name="two_links">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit effort="30" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
</robot>"""


def test_serves_a_robot_without_acceleration_limits_bounds_or_shapes():
    robot = pk.load_robot(TWO_LINKS)
    assert np.isinf(robot.acceleration_limits).all()
    servo = pk.servo.Servo(robot, [0.3, 0.5], scene=pk.Scene(), command_timeout=10.0)
    target = pk.kinematics.frame_pose(robot, np.array([4.0, 1.0]), "lower")[:3, 3]
    servo.set_target(pk.ik.FramePosition("lower", target))
    path = np.array([servo.step().q for _ in range(400)])
    assert_limits_hold(robot, path, 0.01)
    assert servo.step().status is pk.servo.ServoStatus.ARRIVED
    servo.stop()
    assert not servo.step().v.any()
    with pytest.raises(pk.exceptions.UnknownNameError, match="unknown frame 'base_footprint'"):
        pk.servo.Servo(robot, [0.3, 0.5], balance=0.02, collisions=False)
