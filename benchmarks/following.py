"""Tasks along whole paths, and the joints that they leave alone."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator

import numpy as np
from harness import Times, figures, in_turn
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

import pepper_kin as pk
from pepper_kin.ik import AxisAlignment, HandPosition, LookAt
from pepper_kin.motion import (
    CIRC,
    LIN,
    SPLINE,
    Arc,
    FollowStatus,
    Line,
    Route,
    cartesian_path,
    follow,
    sequence,
)

RADIUS, SPEED = 0.1, 0.2
FRAMES = {"left": "LArm_effector", "right": "RArm_effector"}


def hand_of(pepper, q, side="left"):
    return pk.kinematics.frame_pose(pepper, q, FRAMES[side])[..., :3, 3]


def hand_speed(pepper, state, side="left"):
    jacobian = pk.kinematics.frame_jacobian(pepper, state.position, FRAMES[side])[:, :3]
    return np.linalg.norm(np.einsum("kij,kj->ki", jacobian, state.velocity), axis=1)


def circle_of(pepper):
    """Return joint positions, and the circle of the left hand from there."""
    point = np.array([0.32, 0.30, 0.92])
    q = pk.ik.solve(pepper, [HandPosition("left", point), LookAt(point)], pepper.posture("Stand")).q
    hand = hand_of(pepper, q)
    return q, Route.of(hand, Arc(hand - [0.0, RADIUS, 0.0], (1.0, 0.0, 0.0), 2 * np.pi))


def processor_time(function, times=15):
    return np.median(in_turn({"": function}, times, time.thread_time)[""])


def circle(pepper):
    """Yield error, ripple, accelerations and time of the circle, for one, two and three tasks."""
    q, route = circle_of(pepper)
    center = hand_of(pepper, q) - [0.0, RADIUS, 0.0]
    other = hand_of(pepper, q, "right")
    kinds = {
        "hand": lambda s: [HandPosition("left", route(s))],
        "hand and gaze": lambda s: [HandPosition("left", route(s)), LookAt(route(s))],
        "both hands and gaze": lambda s: [
            HandPosition("left", route(s)), LookAt(route(s)),
            HandPosition("right", other + 0.5 * (route(s) - route(0.0)) * [1.0, 1.0, -1.0]),
        ],
    }  # fmt: skip
    for name, tasks in kinds.items():
        found = follow(pepper, q, tasks, route, speed=SPEED)
        assert found.success, found.report()
        assert found.trajectory.check(pepper, pk.Scene(), balance=None).success
        spent = processor_time(lambda tasks=tasks: follow(pepper, q, tasks, route, speed=SPEED))
        times = np.linspace(0.0, found.trajectory.duration, 5000)
        hands = hand_of(pepper, found.trajectory(times).position)
        off = np.hypot(np.linalg.norm(hands[:, 1:] - center[1:], axis=1) - RADIUS, hands[:, 0] - center[0])
        cruise = found.trajectory(times[(times > 0.4) & (times < times[-1] - 0.4)])
        ripple = np.abs(hand_speed(pepper, cruise) / SPEED - 1).max()
        use = np.abs(cruise.acceleration / pepper.acceleration_limits).max()
        yield (
            "tasks | off [mm] {:.3f} | ripple {:.2f} % | of the accelerations {:.2f} | nodes | lap closes "
            "to [rad] {:.0e} | time [ms] {:.1f}",
            name, 1e3 * off.max(), 100 * ripple, use, len(found.curve.breaks),
            np.abs(found.trajectory.end - q).max(), 1e3 * spent,
        )  # fmt: skip
    yield f"from stop to stop: {stop_by_stop(pepper, q, kinds['hand and gaze'], route)}"
    yield f"Pink's loop: {pink_loop(pepper, q, route, center)}"


def stop_by_stop(pepper, q, tasks, route, count=46):
    """Return what IK at each stop and a spline through the solutions comes to, in words."""

    def solved():
        states = [q]
        for k in range(1, count):
            ones = [task.at(0) for task in tasks(np.array([route.length * k / (count - 1)]))]
            states.append(pk.ik.solve(pepper, ones, start=states[-1], restarts=0, collisions=False).q)
        return CubicSpline(np.linspace(0.0, route.length / SPEED, count), np.array(states))

    spent, curve = processor_time(solved, 5), solved()
    times = np.linspace(0.0, route.length / SPEED, 4000)
    use = np.abs(curve(times, 2) / pepper.acceleration_limits).max()
    gap = np.abs(curve(times[-1]) - q).max()
    return f"{use:.2f} of the accelerations, lap closes to {gap:.2f} rad, {1000 * spent:.1f} ms"


def pink_loop(pepper, q, route, center, rate=100.0):
    """Return what differential IK in a loop comes to, in words."""
    try:
        import pink
        import pink.tasks
    except ImportError:
        return "not installed"
    model = pepper.inner_model
    configuration = pink.Configuration(model, model.createData(), np.array(pepper.to_full(q)))
    task = pink.tasks.FrameTask(FRAMES["left"], position_cost=1.0, orientation_cost=0.0)
    posture = pink.tasks.PostureTask(cost=1e-3)
    posture.set_target_from_configuration(configuration)
    hands, begin, steps = [], time.thread_time(), int(rate * route.length / SPEED)
    for k in range(steps):
        pose = configuration.get_transform_frame_to_world(FRAMES["left"])
        pose.translation = route(min((k + 1) * SPEED / rate, route.length))
        task.set_target(pose)
        velocity = pink.solve_ik(configuration, [task, posture], 1 / rate, solver="proxqp")
        configuration.integrate_inplace(velocity, 1 / rate)
        hands.append(configuration.get_transform_frame_to_world(FRAMES["left"]).translation.copy())
    spent, hands = time.thread_time() - begin, np.array(hands)
    off = np.abs(np.linalg.norm(hands[:, 1:] - center[1:], axis=1) - RADIUS).max()
    ripple = np.abs(np.linalg.norm(np.diff(hands, axis=0), axis=1) * rate / SPEED - 1)[10:].max()
    return f"{1000 * off:.2f} mm, ripple {100 * ripple:.0f} %, {1000 * spent:.0f} ms for {steps} ticks"


def random_motion(pepper, rng):
    """Return a start, a hand, a route from there, its tasks, and a speed or None."""
    while True:
        side = "left" if rng.random() < 0.5 else "right"
        point = rng.uniform((0.15, 0.0, 0.6), (0.5, 0.45, 1.2)) * (1, 1 if side == "left" else -1, 1)
        gaze = rng.random() < 0.5
        tasks = [HandPosition(side, point)] + ([LookAt(point)] if gaze else [])
        near = pepper.posture("Stand") + rng.normal(0, 0.2, pepper.n)
        near = np.clip(near, pepper.lower_limits + 0.02, pepper.upper_limits - 0.02)
        q = pk.ik.solve(pepper, tasks, near, restarts=4, scene=pk.Scene()).q
        loaded = np.abs(pk.dynamics.gravity_torque(pepper, q)) > 0.9 * pepper.effort_limits
        if not all(task.error(pepper, q) < 1e-3 for task in tasks) or loaded.any():
            continue
        at = begin = hand_of(pepper, q, side)
        curves = []
        for kind in rng.integers(0, 4, rng.integers(1, 4)):
            way = rng.normal(0.0, 0.1, 3)
            curves.append(
                LIN(at + way) if kind == 0
                else CIRC(at + way / 2 + rng.normal(0.0, 0.03, 3), at + way) if kind == 1
                else Arc(at + rng.normal(0.0, 0.07, 3), rng.normal(size=3), rng.uniform(-6, 6)) if kind == 2
                else SPLINE([at + way / 3 + rng.normal(0.0, 0.03, 3), at + way])
            )  # fmt: skip
            at = curves[-1].placed(at).end
        if rng.random() < 0.6:
            least = min(part.length for part in Route.of(begin, curves).curves)
            curves = [type(c)(**{**vars(c), "blend": rng.uniform(0.1, 0.45) * least}) for c in curves]
        route = Route.of(begin, curves)

        def along(s, side=side, route=route, gaze=gaze):
            return [HandPosition(side, route(s))] + ([LookAt(route(s))] if gaze else [])

        return q, side, route, along, None if rng.random() < 0.3 else rng.uniform(0.03, 0.4)


def is_followed(pepper, found, route, side):
    """Whether a motion is certified, and leads the hand along the whole route and nowhere else."""
    times = np.linspace(0.0, found.trajectory.duration, 3000)
    hands = hand_of(pepper, found.trajectory(times).position, side)
    points = route(np.linspace(0, route.length, 6000))
    near = cKDTree(points).query(hands)[0].max() < 1.2e-3 and cKDTree(hands).query(points)[0].max() < 8e-3
    return near and found.trajectory.check(pepper, pk.Scene(), balance=None).success and found.slowest > 0.995


def is_confirmed(pepper, found, q, route, tasks, speed, rng):
    """Whether a long search finds no motion either."""
    if found.status in (FollowStatus.OUT_OF_REACH, FollowStatus.BLOCKED_BY_LIMITS):
        for s in np.linspace(found.reached, 1.0, 20) * route.length:
            ones = [task.at(0) for task in tasks(np.array([s]))]
            if not pk.ik.solve(pepper, ones, collisions=False, restarts=200).success:
                return True
    for _ in range(20):
        weights = np.exp(rng.normal(0.0, 1.0, pepper.n))
        other = pepper.with_limits(acceleration=pepper.acceleration_limits * weights)
        again = follow(other, q, tasks, route, timeout=1e-9)
        if not again.success:
            continue
        if speed is None:
            return False
        steady = np.linspace(0.0, route.length, 400)
        piece = np.clip(np.searchsorted(again.curve.breaks, steady) - 1, 0, len(again.curve.breaks) - 2)
        local = steady - again.curve.breaks[piece]
        velocity, bend = again.curve.at(piece, local, 1) * speed, again.curve.at(piece, local, 2) * speed**2
        torque = pk.dynamics.inverse_dynamics(pepper, again.curve.at(piece, local), velocity, bend)
        parts = zip(
            (velocity, bend, torque),
            (pepper.velocity_limits, pepper.acceleration_limits, pepper.effort_limits),
            strict=True,
        )
        if all((np.abs(value) <= limit).all() for value, limit in parts):
            return False
    return True


@figures("following.md", "Pink", count=10)
def following(count: int = 1000, seed: int = 0) -> Iterator[tuple | str]:
    """Tasks along whole paths: a circle with gaze, and random ones.

    Times are processor time.  `count` random motions of a hand along lines, arcs and splines, with corners or
    blends, with gaze or without, at a set speed or as fast as can be.  What is found is compared with the
    path by `frame_pose` and certified by `Trajectory.check`; where none is, a long search looks for one: the
    robot from 20 other weights of its joints and, where a place is said to be out of reach, 200 starts there.
    Peers: the loop of Pink, where it is installed, and one IK solution a stop with a spline through them.
    """
    pepper = pk.load_pepper().with_requirements("limits")
    yield from circle(pepper)
    ends, times, wrong, open_ends = Counter(), Times(time.thread_time), 0, Counter()
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        q, side, route, tasks, speed = random_motion(pepper, rng)
        found = times("follow", follow, pepper, q, tasks, route, speed=speed)
        ends[found.status.value + (", a task relaxed" if found.relaxed else "")] += 1
        if found.success:
            wrong += not is_followed(pepper, found, route, side)
        elif not is_confirmed(pepper, found, q, route, tasks, speed, rng):
            open_ends[found.status.value] += 1
    yield f"{count} random motions: {dict(ends.most_common())}"
    yield f"found and not certified: {wrong}; refused, and a long search finds one: {dict(open_ends)}"
    yield "time p50 {:.0f}, p90 {:.0f}, p99 {:.0f} ms".format(*times.at("follow", 50, 90, 99))


CUP_SPEED, STEP, MOST = 0.1, 0.02, 0.1


class Case:
    """A hand's line: its start, tasks along it, and the joints that nothing asks of."""

    def __init__(self, pepper, posture, rng=None):
        self.pepper, self.side = pepper, "left" if rng is None or rng.random() < 0.5 else "right"
        sign, self.gaze = (1, -1)[self.side == "right"], rng is not None and rng.random() < 0.5
        self.level = rng is None or rng.random() < 0.5
        while True:
            begin, way = np.array((0.30, 0.30 * sign, 0.85)), np.array((0.0, -0.30, 0.0))
            if rng is not None:
                begin = rng.uniform((0.2, 0.05, 0.65), (0.4, 0.35, 1.1)) * (1, sign, 1)
                way = rng.normal(size=3)
                way *= rng.uniform(0.1, 0.3) / np.linalg.norm(way)
            self.begin, self.end = begin, begin + way
            self.route = Route.of(begin, Line(self.end))
            ends = [
                pk.ik.solve(pepper, self.at(end), start=posture, balance="robot") for end in (begin, self.end)
            ]
            if all(found.success for found in ends):
                self.start = ends[0].q
                break
        idle = [*pepper.joint_group("right_arm" if self.side == "left" else "left_arm")]
        self.idle = [
            pepper.joint_index(name) for name in (idle if self.gaze else [*idle, *pepper.joint_group("head")])
        ]

    def at(self, point):
        """Return the tasks with the hand at a point, or at several, shape (K, 3)."""
        level = [AxisAlignment(FRAMES[self.side], (0, 0, 1), axis=(0, 0, 1), tolerance=np.radians(3))]
        return [HandPosition(self.side, point), *(level * self.level), *([LookAt(point)] * self.gaze)]


