"""Splices: ruckig as the oracle of steering, continuity, certificates, refusals."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import dynamics
from pepper_kin.core.timing.steering import bridge, join_phases, steer
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError
from pepper_kin.trajectory.limits import LimitedQuantities, motion_limits
from pepper_kin.trajectory.splice import MovingStart
from pepper_kin.trajectory.stop import first_exceeded, limits_of

GOAL = {"LShoulderPitch": 0.2, "LElbowRoll": -1.0, "RShoulderRoll": -0.4, "HeadYaw": -0.5}


@pytest.fixture(scope="module")
def moving(pepper):
    away = pepper.joint_vector({"LShoulderPitch": 0.8, "RElbowRoll": 0.9, "HeadYaw": 0.6})
    return pk.retime(pepper, [pepper.posture("Stand"), away])


def steered(start, velocity, goal, limits):
    """Return the time, and breaks and cubics of a steered motion."""
    n = goal.size
    phases, breaks, pieces = np.empty((n, 3, 4)), np.empty(3 * n + 1), np.empty((3 * n, 4, n))
    time = steer(np.stack([start, velocity]), goal, limits, phases)
    count = join_phases(start, phases, breaks, pieces)
    return time, breaks[: count + 1], pieces[:count]


def test_no_motion_is_faster_and_all_joints_arrive():
    """Seeds of both signs, rest and full speed, overshoot and goals at the stopping point."""
    ruckig = pytest.importorskip("ruckig")
    rng = np.random.default_rng(0)
    for case in range(300):
        n = 1 + case % 6
        limits = rng.uniform(0.3, 5.0, (2, n))
        start, share = rng.normal(size=n), rng.choice([-1.0, 0.0, 1.0, *rng.uniform(-1, 1, 3)], n)
        velocity = share * limits[0]
        stopping = start + velocity * np.abs(velocity) / (2 * limits[1])
        goal = np.where(rng.random(n) < 0.1, stopping, start + rng.normal(size=n) * rng.choice([0.01, 1, 5]))
        time, breaks, pieces = steered(start, velocity, goal, limits)
        request = ruckig.InputParameter(n)
        request.current_position, request.current_velocity = list(start), list(velocity)
        request.target_position = list(goal)
        request.max_velocity, request.max_acceleration = list(limits[0]), list(limits[1])
        request.max_jerk = [np.inf] * n
        planned = ruckig.Trajectory(n)
        assert ruckig.Ruckig(n).calculate(request, planned) == ruckig.Result.Working
        assert time == pytest.approx(planned.duration, abs=1e-6)
        step = np.diff(breaks)[:, None]
        ends = pieces[:, 0] + step * (pieces[:, 1] + step * pieces[:, 2])
        speeds = pieces[:, 1] + 2 * step * pieces[:, 2]
        assert np.allclose(pieces[0, :2], [start, velocity], rtol=0, atol=1e-11)
        assert np.allclose(ends, [*pieces[1:, 0], goal], rtol=0, atol=1e-10)
        assert np.allclose(speeds, [*pieces[1:, 1], np.zeros(n)], rtol=0, atol=1e-10)
        assert np.all(np.abs(pieces[:, 1]) <= limits[0] * (1 + 1e-12))
        assert np.all(2 * np.abs(pieces[:, 2]) <= limits[1] * (1 + 1e-12))


def test_a_way_between_two_motions_meets_both_within_limits():
    """Not faster than ruckig's, which is the fastest, and within a step of a time that exists."""
    ruckig = pytest.importorskip("ruckig")
    rng, ratios = np.random.default_rng(1), []
    for case in range(300):
        n = 1 + case % 6
        limits = rng.uniform(0.3, 5.0, (2, n))
        ends = rng.normal(size=n) + rng.normal(size=(2, n)) * rng.choice([0.01, 1, 5])
        speeds = rng.choice([-1.0, 0.0, 1.0, *rng.uniform(-1, 1, 3)], (2, n)) * limits[0]
        beyond = rng.uniform(0.5, 20.0, (2, n)) * limits[0] ** 2 / (2 * limits[1])
        room = ends.min(axis=0) - beyond[0], ends.max(axis=0) + beyond[1]
        phases, states = np.empty((n, 3, 4)), np.stack([ends, speeds], axis=1)
        time = bridge(*states, np.stack([*limits, *room]), 60.0, phases)
        if time == 0.0:
            continue  # a joint on its way out of its room
        breaks, pieces = np.empty(3 * n + 1), np.empty((3 * n, 4, n))
        count = join_phases(ends[0], phases, breaks, pieces)
        motion = pk.Trajectory(tuple(f"j{k}" for k in range(n)), breaks[: count + 1], pieces[:count])
        state = motion(np.linspace(0.0, motion.duration, 500))
        assert np.allclose(state.position[[0, -1]], ends, rtol=0, atol=1e-9)
        assert np.allclose(state.velocity[[0, -1]], speeds, rtol=0, atol=1e-9)
        inner = np.arange(count - 1)
        before = motion.at_segments(inner, np.diff(motion.breaks)[:-1])
        after = motion.at_segments(inner + 1, 0 * inner)
        assert np.allclose(before[:2], after[:2], rtol=0, atol=1e-9)
        assert np.all((state.position >= room[0] - 1e-9) & (state.position <= room[1] + 1e-9))
        assert np.all(np.abs(state.velocity) <= limits[0] * (1 + 1e-9))
        assert np.all(np.abs(state.acceleration) <= limits[1] * (1 + 1e-9))
        request = ruckig.InputParameter(n)
        request.current_position, request.target_position = map(list, ends)
        request.current_velocity, request.target_velocity = map(list, speeds)
        request.max_velocity, request.max_acceleration = map(list, limits)
        request.max_jerk = [np.inf] * n
        planned = ruckig.Trajectory(n)
        assert ruckig.Ruckig(n).calculate(request, planned) == ruckig.Result.Working
        ratios.append(motion.duration / planned.duration)
    assert len(ratios) > 150
    assert min(ratios) > 1 - 1e-6
    assert np.median(ratios) < 1.05


