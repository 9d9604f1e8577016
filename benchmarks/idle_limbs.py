"""Joints that no task moves while a hand follows lines: `python benchmarks/idle_limbs.py [N] [POSTURE]`.

A level cup goes 30 cm to the side at 0.1 m/s, then N hands (100 if not given) along random lines of 10 to
30 cm, half of them level and half with gaze, from postures of IK near POSTURE ("Ready" if not given).  Of
each way to follow: the greatest way of a joint of the other arm, or of the head where it does not look, and
its speed over 20 ms; and how many lines move one by more than 0.1 rad, and say so.
"""

import sys

import numpy as np

import pepper_kin as pk
from pepper_kin.ik import AxisAlignment, HandPosition, LookAt
from pepper_kin.motion import LIN, Line, Route, cartesian_path, follow, sequence

SPEED, STEP, MOST = 0.1, 0.02, 0.1
FRAMES = {"left": "LArm_effector", "right": "RArm_effector"}


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
    found = follow(case.pepper, case.start, lambda s: case.at(case.route(s)), case.route, speed=SPEED)
    return (states_of(found.trajectory), found.message) if found.success else None


def by_sequence(case):
    found = sequence(
        case.pepper, case.start, case.side, [LIN(case.end)], speed=SPEED, tasks=lambda p: case.at(p)[1:]
    )
    return (states_of(found.trajectory), found.message) if found.success else None


def by_cartesian_path(case):
    found = cartesian_path(case.pepper, case.start, case.side, LIN(case.end))
    if not found.success:
        return None
    places = np.arange(0.0, found.distances[-1], SPEED * STEP)
    states = np.stack([np.interp(places, found.distances, column) for column in found.path.T], axis=1)
    return states, found.message


def by_ik(case):
    states, message = [case.start], ""
    for s in np.arange(0.0, case.route.length, SPEED * STEP):
        found = pk.ik.solve(case.pepper, case.at(case.route(s)), start=states[-1], balance="robot")
        if not found.success:
            return None
        states.append(found.q)
        message += "out of the way" * bool(found.certificate.aside)
    return np.array(states), message


def by_servo(case):
    servo = pk.servo.Servo(case.pepper, case.start, rate=1.0 / STEP, balance=0.01)
    states = [case.start]
    for s in np.arange(0.0, case.route.length + 10 * STEP * SPEED, SPEED * STEP):
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


def main(count, name):
    pepper = pk.load_pepper()
    posture, rng = pepper.posture(name), np.random.default_rng(0)
    cases = [Case(pepper, posture), *(Case(pepper, posture, rng) for _ in range(count))]
    print(f"{'':17}   cup: way, speed | arrived | over {MOST} rad, said | of all: way, speed  [rad, rad/s]")
    for way, run in WAYS.items():
        found = [None if (done := run(case)) is None else measured(case, done) for case in cases]
        cup, lines = found[0] or (np.nan, np.nan), [one for one in found[1:] if one is not None]
        far = [one for one in lines if one[0] > MOST]
        farthest, fastest = np.max([one[:2] for one in lines], axis=0)
        said = sum(one[2] for one in far)
        print(
            f"{way:17} {cup[0]:10.3f} {cup[1]:5.2f}  | {len(lines):7} | {len(far):8} {said:11} |"
            f" {farthest:9.3f} {fastest:8.2f}", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, sys.argv[2] if len(sys.argv) > 2 else "Ready")
