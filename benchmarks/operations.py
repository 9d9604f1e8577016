"""What the library does, an operation a row, for comparisons between commits.

Each operation makes its own random problems, the same in every process, and returns a function that works
through all of them, how many there are, and a function of a peer on the same problems (or None).  Started as
a program, it serves operations by name over its standard input and output: `run_all.py` lets two commits
take turns so.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from harness import pairs, table

import pepper_kin as pk

Made = tuple[Callable[[], object], int, Callable[[], object] | None]
OPERATIONS: dict[str, Operation] = {}
HAND, SIDES = "LArm_effector", ("left", "right")


@dataclass(frozen=True)
class Operation:
    """What is done, in words, its page of `docs/benchmarks`, what makes ours, problems and the peer's.

    The peer is its name and the distribution whose version tells it apart.
    """

    words: str
    page: str
    make: Callable[[], Made]
    peer: tuple[str, str] | tuple[()] = ()


def operation(words: str, page: str, *peer: str) -> Callable[[Callable[[], Made]], Callable[[], Made]]:
    """Register the decorated function under its own name."""

    def register(make: Callable[[], Made]) -> Callable[[], Made]:
        OPERATIONS[make.__name__] = Operation(words, page, make, peer)  # type: ignore[arg-type]
        return make

    return register


@cache
def pepper() -> pk.PepperModel:
    return pk.load_pepper().with_requirements("limits")


def stand() -> np.ndarray:
    return pepper().posture("Stand")


def states(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return random positions within the limits, velocities and accelerations."""
    rng = np.random.default_rng(0)
    q = rng.uniform(pepper().lower_limits, pepper().upper_limits, (count, pepper().n))
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


@cache
def clear_postures(count: int, scene: str = "") -> np.ndarray:
    """Return postures, the legs near upright, that touch nothing; with any `scene`, not the table either."""
    low, high = pepper().lower_limits.copy(), pepper().upper_limits.copy()
    low[:3], high[:3] = 0.06 * low[:3], 0.06 * high[:3]
    q = np.random.default_rng(1).uniform(low, high, (8 * count, pepper().n))
    return q[~pk.collision.in_collision(pepper(), q, table() if scene else None)][:count]


@cache
def hand_points(count: int) -> np.ndarray:
    return pk.kinematics.frame_pose(pepper(), clear_postures(count), HAND)[:, :3, 3]


def pairs_of(count: int) -> list[tuple]:
    return list(zip(*states(count), strict=True))


@cache
def pinocchio_loop() -> tuple:
    import pinocchio

    model = pepper().inner_model
    return pinocchio, model, model.createData()


def one_by_one(ours: Callable, peer: str, rows: list[tuple]) -> Made:
    pin, model, data = pinocchio_loop()
    theirs, robot = getattr(pin, peer), pepper()
    return (
        lambda: [ours(robot, *row) for row in rows],
        len(rows),
        lambda: [theirs(model, data, *row) for row in rows],
    )


@operation("inverse dynamics, one state", "dynamics", "Pinocchio", "pin")
def inverse_dynamics() -> Made:
    return one_by_one(pk.dynamics.inverse_dynamics, "rnea", pairs_of(1000))


@operation("forward dynamics, one state", "dynamics", "Pinocchio", "pin")
def forward_dynamics() -> Made:
    return one_by_one(pk.dynamics.forward_dynamics, "aba", pairs_of(1000))


@operation("inverse dynamics' derivatives, one state", "dynamics", "Pinocchio", "pin")
def inverse_dynamics_derivatives() -> Made:
    return one_by_one(pk.dynamics.inverse_dynamics_derivatives, "computeRNEADerivatives", pairs_of(500))


@operation("mass matrix, one state", "dynamics", "Pinocchio", "pin")
def mass_matrix() -> Made:
    return one_by_one(pk.dynamics.mass_matrix, "crba", [row[:1] for row in pairs_of(1000)])


@operation("frame pose and Jacobian, one state", "dynamics", "Pinocchio", "pin")
def frame() -> Made:
    rows = list(states(1000)[0])
    pin, model, data = pinocchio_loop()
    index = model.getFrameId(HAND)

    def ours() -> None:
        for q in rows:
            pk.kinematics.frame_pose(pepper(), q, HAND)
            pk.kinematics.frame_jacobian(pepper(), q, HAND)

    def peer() -> None:
        for q in rows:
            pin.computeFrameJacobian(model, data, q, index, pin.LOCAL_WORLD_ALIGNED)
            pin.updateFramePlacement(model, data, index)

    return ours, len(rows), peer


@operation("inverse dynamics, 20,000 states", "dynamics", "loop over Pinocchio", "pin")
def inverse_dynamics_batch() -> Made:
    return _batch(pk.dynamics.inverse_dynamics, "rnea")