def test_a_splice_keeps_limits_and_is_continuous(pepper, moving):
    goal, scene = pepper.joint_vector(GOAL), pk.Scene().add_box("box", (0.2, 0.2, 0.2), (1.5, 0.0, 0.8))
    for at in moving.duration * np.array([0.0, 0.2, 0.5, 0.8, 1.0]):
        splice = moving.replaced(pepper, at, goal, scene=scene, balance=0.0)
        found = splice.trajectory
        assert (splice.how, splice.time) == ("straight", at)
        assert np.allclose(found.end, goal, rtol=0, atol=1e-12)
        assert np.abs(found(found.duration).velocity).max() < 1e-12
        assert at == 0.0 or found.between(0.0, at).is_close(moving.between(0.0, at))
        after = found.at_segments(np.searchsorted(found.breaks, at, side="right") - 1, 0.0)
        assert np.allclose(after.position, moving(at).position, rtol=0, atol=1e-12)
        assert np.allclose(after.velocity, moving(at).velocity, rtol=0, atol=1e-12)
        certificate = found.check(pepper, scene, balance=0.0)
        assert certificate.success, certificate.report()


def test_joints_on_their_way_to_a_limit_turn_within_it(pepper):
    low, high = pepper.lower_limits, pepper.upper_limits
    index = pepper.joint_index("HeadYaw")
    edge = pepper.posture("Stand").copy()
    edge[index] = high[index]
    motion = pk.retime(pepper, [pepper.posture("Stand"), edge])
    for at in motion.duration * np.linspace(0.1, 0.95, 12):
        splice = motion.replaced(pepper, at, pepper.joint_vector(GOAL))
        states = splice.trajectory(np.linspace(0.0, splice.trajectory.duration, 2000)).position
        assert np.all((states <= high + 1e-9) & (states >= low - 1e-9))
        assert splice.trajectory.check(pepper, collisions=False).success


def test_a_way_too_heavy_in_motion_is_gone_after_a_stop(pepper):
    """And few ways in motion are later than the stop and the way from there."""
    ways, ratios, rng = set(), [], np.random.default_rng(4)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    for _ in range(100):
        start, away, goal = rng.uniform(lower, upper, (3, pepper.n))
        try:
            motion = pk.retime(pepper, [start, away])
            at = 0.6 * motion.duration
            splice = motion.replaced(pepper, at, goal)
            stop = motion.stop(pepper, at)
            go = stop.trajectory.replaced(pepper, stop.duration, goal).trajectory
        except InfeasibleError:
            continue
        ways.add(splice.how)
        ratios.append((splice.trajectory.duration - at) / go.duration)
        found = splice.trajectory.check(pepper, collisions=False)
        assert set(found.failures) <= {"balance"}, found.report()
    assert ways == {"straight", "after a stop"}
    assert len(ratios) > 80
    assert np.median(ratios) < 0.95
    assert np.percentile(ratios, 90) < 1.1


