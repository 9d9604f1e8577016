"""Two Peppers face each other and reach with hands that cross: contacts and arrivals in many runs.

    python benchmarks/two_robots.py [RUNS [SEED]]

The way of the recipe "Let two robots pass each other": one is planned beside the other where it stands,
the other with the first at its goal; it begins as soon as its certificate among the first's motion is green.
Where there is no path, the first goes to another posture, or the other one goes first.  The judge is coal
on every millisecond, with poses of Pinocchio: it shares neither scenes nor checkers with the library.
"""

import sys
from collections.abc import Iterator
from itertools import chain

import coal
import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.model import Box, Capsule, Cylinder, Sphere

DISTANCE = 0.8
"""Between the bases [m]."""
APART = 0.12
"""Least distance of the goals [m]."""
LOW, HIGH = (0.34, -0.18, 0.80), (0.46, 0.0, 1.00)
"""Where left hands go, each in its robot's world, beyond the middle between the hands' starts [m]."""
FACING = pk.pose((DISTANCE, 0, 0), rpy=(0, 0, np.pi))
POSTURES = 16
"""Goal postures of the first that are tried besides the nearest."""
STEP, HOLD = 0.001, 0.2  # [s]


def goals(rng: np.random.Generator) -> np.ndarray:
    """Return goals of two left hands, each in its robot's world, shape (2, 3): hands cross on the way."""
    while True:
        found = rng.uniform(LOW, HIGH, (2, 3))
        if np.linalg.norm((FACING @ np.append(found[1], 1.0))[:3] - found[0]) > APART:
            return found


def motion_to(pepper: pk.PepperModel, goal: object, other: object) -> pk.Trajectory | None:
    """Return a motion from Stand beside another robot that stands; None where there is no path."""
    scene = pk.Scene().add_robot("other", pepper, other, FACING)
    plan = pk.plan(pepper, pepper.posture("Stand"), goal, scene, seed=0)
    return pk.retime(pepper, plan) if plan.success else None


def other_postures(
    pepper: pk.PepperModel, tasks: list[pk.ik.HandPosition], scene: pk.Scene
) -> Iterator[np.ndarray]:
    """Yield postures that reach a goal, each the nearest to another random one."""
    for seed in range(POSTURES):
        start = np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits)
        found = pk.ik.solve(pepper, tasks, start=start, scene=scene, seed=seed)
        if found.success:
            yield found.q


def one_after_the_other(
    pepper: pk.PepperModel, points: np.ndarray
) -> tuple[list[pk.Trajectory], float] | None:
    """Return the motions of the first and the second robot, and when the second begins [s]; None for none."""
    tasks = [[pk.ik.HandPosition("left", point)] for point in points]
    beside = pk.Scene().add_robot("other", pepper, pepper.posture("Stand"), FACING)
    for goal in chain([tasks[0]], other_postures(pepper, tasks[0], beside)):
        first = motion_to(pepper, goal, pepper.posture("Stand"))
        second = None if first is None else motion_to(pepper, tasks[1], first.end)
        if first is None or second is None:
            continue
        passing = pk.Scene().add_robot("other", pepper, first, FACING)
        soonest = max(0.0, first.duration - second.duration)
        for wait in np.arange(soonest, first.duration + 0.1, 0.05):
            if second.check(pepper, passing, start_time=wait).success:
                return [first, second], float(wait)
    return None


class Judge:
    """Finds contacts of two robots by coal."""

    def __init__(self, pepper: pk.PepperModel) -> None:
        self.model, self.data = pepper.inner_model, pepper.inner_model.createData()
        self.frames = [self.model.getFrameId(shape.link) for shape in pepper.collision_shapes]
        self.local = [pinocchio.SE3(shape.transform_shape_to_link) for shape in pepper.collision_shapes]
        self.sides = [
            [coal.CollisionObject(shape_of(s.geometry)) for s in pepper.collision_shapes] for _ in "ab"
        ]
        self.managers = [coal.DynamicAABBTreeCollisionManager() for _ in self.sides]
        for manager, side in zip(self.managers, self.sides, strict=True):
            manager.registerObjects(side)
            manager.setup()

    def touch(self, states: tuple[np.ndarray, np.ndarray]) -> bool:
        for q, side, manager, place in zip(
            states, self.sides, self.managers, (np.eye(4), FACING), strict=True
        ):
            pinocchio.framesForwardKinematics(self.model, self.data, q)
            for item, frame, local in zip(side, self.frames, self.local, strict=True):
                pose = pinocchio.SE3(place) * self.data.oMf[frame] * local
                item.setTransform(coal.Transform3s(pose.rotation, pose.translation))
                item.computeAABB()
            manager.update()
        found = coal.CollisionCallBackDefault()
        self.managers[0].collide(self.managers[1], found)
        return bool(found.data.result.isCollision())


def shape_of(geometry: Box | Capsule | Cylinder | Sphere) -> coal.CollisionGeometry:
    match geometry:
        case Box():
            return coal.Box(*geometry.size)
        case Capsule():
            return coal.Capsule(geometry.radius, geometry.length)
        case Cylinder():
            return coal.Cylinder(geometry.radius, geometry.length)
        case Sphere():
            return coal.Sphere(geometry.radius)


def at(motion: pk.Trajectory, times: np.ndarray) -> np.ndarray:
    return motion(np.clip(times, 0.0, motion.duration)).position


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    pepper, rng = pk.load_pepper(), np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    judge, arrived, contacts, waits, swapped, straight = Judge(pepper), 0, 0, [], 0, 0
    for _ in range(runs):
        points = goals(rng)
        tried = ((one_after_the_other(pepper, points[::order]), order) for order in (1, -1))
        found, order = next((way for way in tried if way[0]), (None, 0))
        if found is None:
            continue
        (first, second), wait = found
        times = np.arange(0.0, max(first.duration, wait + second.duration) + HOLD, STEP)
        rows = list(zip(at(first, times), at(second, times - wait), strict=True))
        contacts += any(judge.touch(row) for row in rows)
        straight += any(judge.touch(row) for row in zip(at(first, times), at(second, times), strict=True))
        hands = [pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3] for q in rows[-1]]
        arrived += all(np.linalg.norm(h - p) < 0.005 for h, p in zip(hands, points[::order], strict=True))
        waits.append(wait)
        swapped += order < 0
    print(f"| {runs} runs | found | asked |\n|---|---|---|\n| contacts, by coal | {contacts} | 0 |")
    print(f"| both arrive | {arrived} | {0.95 * runs:g} |")
    print(f"| the second waits, median / greatest | {np.median(waits):.2f} / {max(waits):.2f} s | |")
    print(f"| the other one goes first | {swapped} | |\n| contacts if it did not wait | {straight} | |")


if __name__ == "__main__":
    main()