@operation("forward dynamics, 20,000 states", "dynamics", "loop over Pinocchio", "pin")
def forward_dynamics_batch() -> Made:
    return _batch(pk.dynamics.forward_dynamics, "aba")


@operation("inverse dynamics' derivatives, 20,000 states", "dynamics", "loop over Pinocchio", "pin")
def derivatives_batch() -> Made:
    return _batch(pk.dynamics.inverse_dynamics_derivatives, "computeRNEADerivatives")


def _batch(ours: Callable, peer: str) -> Made:
    rows = states(20_000)
    return (
        lambda: ours(pepper(), *rows),
        len(rows[0]),
        one_by_one(ours, peer, list(zip(*rows, strict=True)))[2],
    )


def hands(points: np.ndarray, **options: object) -> Callable[[], list]:
    """Return a function that solves for the left hand at each point."""

    def solve() -> list:
        tasks = (pk.ik.HandPosition("left", point) for point in points)
        return [pk.ik.solve(pepper(), task, **options) for task in tasks]

    return solve


@operation("IK of a hand, self-collision ignored", "ik", "placo", "placo")
def ik_hand() -> Made:
    points, free = hand_points(100), {"collisions": False}
    return hands(points, **free), len(points), hands(points, **free, solver="placo")


@operation("IK of a hand, clear of itself", "ik")
def ik_hand_clear() -> Made:
    return hands(hand_points(300)), 300, None


@operation("IK of both hands, clear of itself and a table", "ik")
def ik_both_clear() -> Made:
    postures, scene, tasks = clear_postures(100, "table"), table(), []
    for q in postures:
        points = [pk.kinematics.frame_pose(pepper(), q, f"{side}Arm_effector")[:3, 3] for side in "LR"]
        hands = [pk.ik.HandPosition(side, point) for side, point in zip(SIDES, points, strict=True)]
        tasks.append(hands)
    return lambda: [pk.ik.solve(pepper(), task, scene=scene) for task in tasks], len(tasks), None


@operation("IK of a hand, 5,000 rows clear of itself", "ik")
def ik_batch() -> Made:
    task = pk.ik.HandPosition("left", hand_points(5000))
    return lambda: pk.ik.solve_batch(pepper(), task, threads=1), 5000, None


@operation("IK out of reach, the closest posture", "ik")
def ik_closest() -> Made:
    return hands(np.random.default_rng(2).uniform((0.6, -0.5, 0.2), (1.2, 0.9, 1.8), (20, 3))), 20, None


@operation("collision check of one posture and a table", "collision", "coal through Pinocchio", "coal")
def check_one() -> Made:
    import pinocchio

    postures, scene = list(states(500)[0]), table()
    checker = pk.collision.CollisionChecker(pepper(), scene)
    model, data, geometry = pepper().inner_model, checker._data[0], checker._data[1]._kept
    check, shapes = pinocchio.computeCollisions, checker._shapes.model
    return (
        lambda: [pk.collision.in_collision(pepper(), q, scene) for q in postures],
        len(postures),
        lambda: [check(model, data, shapes, geometry, q, True) for q in postures],
    )


@operation("collision check of 50,000 postures and a table", "collision")
def check_batch() -> Made:
    q, scene = states(50_000)[0], table()
    return lambda: pk.collision.in_collision(pepper(), q, scene), len(q), None


@operation("a new scene of ten boxes and its first check", "collision")
def check_new_scene() -> Made:
    rng, count = np.random.default_rng(3), 40
    sizes, places = rng.uniform(0.05, 0.2, (count, 10, 3)), rng.uniform((1, -1, 0), (2, 1, 1), (count, 10, 3))

    def ours() -> None:
        for size, place in zip(sizes, places, strict=True):
            scene = pk.Scene()
            for k in range(10):
                scene = scene.add_box(f"{k}", size[k], place[k])
            pk.collision.in_collision(pepper(), stand(), scene)

    return ours, count, None


@operation("clearance of a posture and a table", "collision")
def clearance() -> Made:
    postures, scene = clear_postures(100), table()
    return lambda: [pk.collision.clearance(pepper(), q, scene) for q in postures], len(postures), None


@operation("a tick of the servo, a hand and gaze, clear of itself", "collision")
def servo() -> Made:
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    points = np.array([0.30, 0.20, 0.95]) + 0.06 * np.stack(
        [0.0 * angles, np.cos(angles), np.sin(angles)], axis=1
    )

    def ours() -> None:
        loop = pk.servo.Servo(pepper(), stand())
        for point in points:
            loop.set_target([pk.ik.HandPosition("left", point), pk.ik.LookAt(point)])
            loop.step()

    return ours, len(points), None