def states_of(motion):
    return motion(np.arange(0.0, motion.duration, STEP)).position


def by_follow(case):
    found = follow(case.pepper, case.start, lambda s: case.at(case.route(s)), case.route, speed=CUP_SPEED)
    return (states_of(found.trajectory), found.message) if found.success else None


def by_sequence(case):
    found = sequence(
        case.pepper, case.start, case.side, [LIN(case.end)], speed=CUP_SPEED, tasks=lambda p: case.at(p)[1:]
    )
    return (states_of(found.trajectory), found.message) if found.success else None


def by_cartesian_path(case):
    found = cartesian_path(case.pepper, case.start, case.side, LIN(case.end))
    if not found.success:
        return None
    places = np.arange(0.0, found.distances[-1], CUP_SPEED * STEP)
    states = np.stack([np.interp(places, found.distances, column) for column in found.path.T], axis=1)
    return states, found.message


def by_ik(case):
    states, message = [case.start], ""
    for s in np.arange(0.0, case.route.length, CUP_SPEED * STEP):
        found = pk.ik.solve(case.pepper, case.at(case.route(s)), start=states[-1], balance="robot")
        if not found.success:
            return None
        states.append(found.q)
        message += "out of the way" * bool(found.certificate.aside)
    return np.array(states), message


