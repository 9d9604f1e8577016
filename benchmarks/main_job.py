"""The main job, from targets to a checked trajectory: python benchmarks/main_job.py [--count N] [--peer N].

A hand to a point and the eyes on it, from `Stand`: inverse kinematics, path, short-cuts, way-points, and
timing within velocity, acceleration and torque limits.  Ours is `pk.plan` and `pk.retime`, whose path has
been examined by the compiled check.  The peer does the same with placo, OMPL's RRT-Connect and `simplify`
over coal called directly, and toppra with torques by Pinocchio, as their users write it; it runs in turn with
ours on a handful of the tasks only, for it takes long.  After the clock has stopped, every trajectory is
certified by `trajectory.check` with coal.  Prints Markdown.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
import pinocchio
import placo
from ompl import base, geometric, util
from trajectory import Direct

import pepper_kin as pk
from pepper_kin.ik.solvers.placo import robot_of
from pepper_kin.trajectory import check

PEPPER = pk.load_pepper().with_requirements("limits")
STAND = PEPPER.posture("Stand")
ARMS = {"left": ("LArm_effector", 1.0), "right": ("RArm_effector", -1.0)}
CAMERA = "CameraTop_frame"
MARGIN = 0.005  # [m] that the peer keeps
CLOSE = 2e-3  # [m]
STARTS, STEPS = 20, 60  # of the peer's inverse kinematics
GRIDPOINTS = 200


def scenes() -> dict[str, pk.Scene]:
    """Nothing, a table, a table with things on it, and a shelf."""
    table = pk.Scene().add_box("table", (0.40, 0.80, 0.03), (0.47, 0.05, 0.715))
    things = table.add_box("box", (0.08, 0.08, 0.20), (0.42, 0.0, 0.83))
    things = things.add_box("book", (0.06, 0.06, 0.15), (0.50, 0.32, 0.81))
    things = things.add_cylinder("bottle", 0.03, 0.20, (0.50, -0.20, 0.83))
    shelf = pk.Scene().add_box("back", (0.02, 0.8, 1.4), (0.70, 0.0, 0.7))
    for k, z in enumerate((0.60, 1.05)):
        shelf = shelf.add_box(f"board {k}", (0.3, 0.8, 0.02), (0.56, 0.0, z))
    return {"free space": pk.Scene(), "table": table, "table with things": things, "shelf": shelf}


@dataclass(frozen=True, eq=False)
class Job:
    """A hand to a point and the eyes on it.

    Attributes:
        kind: Name of the scene.
        scene: The scene.
        hand: "left" or "right".
        point: The target [m], shape (3,).
    """

    kind: str
    scene: pk.Scene
    hand: str
    point: np.ndarray


def jobs(count: int, seed: int = 0) -> list[Job]:
    """Return tasks whose points lie before the robot, clear of what is in the scenes, which take turns."""
    rng = np.random.default_rng(seed)
    worlds = list(scenes().items())
    found: list[Job] = []
    while len(found) < count:
        kind, scene = worlds[len(found) % len(worlds)]
        hand = str(rng.choice(list(ARMS)))
        point = rng.uniform((0.28, 0.02, 0.80), (0.42, 0.32, 1.00)) * (1.0, ARMS[hand][1], 1.0)
        if any(_holds(item, point) for item in scene.objects.values()):
            continue
        found.append(Job(kind, scene, hand, point))
    return found


def _holds(item: pk.collision.SceneObject, point: np.ndarray) -> bool:
    """Whether a point is in the upright box around an object or within a palm's width of it."""
    shape, place = item.geometry, item.transform_object_to_world[:3, 3]
    half = np.array(shape.size) / 2 if isinstance(shape, pk.model.Box) else np.array((0.03, 0.03, 0.10))
    return bool((np.abs(point - place) < half + 0.04).all())


def ours(job: Job, seed: int) -> pk.Trajectory | None:
    """Return the trajectory of one job."""
    tasks = [pk.ik.HandPosition(job.hand, job.point), pk.ik.LookAt(job.point)]
    plan = pk.plan(PEPPER, STAND, tasks, job.scene, seed=seed, timeout=1.0)
    return pk.retime(PEPPER, plan, gridpoints=GRIDPOINTS) if plan.success else None