def test_the_joints_to_blame_are_those_the_mass_matrix_names(pepper):
    """A torque is the sum of the row of the mass matrix times accelerations, and what is there at rest."""
    rng, limits, seen = np.random.default_rng(0), limits_of(pepper, motion_limits(pepper)), 0
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    for _ in range(30):
        try:
            motion = pk.retime(pepper, rng.uniform(lower, upper, (2, pepper.n))).scaled(0.6)
        except InfeasibleError:
            continue
        names, used = first_exceeded(pepper, motion, limits)
        pieces, steps = np.arange(motion.breaks.size - 1), np.diff(motion.breaks)
        knots = motion.at_segments([*pieces, *pieces], [*0.0 * steps, *steps])
        torque = dynamics.newton_euler(pepper, *knots)
        excess = np.abs(torque) - pepper.effort_limits
        expected = np.full(pepper.n, np.inf)
        for j in np.flatnonzero(excess.max(axis=0) > 1e-6):
            worst = excess[:, j].argmax()
            acceleration = knots.acceleration[worst]
            row = dynamics.mass_matrix(pepper, knots.position[worst])[j] * acceleration
            gain = np.abs(torque[worst, j]) - np.abs(torque[worst, j] - row)
            blamed = gain > 0.5 * max(gain.max(), 1e-9)
            enough = max(1.0 - excess[worst, j] / max(gain[blamed].sum(), 1e-9), 0.4)
            expected[blamed] = np.minimum(expected, enough * np.abs(acceleration))[blamed]
        if np.isfinite(expected).any():
            seen += 1
            assert names == ("torque",)
            assert np.allclose(used, expected, rtol=1e-6, atol=0)
    assert seen > 10


def test_what_is_exceeded_with_balance_is_what_each_quantity_by_itself_says(pepper, monkeypatch):
    """The same limits by Python, as for robots that carry something."""
    rng, limits = np.random.default_rng(1), limits_of(pepper, motion_limits(pepper, balance=0.02))
    lower, upper, met = pepper.lower_limits.copy(), pepper.upper_limits.copy(), set()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    for speed in (0.5, 0.8, 1.0, 1.5) * 4:
        try:
            motion = pk.retime(pepper, rng.uniform(lower, upper, (2, pepper.n)), balance=0.02).scaled(speed)
        except InfeasibleError:
            continue
        names, used = first_exceeded(pepper, motion, limits)
        with monkeypatch.context() as patch:
            patch.setattr(LimitedQuantities, "effect_kernel", None)
            expected = first_exceeded(pepper, motion, limits)
        assert names == expected[0]
        np.testing.assert_allclose(used, expected[1], rtol=1e-9)
        met.add(names)
    assert met >= {(), ("torque", "balance")}


def test_the_motions_own_end_may_be_the_goal(pepper):
    """Before a limit of position a motion that brakes harder than allowed can only be let go on."""
    far = pepper.posture("Stand").copy()
    far[pepper.joint_index("HeadYaw")] = pepper.upper_limits[pepper.joint_index("HeadYaw")]
    motion = pk.retime(pepper, [pepper.posture("Stand"), far], torque=False).scaled(0.7)
    splice = motion.replaced(pepper, 0.8 * motion.duration, motion.end, torque=False)
    assert splice.how == "after a stop"
    assert splice.trajectory.is_close(motion)


def test_what_a_splice_refuses(pepper, moving):
    goal, at = pepper.joint_vector(GOAL), moving.duration / 2
    with pytest.raises(InvalidValueError, match="a time within"):
        moving.replaced(pepper, moving.duration + 1.0, goal)
    with pytest.raises(LimitError):
        moving.replaced(pepper, at, goal + 10.0)
    with pytest.raises(InvalidValueError, match="rests"):
        moving.replaced(pepper, 0.0, moving.start)
    wall = pk.Scene().add_box("wall", (3.0, 3.0, 3.0), (0.0, 0.0, 0.5))
    with pytest.raises(InfeasibleError, match="clearance"):
        moving.replaced(pepper, at, goal, scene=wall)