def by_servo(case):
    servo = pk.servo.Servo(case.pepper, case.start, rate=1.0 / STEP, balance=0.01)
    states = [case.start]
    for s in np.arange(0.0, case.route.length + 10 * STEP * CUP_SPEED, CUP_SPEED * STEP):
        servo.set_target(case.at(case.route(min(s, case.route.length))))
        states.append(servo.step().q)
    return np.array(states), ""


def by_live_motion(case):
    goal = pk.ik.solve(case.pepper, case.at(case.end), start=case.start, balance="robot").q
    live, now, states = pk.motion.LiveMotion(case.pepper, case.start), 0.0, []
    live.set_goal(goal)
    while len(states) < 1000:
        state = live.step(now)
        states.append(state.at(now).position)
        now += STEP
        if state.status is pk.motion.LiveStatus.REACHED and len(states) > 2:
            return np.array(states), ""
    return None


def by_plan(case):
    found = pk.plan(case.pepper, case.start, case.at(case.end), seed=0)
    return (states_of(pk.retime(case.pepper, found)), found.message) if found.success else None


WAYS = {
    "follow": by_follow, "sequence": by_sequence, "cartesian_path": by_cartesian_path,
    "ik.solve in turn": by_ik, "Servo": by_servo, "LiveMotion": by_live_motion, "plan": by_plan,
}  # fmt: skip


