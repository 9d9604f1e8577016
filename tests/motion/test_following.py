"""Tasks along whole paths: a hand at a set speed with gaze, closed laps, corners, blends, and refusals."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import pepper_kin as pk
from pepper_kin.core.path_blocks import solve_path_blocks
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.ik.fast.task_rows import TaskRows
from pepper_kin.motion import CIRC, LIN, PTP, SPLINE, Arc, FollowStatus, Route, follow, sequence

HAND = "LArm_effector"
CENTER = np.array([0.32, 0.20, 0.92])
UP, SIDE = np.array([0.0, 0.0, 0.08]), np.array([0.0, -0.08, 0.0])


def hands_of(pepper, q, frame=HAND):
    return pk.kinematics.frame_pose(pepper, q, frame)[..., :3, 3]


@pytest.fixture(scope="module")
def start(pepper):
    point = CENTER - 1.25 * SIDE
    tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
    return pk.ik.solve(pepper, tasks, pepper.posture("Stand")).q


@pytest.fixture(scope="module")
def circle(pepper, start):
    hand = hands_of(pepper, start)
    return Route.of(hand, Arc(hand - [0.0, 0.1, 0.0], (1.0, 0.0, 0.0), 2 * np.pi))


def speed_of_hand(pepper, motion, times, frame=HAND):
    state = motion(times)
    jacobian = pk.kinematics.frame_jacobian(pepper, state.position, frame)[:, :3]
    return np.linalg.norm(np.einsum("kij,kj->ki", jacobian, state.velocity), axis=1)


def with_gaze(route):
    return lambda s: [pk.ik.HandPosition("left", route(s)), pk.ik.LookAt(route(s))]


def test_a_circle_at_a_set_speed_with_gaze(pepper, start, circle):
    found = follow(pepper, start, with_gaze(circle), circle, speed=0.2)
    assert found.success, found.report()
    motion = found.trajectory
    assert motion.check(pepper, pk.Scene(), balance=None).success
    times = np.linspace(0.0, motion.duration, 2000)
    hands = hands_of(pepper, motion(times).position)
    center = hands_of(pepper, start) - [0.0, 0.1, 0.0]
    np.testing.assert_allclose(np.linalg.norm(hands - center, axis=1), 0.1, atol=1e-4)
    np.testing.assert_allclose(hands[:, 0], center[0], atol=1e-4)
    cruise = times[(times > 0.3) & (times < motion.duration - 0.3)]
    np.testing.assert_allclose(speed_of_hand(pepper, motion, cruise), 0.2, rtol=5e-3)
    assert motion.duration == pytest.approx(2 * np.pi * 0.1 / 0.2, rel=0.05)
    np.testing.assert_allclose(motion.end, motion.start, atol=1e-9)
    angles = [pk.ik.LookAt(hands[k]).error(pepper, motion(times[k]).position) for k in range(0, 2000, 50)]
    assert max(angles) < np.radians(0.5)


def test_accelerations_do_not_grow_with_the_number_of_nodes(pepper, start, circle):
    greatest = []
    for tolerance in (1e-3, 2e-6):
        found = follow(
            pepper, start,
            lambda s, tolerance=tolerance: [
                pk.ik.HandPosition("left", circle(s), tolerance=tolerance),
                pk.ik.LookAt(circle(s), tolerance=10 * tolerance),
            ],
            circle, speed=0.2,
        )  # fmt: skip
        assert found.success, found.report()
        curve = found.curve
        piece, local = (
            np.repeat(np.arange(len(curve.breaks) - 1), 2),
            np.stack([np.zeros(len(curve.breaks) - 1), np.diff(curve.breaks)], axis=1).ravel(),
        )
        bend = curve.at(piece, local, 2) * 0.2**2
        greatest.append((len(curve.breaks), np.abs(bend / pepper.acceleration_limits).max()))
    assert greatest[1][0] > 1.5 * greatest[0][0], "a narrow tolerance takes more nodes"
    assert max(share for _, share in greatest) < 0.15


def test_laps_go_round_at_speed_without_a_stop(pepper, start, circle):
    found = follow(pepper, start, with_gaze(circle), circle, speed=0.2, laps=3)
    assert found.success
    assert found.slowest > 0.995
    motion = found.trajectory
    lap = 2 * np.pi * 0.1 / 0.2
    times = np.linspace(0.5, 0.5 + lap, 50)
    np.testing.assert_allclose(motion(times).position, motion(times + lap).position, atol=2e-4)
    assert speed_of_hand(pepper, motion, np.linspace(0.5, 2.5 * lap, 800)).min() > 0.199
    with pytest.raises(InvalidValueError, match="does not end where it begins"):
        follow(pepper, start, "left", LIN((0.0, 0.0, 0.05), relative=True), laps=2)


def test_the_motion_stops_at_corners_and_not_at_blends(pepper, start):
    hand = hands_of(pepper, start)
    corner, end = hand + UP, hand + UP + SIDE
    for blend in (0.0, 0.02):
        found = follow(pepper, start, "left", [LIN(corner, blend=blend), LIN(end)], speed=0.1)
        assert found.success, found.report()
        times = np.linspace(0.0, found.trajectory.duration, 4001)
        hands = hands_of(pepper, found.trajectory(times).position)
        near = np.linalg.norm(hands - corner, axis=1)
        speed = speed_of_hand(pepper, found.trajectory, times)
        inside = slice(400, -400)
        if blend:
            assert 0.002 < near.min() < blend
            assert speed[inside].min() > 0.0995
        else:
            assert near.min() < 1e-4
            assert speed[inside].min() < 5e-3
        off = np.minimum(np.abs(hands[:, 1] - hand[1]), np.abs(hands[:, 2] - corner[2]))
        assert off[near > blend + 1e-3].max() < 3e-4, "on the lines outside of the blend"


def test_routes_have_unit_speed_and_continuous_curvature_at_blends():
    curves = [LIN((0.2, 0.0, 0.0), blend=0.03), CIRC((0.25, 0.1, 0.0), (0.2, 0.2, 0.05), blend=0.02)]
    route = Route.of((0.0, 0.0, 0.0), [*curves, SPLINE([(0.1, 0.3, 0.0), (0.0, 0.2, 0.1)])])
    assert not route.corners.size
    s = np.linspace(1e-4, route.length - 1e-4, 20001)
    step = s[1] - s[0]
    points = route(s)
    np.testing.assert_allclose(
        np.linalg.norm(np.gradient(points, step, axis=0)[1:-1], axis=1), 1.0, atol=1e-5
    )
    bend = np.diff(points, 2, axis=0) / step**2
    rough = np.linalg.norm(np.diff(bend, axis=0), axis=1).max()
    assert rough < 0.02 * np.linalg.norm(bend, axis=1).max(), "no jump of curvature"
    for name, shape in (("a circle", CIRC((0.0, 0.2, 0.0), (0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))),):
        whole = Route.of((0.0, 0.0, 0.0), shape)
        assert whole.length == pytest.approx(2 * np.pi * 0.1), name
        assert whole.closed
    with pytest.raises(InvalidValueError, match="half of the shorter"):
        Route.of((0.0, 0.0, 0.0), [LIN((0.1, 0.0, 0.0), blend=0.06), LIN((0.1, 0.1, 0.0))])
    with pytest.raises(InvalidValueError, match="beside the line"):
        Route.of((0.0, 0.0, 0.0), CIRC((0.1, 0.0, 0.0), (0.2, 0.0, 0.0)))


def test_two_hands_and_gaze_over_time_keep_their_own_timing(pepper):
    def tasks(t):
        rise = 0.05 * np.sin(2 * t)
        left = np.stack([np.full_like(t, 0.32), 0.2 + rise, np.full_like(t, 0.9)], axis=-1)
        return [
            pk.ik.HandPosition("left", left),
            pk.ik.HandPosition("right", left * [1, -1, 1]),
            pk.ik.LookAt((1.0, 0.0, 1.0)),
        ]

    found = follow(pepper, None, tasks, np.pi, speed=1.0, ramps=False)
    assert found.success, found.report()
    assert found.trajectory.duration == pytest.approx(np.pi)
    times = np.linspace(0.0, np.pi, 200)
    q = found.trajectory(times).position
    np.testing.assert_allclose(hands_of(pepper, q)[:, 1], 0.2 + 0.05 * np.sin(2 * times), atol=1e-3)
    np.testing.assert_allclose(
        hands_of(pepper, q, "RArm_effector")[:, 1], -0.2 - 0.05 * np.sin(2 * times), atol=1e-3
    )


def test_the_last_task_gives_way_where_not_all_can_be_met(pepper, start, circle):
    def tasks(s):
        return [
            pk.ik.HandPosition("left", circle(s)),
            pk.ik.HandPosition("right", np.array([0.3, -0.2, 0.9]) + 0 * circle(s), tolerance=np.inf),
            pk.ik.JointValue("LElbowRoll", float(start[pepper.joint_index("LElbowRoll")])),
            pk.ik.JointValue("HeadYaw", 0.0 * s + start[pepper.joint_index("HeadYaw")]),
            pk.ik.FramePosition("torso", pk.kinematics.frame_pose(pepper, start, "torso")[:3, 3]),
            pk.ik.FrameOrientation("torso", pk.kinematics.frame_pose(pepper, start, "torso")[:3, :3]),
        ]

    found = follow(pepper, start, tasks, circle, speed=0.05)
    assert found.success, found.report()
    assert found.relaxed
    assert "position of left hand" not in found.relaxed
    assert found.errors[0] < 1e-3


@pytest.mark.thorough
def test_what_is_in_the_way_is_passed_or_named(pepper, start, circle):
    free = follow(pepper, start, "left", circle, speed=0.1)
    states = free.trajectory.sample(0.02).position
    balls = (
        pk.Scene().add_sphere("ball", 0.02, place + away)
        for place in hands_of(pepper, states[40:-40:20], "LForeArm")
        for away in (0.5 * UP, -0.5 * UP, SIDE, -SIDE, 0.8 * UP, -0.8 * UP)
    )
    clear = (ball for ball in balls if not pk.collision.in_collision(pepper, start, ball))
    beside = next(ball for ball in clear if pk.collision.in_collision(pepper, states, ball).any())
    found = follow(pepper, start, "left", circle, speed=0.1, scene=beside)
    assert found.success, found.report()
    assert found.trajectory.check(pepper, beside, balance=None).success
    wall = pk.Scene().add_box("wall", (0.02, 0.5, 0.02), circle(circle.length / 2) + 2.5 * SIDE)
    refused = follow(pepper, start, "left", circle, speed=0.1, scene=wall)
    assert refused.status is FollowStatus.IN_COLLISION
    assert "wall" in refused.message
    assert 0.1 < refused.reached < 0.9


@pytest.mark.thorough
def test_refusals_name_place_and_joint(pepper, start, circle):
    far = follow(pepper, start, "left", LIN((0.9, 0.9, 0.0), relative=True))
    assert far.status in (FollowStatus.OUT_OF_REACH, FollowStatus.BLOCKED_BY_LIMITS, FollowStatus.JUMP)
    assert "of 127.3 cm" in far.message
    assert 0.0 < far.reached < 1.0
    fast = follow(pepper, start, with_gaze(circle), circle, speed=4.0)
    assert fast.status is FollowStatus.TOO_FAST
    name = next(name for name in pepper.joint_names if name in fast.message)
    allowed = float(fast.message.split("speed of ")[1].rstrip("."))
    assert 0.2 < allowed < 4.0, name
    slower = follow(pepper, start, with_gaze(circle), circle, speed=0.5 * allowed)
    assert slower.success
    other = follow(pepper, pepper.posture("Stand"), lambda s: [pk.ik.HandPosition("left", circle(s))], circle)
    assert other.status is FollowStatus.START_INVALID
    chosen = follow(pepper, None, lambda s: [pk.ik.HandPosition("left", circle(s))], circle)
    assert chosen.success, chosen.report()
    assert np.linalg.norm(hands_of(pepper, chosen.trajectory.start) - circle(0.0)) < 1e-3


def test_misuse_is_refused(pepper, start, circle):
    with pytest.raises(InvalidValueError, match="one for all"):
        follow(pepper, start, lambda s: [pk.ik.HandPosition("left", circle(s[:-1]))], circle)
    with pytest.raises(InvalidValueError, match="infinite tolerances only"):
        follow(pepper, start, lambda s: [pk.ik.LookAt(circle(s), tolerance=np.inf)], circle)
    with pytest.raises(InvalidValueError, match=r"Route\.of"):
        follow(pepper, start, with_gaze(circle), [LIN((0.1, 0.0, 0.0))])
    with pytest.raises(InvalidValueError):
        follow(pepper, start, with_gaze(circle), circle, speed=np.nan)
    with pytest.raises(InvalidValueError):
        follow(pepper, start, with_gaze(circle), circle, ramps=False)
    with pytest.raises(TypeError, match="sped"):
        follow(pepper, start, with_gaze(circle), circle, sped=1.0)
    with pytest.raises(LimitError):
        follow(pepper, start + 9.0, with_gaze(circle), circle)
    with pytest.raises(UnknownNameError):
        follow(pepper, start, "third", LIN((0.1, 0.0, 0.0)))
    moving = pk.Scene().add_sphere("ball", 0.1, (3.0, 0.0, 0.5), velocity=(-0.1, 0.0, 0.0))
    for refused in (
        lambda: follow(pepper, start, with_gaze(circle), circle, scene=moving),
        lambda: sequence(pepper, start, "left", [PTP(start)], scene=moving),
    ):
        with pytest.raises(InvalidValueError, match="'ball' moving"):
            refused()


def test_commands_one_after_the_other(pepper, start):
    hand = hands_of(pepper, start)
    moves = [
        PTP(start),
        LIN(hand + UP, blend=0.02),
        CIRC(hand + 1.2 * UP + 0.6 * SIDE, hand + 0.6 * UP + 1.2 * SIDE),
        PTP({"HeadYaw": 0.3}),
    ]
    stand = pepper.posture("Stand")
    found = sequence(pepper, stand, "left", moves, speed=0.1)
    assert found.success, found.report()
    assert found.trajectory.check(pepper, pk.Scene(), balance=None).success
    assert found.trajectory.end[pepper.joint_index("HeadYaw")] == pytest.approx(0.3)
    path = hands_of(pepper, found.trajectory.sample(0.005).position)
    route = Route.of(hand, moves[1:3])
    assert cKDTree(path).query(route(np.linspace(0.0, route.length, 300)))[0].max() < 2e-3
    refused = sequence(pepper, stand, "left", [PTP(start), LIN((2.0, 0.0, 1.0))])
    assert not refused.success
    assert refused.message.startswith("Command 2 of 2")
    with pytest.raises(InvalidValueError, match="PTP"):
        sequence(pepper, stand, "left", [(0.1, 0.2, 0.3)])


def test_rows_of_tasks_are_those_of_the_tasks(pepper):
    rng = np.random.default_rng(3)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (6, pepper.n))
    points = rng.uniform(-0.5, 1.5, (6, 3))

    class Own(pk.ik.HandPosition):
        def residual(self, pepper, q):
            return 2.0 * super().residual(pepper, q)

        def jacobian(self, pepper, q):
            return 2.0 * super().jacobian(pepper, q)

    for tasks in (
        [
            pk.ik.HandPosition("left", points),
            pk.ik.LookAt(points),
            pk.ik.CenterOfMassOverWheels(0.02).on(pepper),
        ],
        [Own("right", points), pk.ik.JointValue("HeadYaw", 0.2)],
    ):
        rows = TaskRows(pepper, tasks, 6, np.ones(len(tasks)))
        residual, jacobian = rows(q)
        for k in range(6):
            ones = [task.at(k) for task in tasks]
            np.testing.assert_allclose(
                residual[k], np.concatenate([t.residual(pepper, q[k]) for t in ones]), atol=1e-9
            )
            np.testing.assert_allclose(
                jacobian[k], np.concatenate([t.jacobian(pepper, q[k]) for t in ones]), atol=1e-8
            )
            np.testing.assert_allclose(rows.errors(q)[k], [t.error(pepper, q[k]) for t in ones], atol=1e-9)


@pytest.mark.parametrize(
    ("closed", "count"), [(False, 2), (False, 3), (False, 4), (False, 9), (True, 5), (True, 8), (True, 9)]
)
def test_path_blocks_are_solved_as_by_a_dense_solver(closed, count):
    rng = np.random.default_rng(count)
    d, size = 3, 5
    null = np.linalg.qr(rng.normal(size=(count, size, d)))[0].swapaxes(1, 2).copy()
    differences = np.zeros((count, count))
    for i in range(count) if closed else range(1, count - 1):
        for k, c in zip((i - 1, i, i + 1), (1.0, -2.0, 1.0), strict=True):
            differences[i, k % count] += c
    dense = differences.T @ differences
    bend = np.zeros((3, count))
    for step in range(3):
        for k in range(count):
            other = (k + step) % count
            if closed or k + step < count:
                bend[step, k] = dense[k, other]
    weight, more = rng.uniform(0.5, 1.0, (count, size)), rng.normal(size=(count, 2, d))
    values = rng.normal(size=(count, d))
    whole = np.zeros((count * d, count * d))
    for a in range(count):
        for b in range(count):
            block = dense[a, b] * null[a] @ null[b].T
            if a == b:
                block = block + null[a] @ np.diag(weight[a]) @ null[a].T + more[a].T @ more[a]
            whole[a * d : (a + 1) * d, b * d : (b + 1) * d] = block
    expected = np.linalg.solve(whole[d:, d:], values.ravel()[d:])
    assert solve_path_blocks(null, bend, weight, more, closed, values)
    np.testing.assert_allclose(values[1:].ravel(), expected, atol=1e-9)