class Peer:
    """Placo, OMPL over coal, and toppra.

    Args:
        scene: The world; coal's objects for it are made beforehand.
    """

    def __init__(self, scene: pk.Scene) -> None:
        checker = pk.collision.CollisionChecker(PEPPER, scene, MARGIN, 0.0)
        self.model, self.checker = PEPPER.inner_model, checker
        self.data, self.geometry = checker._data[0], checker._data[1]._kept
        self.robot = robot_of(PEPPER)
        self.retime = Direct(True, GRIDPOINTS)
        self.low, self.high = PEPPER.lower_limits, PEPPER.upper_limits

    def free(self, q: np.ndarray) -> bool:
        """Ask the tables of neighboring links, gravity, and coal."""
        if any(table.violated(q) for table in self.checker._ranges):
            return False
        torque = pinocchio.computeGeneralizedGravity(self.model, self.data, q)
        if (np.abs(torque) > PEPPER.effort_limits).any():
            return False
        return not pinocchio.computeCollisions(
            self.model, self.data, self.checker._shapes.model, self.geometry, q, True
        )

    def reach(self, job: Job, start: np.ndarray) -> np.ndarray | None:
        """Solve by placo from a start; None where it is not reached."""
        robot, frame = self.robot, ARMS[job.hand][0]
        robot.state.q = np.concatenate([(0, 0, 0, 0, 0, 0, 1), start])
        robot.model.lowerPositionLimit = np.concatenate([[-1e6] * 7, self.low])
        robot.model.upperPositionLimit = np.concatenate([[1e6] * 7, self.high])
        robot.update_kinematics()
        solver = placo.KinematicsSolver(robot)
        solver.mask_fbase(True)
        solver.enable_joint_limits(True)
        solver.add_position_task(frame, job.point).configure("hand", "soft", 1.0)
        line = job.point - robot.get_T_world_frame(CAMERA)[:3, 3]
        gaze = solver.add_axisalign_task(CAMERA, np.eye(3)[0], line)
        gaze.configure("gaze", "soft", 1.0)
        solver.add_regularization_task(1e-4)
        for _ in range(STEPS):
            line = job.point - robot.get_T_world_frame(CAMERA)[:3, 3]
            gaze.targetAxis_world = line / np.linalg.norm(line)
            try:
                step = solver.solve(True)
            except RuntimeError:
                return None
            robot.update_kinematics()
            if np.abs(step).max() < 1e-5:
                break
        error = np.linalg.norm(robot.get_T_world_frame(frame)[:3, 3] - job.point)
        return np.clip(np.array(robot.state.q[7:]), self.low, self.high) if error < CLOSE else None

    def __call__(self, job: Job, seed: int) -> float | None:
        """Return the duration of a trajectory of one job; None where none was found."""
        rng = np.random.default_rng(seed)
        for number in range(STARTS):
            start = STAND if number == 0 else rng.uniform(self.low, self.high)
            goal = self.reach(job, start)
            if goal is not None and self.free(goal):
                break
        else:
            return None
        space = base.RealVectorStateSpace(PEPPER.n)
        bounds = base.RealVectorBounds(PEPPER.n)
        for i in range(PEPPER.n):
            bounds.setLow(i, self.low[i])
            bounds.setHigh(i, self.high[i])
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda s: self.free(np.array([s[i] for i in range(PEPPER.n)])))
        setup.getSpaceInformation().setStateValidityCheckingResolution(0.005)
        ends = []
        for q in (STAND, goal):
            state = space.allocState()
            for i in range(PEPPER.n):
                state[i] = float(q[i])
            ends.append(state)
        setup.setStartAndGoalStates(*ends)
        setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
        setup.solve(5.0)
        if not setup.haveExactSolutionPath():
            return None
        setup.simplifySolution(1.0)
        path = setup.getSolutionPath()
        path.interpolate(max(len(path.getStates()), 8))
        return self.retime(np.array([[s[i] for i in range(PEPPER.n)] for s in path.getStates()]))


def certified(trajectory: pk.Trajectory, scene: pk.Scene) -> bool:
    """Whether limits, torque, continuity and clearance hold at every millisecond, by other code and coal."""
    found = check(PEPPER, trajectory, scene=scene)
    return not set(found.failures) - {"balance"}  # which was not asked for


def row(name: str, times: list[float], solved: int) -> None:
    """Print the figures of one way."""
    milli = 1e3 * np.array(times)
    print(
        f"| {name} | {len(times)} | {np.median(milli):.2f} | {np.percentile(milli, 99):.1f} | "
        f"{100 * solved / len(times):.0f} |",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="tasks")
    parser.add_argument("--peer", type=int, default=20, help="of these, tasks that the peer does too")
    options = parser.parse_args()
    util.setLogLevel(util.LOG_NONE)
    cases = jobs(options.count)
    peers = {kind: Peer(scene) for kind, scene in {job.kind: job.scene for job in cases}.items()}
    for seed, job in enumerate(jobs(40, seed=1)):  # load code, make tables of the scenes
        ours(Job(job.kind, peers[job.kind].checker.scene, job.hand, job.point), seed)
    times: dict[str, list[float]] = {"ours": [], "peer": []}
    by_kind: dict[str, list[tuple[float, bool]]] = {kind: [] for kind in peers}
    passed = solved = peer_solved = 0
    for seed, job in enumerate(cases):
        begin = time.process_time()
        trajectory = ours(job, seed)
        times["ours"].append(time.process_time() - begin)
        by_kind[job.kind].append((times["ours"][-1], trajectory is not None))
        if seed < options.peer:
            begin = time.process_time()
            peer_solved += peers[job.kind](job, seed) is not None
            times["peer"].append(time.process_time() - begin)
        if trajectory is not None:
            solved += 1
            passed += certified(trajectory, job.scene)
    print("| way | tasks | median [ms] | 99th percentile [ms] | solved [%] |")
    print("|---|---|---|---|---|")
    row("pepper_kin", times["ours"], solved)
    for kind, found in by_kind.items():
        row(f"- {kind}", [t for t, _ in found], sum(ok for _, ok in found))
    if times["peer"]:
        row("placo + OMPL + toppra", times["peer"], peer_solved)
    print(f"\nOf {solved} trajectories {passed} pass the certificate: limits, torque, clearance by coal.")
    fresh = []
    for seed, job in enumerate(cases[1 : options.count : 4][:40]):
        new = Job(job.kind, scenes()[job.kind], job.hand, job.point)
        begin = time.process_time()
        ours(new, seed)
        fresh.append(time.process_time() - begin)
    print(f"In a scene never seen before, with its tables: median {1e3 * np.median(fresh):.1f} ms.")


if __name__ == "__main__":
    main()