def measured(case, found):
    """Return the greatest way [rad] and speed [rad/s] of idle joints, and whether the message names one."""
    states, message = found
    own = states[:, case.idle]
    way = np.ptp(own, axis=0).max()
    return way, np.abs(np.diff(own, axis=0)).max() / STEP, "out of the way" in message


@figures("following.md", lines=2)
def idle_limbs(lines: int = 100, posture: str = "Ready") -> Iterator[tuple]:
    """Joints that no task moves while a hand follows lines.

    A level cup goes 30 cm to the side at 0.1 m/s, then so many hands along random lines of 10 to 30 cm, half
    of them level and half with gaze, from postures of IK near the posture.  Of each way to follow: the
    greatest way of a joint of the other arm, or of the head where it does not look, and its speed over 20 ms;
    and how many lines move one by more than 0.1 rad, and say so.
    """
    pepper, rng = pk.load_pepper(), np.random.default_rng(0)
    start = pepper.posture(posture)
    cases = [Case(pepper, start), *(Case(pepper, start, rng) for _ in range(lines))]
    for way, run in WAYS.items():
        found = [None if (done := run(case)) is None else measured(case, done) for case in cases]
        cup, own = found[0] or (np.nan, np.nan), [one for one in found[1:] if one is not None]
        far = [one for one in own if one[0] > MOST]
        most = np.max([one[:2] for one in own], axis=0)
        head = "way | cup: way [rad] {:.3f} | speed [rad/s] {:.2f} | arrived | over 0.1 rad | said | "
        head += "of all: way {:.3f} | speed {:.2f}"
        said = sum(one[2] for one in far)
        yield head, way, *cup[:2], len(own), len(far), said, *most