def test_another_motion_is_joined_while_both_move(pepper, moving):
    """The same goal by a motion that begins where the stop ends; sooner than by that stop."""
    goal = pepper.joint_vector(GOAL)
    for at in moving.duration * np.array([0.2, 0.5, 0.8]):
        stop = moving.stop(pepper, at)
        other = pk.retime(pepper, [stop.end, goal])
        splice = moving.replaced(pepper, at, other)
        found, after = splice.trajectory, at + stop.duration + other.duration
        assert splice.how == "joined"
        assert found.duration < after
        assert found.between(0.0, at).is_close(moving.between(0.0, at))
        assert np.allclose(found.end, goal, rtol=0, atol=1e-9)
        inside = np.linspace(at, 0.999 * found.duration, 2000)
        assert np.abs(found(inside).velocity).max(axis=1).min() > 0.0
        certificate = found.check(pepper, collisions=False)
        assert set(certificate.failures) <= {"balance"}, certificate.report()


def test_a_motion_too_heavy_to_be_joined_comes_after_the_stop(pepper):
    """Torque and balance of all ways by the certificate, and the end of the stop where there is one."""
    ways, rng = [], np.random.default_rng(5)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.04 * lower[:3], 0.04 * upper[:3]
    for _ in range(80):
        start, away, goal = rng.uniform(lower, upper, (3, pepper.n))
        try:
            motion = pk.retime(pepper, [start, away], balance=0.0)
            stop = motion.stop(pepper, motion.duration / 2, balance=0.0)
            other = pk.retime(pepper, [stop.end, goal], balance=0.0)
        except InfeasibleError:
            continue
        splice = motion.replaced(pepper, motion.duration / 2, other, balance=0.0)
        ways.append(splice.how)
        certificate = splice.trajectory.check(pepper, collisions=False, balance=0.0)
        assert certificate.success, certificate.report()
        if splice.how == "after a stop":
            parts = motion.between(0.0, motion.duration / 2).then(stop.trajectory).then(other)
            assert splice.trajectory.is_close(parts)
    assert set(ways) == {"joined", "after a stop"}, ways
    assert ways.count("joined") > ways.count("after a stop")


def test_another_motion_out_of_reach_is_refused(pepper, moving):
    wall = pk.Scene().add_box("wall", (3.0, 3.0, 3.0), (0.0, 0.0, 0.5))
    with pytest.raises(InfeasibleError, match="onto the other"):
        moving.replaced(pepper, moving.duration / 2, moving, scene=wall)


def test_the_stop_of_a_splice_counts_what_the_robot_carries(pepper):
    away = pepper.joint_vector({"LShoulderPitch": 0.0})
    scene = pk.Scene().add_sphere("weight", 0.02, (2.0, 0.0, 0.0))
    held = scene.attach("weight", "l_gripper", np.eye(4), mass=0.7, touch_links=pepper.link_names)
    moving = pk.retime(pepper, [away, pepper.joint_vector({"LShoulderPitch": 1.2})], scene=held)
    differ = 0
    for at in moving.duration * np.linspace(0.1, 0.9, 9):
        start = MovingStart(pepper, moving, at, held, balance=None, torque_scale=1.0)
        assert start.stopped.is_close(moving.stop(pepper, at, scene=held).trajectory)
        differ += not start.stopped.is_close(moving.stop(pepper, at).trajectory)
    assert differ


@pytest.mark.parametrize("options", [{"torque": False}, {}, {"balance": 0.0}], ids=str)
def test_with_jerk_limits_accelerations_are_continuous_too(pepper, options):
    """Straight to a goal and onto another motion, by the certificate; the acceleration beside the instant."""
    rng, hows = np.random.default_rng(2), []
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.04 * lower[:3], 0.04 * upper[:3]
    for _ in range(4):
        start, away, goal = rng.uniform(lower, upper, (3, pepper.n))
        motion = pk.retime(pepper, [start, away], jerk="brisk", **options)
        at = rng.uniform(0.2, 0.8) * motion.duration
        stop = motion.stop(pepper, at, jerk="brisk", **options)
        for aim in (goal, pk.retime(pepper, [stop.end, goal], jerk="brisk", **options)):
            splice = motion.replaced(pepper, at, aim, jerk="brisk", **options)
            hows.append(splice.how)
            balance = options.get("balance")
            certificate = splice.trajectory.check(pepper, collisions=False, jerk="brisk", balance=balance)
            unasked = {"torque"} & set(options) | {"balance"} - set(options)
            assert set(certificate.failures) <= unasked, certificate.report()
            np.testing.assert_allclose(splice.trajectory.end, goal, rtol=0, atol=1e-7)
    assert {"straight", "joined"} <= set(hows), hows