@operation("a plan beside a table", "planning")
def plan() -> Made:
    postures, scene = clear_postures(40, "table"), table()
    ends = pairs(postures)
    return lambda: [pk.plan(pepper(), *pair, scene, timeout=30.0) for pair in ends], len(ends), None


@operation("from a hand's target to a timed motion beside a table", "planning")
def main_job() -> Made:
    points, scene = np.random.default_rng(4).uniform((0.28, 0.02, 0.8), (0.42, 0.32, 1.0), (20, 3)), table()

    def ours() -> None:
        for point in points:
            tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
            found = pk.plan(pepper(), stand(), tasks, scene, timeout=30.0)
            if found.success:
                pk.retime(pepper(), found)

    return ours, len(points), None


@operation("a plan of base, torso and arm among three boxes", "planners")
def plan_base() -> Made:
    robot = pk.load_pepper(base="planar").with_requirements("limits")
    joints = ("BaseX", "BaseY", "BaseYaw", *robot.joint_group("torso"), *robot.joint_group("left_arm"))
    index = [robot.joint_index(name) for name in joints]
    low, high = robot.lower_limits[index].copy(), robot.upper_limits[index].copy()
    low[:3], high[:3] = (-1.5, -1.5, -3.1), (1.5, 1.5, 3.1)
    low[3:6], high[3:6] = 0.1 * low[3:6], 0.1 * high[3:6]
    scene = pk.Scene()
    for name, x, y in (("a", 0.0, 0.6), ("b", 0.6, -0.6), ("c", -0.7, -0.3)):
        scene = scene.add_box(name, (0.5, 0.5, 1.0), (x, y, 0.5))
    q = np.tile(robot.posture("Stand"), (200, 1))
    q[:, index] = np.random.default_rng(1).uniform(low, high, (len(q), len(index)))
    q = q[~pk.collision.in_collision(robot, q, scene)][:40]
    ends = pairs(q)
    return lambda: [pk.plan(robot, *pair, scene, joints=joints) for pair in ends], len(ends), None


@cache
def paths() -> list[np.ndarray]:
    """Return 20 random paths of five waypoints for all joints."""
    return list(clear_postures(100).reshape(20, 5, pepper().n))


@operation("timing of a path of 15 joints", "timing", "toppra", "toppra")
def retime() -> Made:
    few = paths()[:4]

    def solve(some: list[np.ndarray], **options: object) -> list:
        return [pk.retime(pepper(), path, torque=False, **options) for path in some]

    return lambda: solve(few * 5), 20, lambda: solve(few * 5, solver="toppra")


@operation("timing within torques and balance", "timing")
def retime_torque() -> Made:
    return lambda: [pk.retime(pepper(), path, balance=0.0) for path in paths()], len(paths()), None


@operation("timing with limited jerk", "timing")
def retime_jerk() -> Made:
    few, jerk = paths()[:5], 10.0 * pepper().acceleration_limits
    return lambda: [pk.retime(pepper(), path, torque=False, jerk=jerk) for path in few], len(few), None


@cache
def motions() -> list[pk.Trajectory]:
    """Return timed plans beside a table, certified clear."""
    q, found = clear_postures(40, "table"), []
    for start, goal in pairs(q):
        plan = pk.plan(pepper(), start, goal, table(), timeout=30.0)
        if plan.success:
            found.append(pk.retime(pepper(), plan, torque=False))
    return found


@operation("certificate of a motion beside a table", "timing")
def certificate() -> Made:
    scene = table()
    return lambda: [motion.check(pepper(), scene) for motion in motions()], len(motions()), None


@operation("stop from an instant of a motion", "timing")
def stop() -> Made:
    some = motions()
    return lambda: [motion.stop(pepper(), 0.5 * motion.duration) for motion in some], len(some), None


@operation("a new goal in motion, torques and balance kept", "timing")
def splice() -> Made:
    cases = [
        (one, 0.4 * one.duration, other.end)
        for one, other in zip(motions(), motions()[1:] + motions()[:1], strict=True)
    ]

    def ours() -> None:
        for motion, at, goal in cases:
            try:
                motion.replaced(pepper(), at, goal, balance=0.0)
            except pk.exceptions.InfeasibleError:
                continue

    return ours, len(cases), None


@operation("a motion optimized beside a table", "optimization")
def optimized() -> Made:
    from pepper_kin.motion import optimize

    q, scene = clear_postures(12, "table"), table()
    found = [pk.plan(pepper(), start, goal, scene, timeout=30.0) for start, goal in pairs(q)]
    return lambda: [optimize(pepper(), plan, scene) for plan in found if plan.success], len(found), None


