"""Stops: certificates, the way of the motion, a linear program and ruckig as oracles, refusals."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import cKDTree

import pepper_kin as pk
from pepper_kin.dynamics import newton_euler
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError

SETS = {
    "velocity and acceleration": ({"torque": False}, {}, {"torque": False}),
    "torque": ({}, {}, {}),
    "payload": ({"payload": {"left": 0.25}},) * 3,
    "balance": ({"balance": 0.01},) * 3,
}
"""Options of `retime`, of `check` and of `stop`."""


def motions(pepper, count, seed=0, **options):
    """Return fastest motions through random waypoints, the legs near upright so that it can stand."""
    rng, found = np.random.default_rng(seed), []
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    while len(found) < count:
        points = rng.uniform(lower, upper, (2 + len(found) % 4, pepper.n))
        try:
            found.append(pk.retime(pepper, points, **options))
        except InfeasibleError:
            continue
    return found


def instants(motion, count, seed=0):
    """Return random instants, and some at and beside knots, where accelerations jump."""
    rng = np.random.default_rng(seed)
    knots = rng.choice(motion.knots[:-1], 3)
    return [*rng.uniform(0.0, motion.duration, count), *knots, max(knots[0] - 1e-7, 0.0)]


def assert_from_motion_to_rest(motion, at, stop):
    before, after = motion(at), stop.trajectory(0.0)
    assert np.allclose(before.position, after.position, rtol=0, atol=1e-9)
    assert np.allclose(before.velocity, after.velocity, rtol=0, atol=1e-7)
    assert np.abs(stop.trajectory(stop.duration).velocity).max() < 1e-6


def distance_to_way(motion, positions):
    """Return how far positions, shape (T, n), are from a curve, beside its nearest tangent."""
    state = motion(np.linspace(0.0, motion.duration, 100_000))
    _, nearest = cKDTree(state.position).query(positions)
    off = positions - state.position[nearest]
    along = state.velocity[nearest]
    size = np.maximum((along**2).sum(axis=1, keepdims=True), 1e-12)
    return np.linalg.norm(off - along * (off * along).sum(axis=1, keepdims=True) / size, axis=1).max()


@pytest.mark.thorough
@pytest.mark.parametrize("name", SETS)
def test_stops_along_the_way_keep_every_limit(pepper, name):
    timing, of_check, of_stop = SETS[name]
    promised = {"torque", "balance"} - ({"torque"} if name.startswith("velocity") else set())
    promised -= set() if name == "balance" else {"balance"}
    for k, motion in enumerate(motions(pepper, 3, **timing)):
        for at in instants(motion, 5, k):
            stop = motion.stop(pepper, at, **of_stop)
            assert (stop.how, stop.exceeded, stop.clearance) == ("path", (), None)
            assert_from_motion_to_rest(motion, at, stop)
            found = stop.trajectory.check(pepper, collisions=False, **of_check)
            assert set(found.failures) <= {"torque", "balance"} - promised, found.report()
            positions = stop.trajectory(np.linspace(0.0, stop.duration, 50)).position
            assert distance_to_way(motion, positions) < 1e-6


def least_way(pepper, motion, at, step=0.002, ahead=0.4):
    """Solve min sum x over |q'' x + q' u| <= a and |torque| <= tau at both ends of small intervals.

    Returns:
        How far along the motion's own time it rests [s].
    """
    count = int(min(ahead, motion.duration - at - 1e-6) / step)
    q, v, a = motion(at + step * np.arange(count + 1))
    rest = newton_euler(pepper, q, 0 * q, 0 * q)
    of_u = np.concatenate([v, newton_euler(pepper, q, 0 * q, v) - rest], axis=1)
    of_x = np.concatenate([a, newton_euler(pepper, q, v, a) - rest], axis=1)
    most = np.concatenate([pepper.acceleration_limits, pepper.effort_limits]) * (1 + 1e-6)
    base = np.concatenate([0 * a, rest], axis=1)
    rows, bounds = [], []
    for i in range(count):
        for end in (i, i + 1):
            block = np.zeros((2 * pepper.n, count + 1))
            block[:, i] -= of_u[end] / (2 * step)
            block[:, i + 1] += of_u[end] / (2 * step)
            block[:, end] += of_x[end]
            rows += [block, -block]
            bounds += [most - base[end], most + base[end]]
    box = [(1.0, 1.0), *[(0.0, 1.0)] * count]
    found = linprog(np.ones(count + 1), np.concatenate(rows), np.concatenate(bounds), bounds=box)
    assert found.status == 0
    resting = np.flatnonzero(found.x < 1e-3)
    return step * resting[0] if resting.size else motion.duration - at


@pytest.mark.thorough
def test_a_linear_program_rests_at_the_same_place(pepper):
    for motion in motions(pepper, 3, seed=5):
        for at in motion.duration * np.array([0.21, 0.48, 0.63]):
            end = motion.stop(pepper, at).end
            ahead = np.linspace(at, motion.duration, 20_000)
            way = ahead[np.argmin(np.linalg.norm(motion(ahead).position - end, axis=1))] - at
            assert way == pytest.approx(least_way(pepper, motion, at), rel=0.07, abs=0.004)


def test_joints_brake_by_themselves(pepper):
    for motion in motions(pepper, 3, seed=2):
        for at in instants(motion, 4):
            stop, state = motion.stop(pepper, at, how="joints", torque=False), motion(at)
            if np.abs(state.velocity).max() < 1e-9:
                continue
            assert stop.how == "joints"
            assert_from_motion_to_rest(motion, at, stop)
            found = stop.trajectory.check(pepper, collisions=False)
            assert set(found.failures) <= {"torque", "balance", *stop.exceeded}
            if "position" in stop.exceeded:
                continue
            speed, limit = np.abs(state.velocity), pepper.acceleration_limits
            assert stop.duration == pytest.approx((speed / limit).max(), abs=2e-9)
            assert np.allclose(stop.end, state.position + state.velocity * speed / (2 * limit))
            limited = motion.stop(pepper, at, how="joints", balance=0.0)
            found = limited.trajectory.check(pepper, collisions=False)
            assert {name for name in ("torque", "balance") if name in found.failures} <= set(limited.exceeded)


def test_jerk_limited_stops_of_joints_are_those_of_ruckig(pepper):
    ruckig = pytest.importorskip("ruckig")
    motion = motions(pepper, 1, jerk="brisk")[0]
    for at in motion.duration * np.array([0.13, 0.37, 0.52, 0.81]):
        stop, state = motion.stop(pepper, at, how="joints", jerk="brisk", torque=False), motion(at)
        request = ruckig.InputParameter(pepper.n)
        request.control_interface = ruckig.ControlInterface.Velocity
        request.synchronization = ruckig.Synchronization.No
        request.current_position, request.current_velocity = list(state.position), list(state.velocity)
        request.current_acceleration = list(state.acceleration)
        request.max_acceleration = list(pepper.acceleration_limits)
        request.max_jerk = list(30.0 * pepper.acceleration_limits)
        planned = ruckig.Trajectory(pepper.n)
        assert ruckig.Ruckig(pepper.n).calculate(request, planned) == ruckig.Result.Working
        assert stop.duration == pytest.approx(planned.duration, abs=1e-6)
        assert np.allclose(stop.end, planned.at_time(planned.duration)[0], atol=1e-6)
        assert np.allclose(stop.trajectory(0.0).acceleration, state.acceleration, atol=1e-6)
        found = stop.trajectory.check(pepper, collisions=False, jerk="brisk")
        assert set(found.failures) <= {"torque", "balance"}, found.report()


def test_jerk_limited_stops_along_the_way_say_what_they_are(pepper):
    ways = set()
    for motion in motions(pepper, 2, jerk="brisk"):
        for at in motion.duration * np.linspace(0.05, 0.95, 6):
            stop = motion.stop(pepper, at, jerk="brisk")
            ways.add(stop.how)
            assert_from_motion_to_rest(motion, at, stop)
            found = stop.trajectory.check(pepper, collisions=False, balance=None, jerk="brisk")
            assert found.success, found.report()
            positions = stop.trajectory(np.linspace(0.0, stop.duration, 50)).position
            assert distance_to_way(motion, positions) < 1e-4
            if stop.how == "end":
                assert stop.trajectory == motion.between(at, motion.duration)
    assert ways <= {"path", "end"}


def test_the_clearance_of_a_stop_is_that_of_its_check(pepper, trajectory):
    scene = pk.Scene().add_box("box", (0.2, 0.2, 0.2), (0.5, 0.2, 0.8))
    stop = trajectory.stop(pepper, 0.5 * trajectory.duration, scene=scene)
    found = stop.trajectory.check(pepper, scene)
    assert stop.clearance.itself == pytest.approx(found.self_clearance.value, abs=1e-5)
    assert stop.clearance.obstacles == pytest.approx(found.obstacle_clearance.value, abs=1e-5)


@pytest.mark.parametrize("how", ["path", "joints"])
def test_a_robot_at_rest_stays(pepper, trajectory, how):
    for at in (0.0, trajectory.duration):
        stop = trajectory.stop(pepper, at, how)
        assert stop.duration <= 0.001
        assert np.array_equal(stop.end, trajectory(at).position)


def test_refusals(pepper, trajectory):
    with pytest.raises(InvalidValueError, match="at"):
        trajectory.stop(pepper, trajectory.duration + 0.1)
    with pytest.raises(InvalidValueError, match="at"):
        trajectory.stop(pepper, np.nan)
    with pytest.raises(UnknownNameError, match="path, joints"):
        trajectory.stop(pepper, 0.1, how="now")
    half = trajectory.between(0.0, 0.5 * trajectory.duration)
    with pytest.raises(InfeasibleError, match="ends in motion"):
        half.stop(pepper, 0.95 * half.duration)
    weak = pepper.with_limits(effort=dict.fromkeys(pepper.joint_names, 1e-3))
    with pytest.raises(InfeasibleError, match="could not hold"):
        trajectory.stop(weak, 0.5 * trajectory.duration)
    stop = trajectory.stop(pepper, 0.1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        stop.how = "joints"


@pytest.mark.thorough
def test_the_clearance_of_a_stop_is_that_to_where_obstacles_are_then(pepper):
    motion = pk.retime(pepper, [pepper.posture("Stand"), pepper.joint_vector({"LShoulderPitch": 0.2})])
    at = motion.duration / 2
    hand = pk.kinematics.frame_pose(pepper, motion(at).position, "l_gripper")[:3, 3]
    away = hand + np.array([0.1, 1.0, 0.0])
    ball = pk.Scene().add_sphere("ball", 0.05, away, velocity=(0.0, -1.0 / at, 0.0))
    found = motion.stop(pepper, at, scene=ball)
    times = np.linspace(0.0, found.duration, 200)
    states = found.trajectory(times).position
    wanted = min(
        float(pk.collision.clearance(pepper, q, ball.at(at + t))) for q, t in zip(states, times, strict=True)
    )
    assert found.clearance.least == pytest.approx(wanted, abs=1e-3)
    assert found.clearance.obstacles < found.clearance.itself
    assert motion.stop(pepper, at, scene=pk.Scene()).clearance.obstacles == np.inf
    with pytest.raises(InvalidValueError, match="'ball' moving"):
        motion.replaced(pepper, at, motion.start, scene=ball)


def test_jerk_limited_stops_of_motions_without_jerk_limits_are_smooth_or_say_so(pepper):
    """The certificate decides; what is said to be kept is kept, and begins with the motion's acceleration."""
    how = {"path": 0, "end": 0}
    for motion in motions(pepper, 6):
        for at in np.array([0.1, 0.3, 0.5, 0.9]) * motion.duration:
            stop = motion.stop(pepper, at, jerk="brisk", torque=False)
            found = stop.trajectory.check(pepper, collisions=False, balance=None, jerk="brisk")
            jumps = bool({"jerk", "acceleration_continuity"} & set(found.failures))
            jumps |= bool(np.abs(stop.trajectory(stop.duration).acceleration).max() > 1e-6)  # to rest
            assert jumps == ("jerk" in stop.exceeded)
            begins = stop.trajectory(0.0).acceleration - motion(at).acceleration
            assert np.abs(begins).max() < 1e-6 * max(1.0, np.abs(motion(at).acceleration).max())
            if stop.how == "path":
                assert not stop.exceeded
                assert distance_to_way(motion, stop.trajectory.sample(0.005).position) < 1e-3
            how[stop.how] += 1
    assert how["path"] >= 4