def test_a_motion_without_jerk_limits_is_led_on_with_them(pepper, moving):
    at = 0.4 * moving.duration
    splice = moving.replaced(pepper, at, pepper.joint_vector(GOAL), jerk=60.0, torque=False)
    assert splice.how == "straight"
    on = splice.trajectory.between(at, splice.trajectory.duration)
    np.testing.assert_allclose(on(0.0).acceleration, moving(at).acceleration, atol=1e-9)
    assert on.check(pepper, collisions=False, jerk=60.0).checks["jerk"].success


def test_a_motion_too_fast_for_its_jerk_limits_is_not_led_beyond_its_velocity(pepper):
    goal = pepper.joint_vector({"HeadYaw": 1.5})
    motion = pk.retime(pepper, [pepper.joint_vector({"HeadYaw": -1.5}), goal], torque=False)
    states = motion(np.linspace(0.0, motion.duration, 500))
    joint = pepper.joint_index("HeadYaw")
    rising = states.acceleration[:, joint] > 0.9 * pepper.acceleration_limits[joint]
    at = np.linspace(0.0, motion.duration, 500)[np.flatnonzero(rising)[-1]]
    for options in ({"jerk": 20.0}, {"jerk": 200.0}):
        try:
            splice = motion.replaced(pepper, at, goal - 0.1, torque=False, **options)
        except InfeasibleError:
            continue
        assert splice.trajectory.check(pepper, collisions=False).velocity.success


def test_motions_at_their_acceleration_limits_get_new_goals_with_jerk_limits(pepper):
    """Accelerations go on evenly from the instant on, whatever way is taken; no goal in order is refused."""
    rng, low, high, ways = (
        np.random.default_rng(8),
        0.7 * pepper.lower_limits,
        0.7 * pepper.upper_limits,
        set(),
    )
    for _ in range(12):
        start, away, goal = rng.uniform(low, high, (3, pepper.n))
        motion = pk.retime(pepper, [start, away], torque=False)
        for at in np.array([0.2, 0.5, 0.8]) * motion.duration:
            try:
                splice = motion.replaced(pepper, at, goal, jerk="brisk", torque=False)
            except InfeasibleError:
                continue
            after = splice.trajectory.between(at, splice.trajectory.duration)
            found = after.check(pepper, collisions=False, balance=None, jerk="brisk")
            assert found.acceleration_continuity.success, found.report()
            assert found.jerk.success, found.report()
            ways.add(splice.how)
    assert "straight" in ways


def test_a_splice_leaves_the_servos_what_the_robot_says():
    """Torques by Pinocchio: the reserve is kept unless a call or the robot says otherwise."""
    pepper, rng, most = pk.load_pepper(), np.random.default_rng(5), []
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.04 * lower[:3], 0.04 * upper[:3]
    for robot, options in (
        (pepper, {}),
        (pepper, {"torque_scale": 1.0}),
        (pepper.with_requirements("limits"), {}),
    ):
        used = 0.0
        for _ in range(6):
            start, away, goal = rng.uniform(lower, upper, (3, pepper.n))
            motion = pk.retime(robot, [start, away], **options)
            splice = motion.replaced(robot, 0.4 * motion.duration, goal, **options).trajectory
            state = splice(np.linspace(0.0, splice.duration, 400))
            torque = dynamics.inverse_dynamics(
                pepper, state.position, state.velocity, state.acceleration, solver="pinocchio"
            )
            used = max(used, float(np.abs(torque / pepper.effort_limits).max()))
            found = set(splice.check(robot, collisions=False, **options).failures)
            assert found <= ({"balance"} if robot.requirements.balance is None else set())
        most.append(used)
    assert most[0] <= 0.9 + 1e-6 < most[1] <= 1.0 + 1e-6
    assert most[2] <= 1.0 + 1e-6