@operation("a hand along a circle, with gaze", "timing")
def follow() -> Made:
    from pepper_kin.motion import Arc, Route
    from pepper_kin.motion import follow as followed

    point = np.array([0.32, 0.30, 0.92])
    q = pk.ik.solve(pepper(), [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)], stand()).q
    hand = pk.kinematics.frame_pose(pepper(), q, HAND)[:3, 3]
    route = Route.of(hand, Arc(hand - [0.0, 0.1, 0.0], (1.0, 0.0, 0.0), 2 * np.pi))

    def tasks(s: np.ndarray) -> list:
        return [pk.ik.HandPosition("left", route(s)), pk.ik.LookAt(route(s))]

    return lambda: followed(pepper(), q, tasks, route, speed=0.2), 1, None


@operation("a step of the twin, a trajectory in one call", "twin", "Pinocchio", "pin")
def twin() -> Made:
    motion, robot = motions()[0], pk.Twin(pepper(), 0.001)
    steps = int(motion.duration / 0.001)
    pin, model, data = pinocchio_loop()
    q, v, tau = states(1)

    def peer() -> None:
        for _ in range(steps):
            pin.aba(model, data, q[0], v[0], tau[0])

    def ours() -> None:
        for _ in range(10):
            robot.reset(motion.start)
            robot.execute(motion)

    return ours, 10 * steps, lambda: [peer() for _ in range(10)]


@operation("a step of 512 twins", "twin")
def twin_batch() -> Made:
    batch = pk.TwinBatch(pepper(), 512)
    targets = np.random.default_rng(5).uniform(-0.2, 0.2, (512, pepper().n)) + stand()

    def ours() -> None:
        batch.reset(np.tile(stand(), (512, 1)))
        batch.step(targets, 100)

    return ours, 512 * 100, None


@operation("a step of the twin that leans on a wall", "twin")
def twin_contacts() -> Made:
    from pepper_kin.twin.world import World

    q = stand().copy()
    for side, sign in (("L", 1), ("R", -1)):
        q[pepper().joint_index(f"{side}ShoulderPitch")] = 0.3
        q[pepper().joint_index(f"{side}ElbowRoll")] = -0.4 * sign
    reach = pk.kinematics.frame_pose(pepper(), q, "l_wrist")[0, 3]
    world = World(pepper(), pk.Scene().add_box("wall", (0.1, 2, 2), (reach + 0.195, 0, 1)))
    robot, goal = pk.Twin(pepper(), 0.001, world=world), q.copy()
    goal[pepper().joint_index("HipPitch")] -= 0.03

    def ours() -> None:
        robot.reset(q)
        for _ in range(300):
            robot.step(goal)

    return ours, 300, None


@operation("a step of the environment Reach, 256 robots", "twin")
def environment() -> Made:
    from pepper_kin.learning import PepperVectorEnv

    env = PepperVectorEnv(256)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(10)]
    return lambda: [env.step(action) for action in actions], 10 * 256, None


@operation("a depth picture, 320 x 240", "twin")
def picture() -> Made:
    from pepper_kin.twin.sensors import Camera

    camera, scene = Camera(pepper(), "camera_depth"), table()
    return lambda: camera.depth(stand(), scene), 1, None


def repeated(function: Callable[[], object]) -> tuple[Callable[[], object], int]:
    """Return a function that repeats another for some 10 ms, and how often; it has run once before."""
    function()
    begin = time.process_time()
    function()
    times = max(int(0.01 / max(time.process_time() - begin, 1e-6)), 1)
    return lambda: [function() for _ in range(times)], times


def serve() -> None:
    """Answer "make NAME" by whether there is a peer, "ours" and "peer" by a problem's processor time [s]."""
    functions: dict[str, tuple[Callable[[], object], int]] = {}
    answer: int | float | str
    for line in sys.stdin:
        word, _, name = json.loads(line).partition(" ")
        try:
            if word == "make":
                ours, count, peer = OPERATIONS[name].make()
                made = {"ours": ours} | ({"peer": peer} if peer is not None else {})
                functions = {
                    key: (job, times * count)
                    for key, (job, times) in ((key, repeated(function)) for key, function in made.items())
                }
                answer = int(peer is not None)
            else:
                function, problems = functions[word]
                begin = time.process_time()
                function()
                answer = (time.process_time() - begin) / problems
        except Exception as error:  # an earlier commit may lack what is asked for
            answer = f"error {type(error).__name__}: {' '.join(str(error).split())}"
        print(json.dumps(answer), file=replies, flush=True)


if __name__ == "__main__":
    replies, sys.stdout = sys.stdout, sys.stderr
    serve()
