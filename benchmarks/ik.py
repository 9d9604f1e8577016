"""Inverse kinematics beside its peers: python benchmarks/ik.py [--full].

Targets are reachable by construction: those of joint positions drawn evenly within the limits.  Solved means
less than 1 mm and 0.5 degrees away, within the limits, judged here from q.  All solvers take each target in
turn, in one process; times are those of one call.  Pink has no pointing or gaze task, so it runs on (a) and
(e) only; it is left out with a message where it is not installed (`pip install --no-deps pin-pink qpsolvers
daqp loop-rate-limiters`, so that `pin` stays as it is).
"""

from __future__ import annotations

import argparse
import logging
import math
import time
from collections.abc import Callable

import numpy as np

import pepper_kin as pk
from pepper_kin.ik.solvers.placo import robot_of

PEPPER = pk.load_pepper()
LOW, HIGH = PEPPER.lower_limits, PEPPER.upper_limits
LEFT, RIGHT, CAMERA = "LArm_effector", "RArm_effector", "CameraTop_frame"
Case = tuple[np.ndarray, np.ndarray, np.ndarray]  # poses of both hands, the point looked at
Solver = Callable[[str, Case], np.ndarray]

CLASSES = {
    "a": "hand position",
    "b": "hand position and pointing",
    "c": "gaze",
    "d": "both hands and gaze",
    "e": "hand position clear of self-collision",
}


def cases(count: int, seed: int, clear: bool) -> list[Case]:
    generator = np.random.default_rng(seed)
    found: list[Case] = []
    while len(found) < count:
        q = generator.uniform(LOW, HIGH)
        if clear and pk.collision.in_collision(PEPPER, q):
            continue
        left, right, camera = (pk.kinematics.frame_pose(PEPPER, q, f) for f in (LEFT, RIGHT, CAMERA))
        found.append((left, right, camera[:3, 3] + generator.uniform(0.5, 3.0) * camera[:3, 0]))
    return found


def tasks_of(kind: str, case: Case) -> list[pk.ik.Task]:
    left, right, point = case
    hand = pk.ik.HandPosition("left", left[:3, 3])
    return {
        "a": lambda: [hand],
        "b": lambda: [hand, pk.ik.Point("left", left[:3, 0])],
        "c": lambda: [pk.ik.LookAt(point)],
        "d": lambda: [hand, pk.ik.HandPosition("right", right[:3, 3]), pk.ik.LookAt(point)],
        "e": lambda: [hand],
    }[kind]()


def is_solved(kind: str, case: Case, q: np.ndarray) -> bool:
    if not (np.isfinite(q).all() and np.all(q >= LOW - 1e-9) and np.all(q <= HIGH + 1e-9)):
        return False
    if kind == "e" and pk.collision.in_collision(PEPPER, q):
        return False
    return all(
        task.error(PEPPER, q) <= (1e-3 if task.unit == "m" else math.radians(0.5))
        for task in tasks_of(kind, case)
    )


def ours(solver: str, restarts: int) -> Solver:
    scene = pk.Scene()

    def solve(kind: str, case: Case) -> np.ndarray:
        checked = scene if kind == "e" else None
        tasks = tasks_of(kind, case)
        return pk.ik.solve(PEPPER, tasks, solver=solver, restarts=restarts, scene=checked).q

    return solve


def lean_placo(iterations: int = 100) -> Solver:
    """placo used directly: its own tasks, joint limits, 100 steps at most from the neutral posture."""
    import placo

    robot = robot_of(PEPPER)
    start = PEPPER.neutral()

    def solve(kind: str, case: Case) -> np.ndarray:
        left, right, point = case
        robot.state.q = np.concatenate([(0, 0, 0, 0, 0, 0, 1), start])
        robot.model.lowerPositionLimit = np.concatenate([[-1e6] * 7, LOW])
        robot.model.upperPositionLimit = np.concatenate([[1e6] * 7, HIGH])
        robot.update_kinematics()
        solver = placo.KinematicsSolver(robot)
        solver.mask_fbase(True)
        solver.enable_joint_limits(True)
        parts = []
        if kind in "abde":
            parts.append((solver.add_position_task(LEFT, left[:3, 3]), 1.0))
        if kind == "b":
            parts.append((solver.add_axisalign_task(LEFT, np.eye(3)[0], left[:3, 0]), 1.0))
        if kind == "d":
            parts.append((solver.add_position_task(RIGHT, right[:3, 3]), 1.0))
        if kind in "cd":
            parts.append((solver.add_axisalign_task(CAMERA, np.eye(3)[0], np.eye(3)[0]), 1.0))
        for number, (task, weight) in enumerate(parts):
            task.configure(f"t{number}", "soft", weight)
        solver.add_regularization_task(1e-4)
        for _ in range(iterations):
            if kind in "cd":
                line = point - robot.get_T_world_frame(CAMERA)[:3, 3]
                parts[-1][0].targetAxis_world = line / np.linalg.norm(line)
            try:
                step = solver.solve(True)
            except RuntimeError:
                break
            robot.update_kinematics()
            if np.abs(step).max() < 1e-5:
                break
        return np.clip(np.array(robot.state.q[7:]), LOW, HIGH)

    return solve


def lean_pink(qp: str, iterations: int = 100) -> Solver | None:
    """Pink with joint limits, 100 steps at most."""
    try:
        import pink
        import qpsolvers
    except ImportError as error:
        print(f"Pink with {qp} is left out: {error}")
        return None
    if qp not in qpsolvers.available_solvers:
        print(f"Pink with {qp} is left out: qpsolvers lacks {qp}")
        return None
    model = PEPPER.pinocchio_model
    start = PEPPER.neutral()

    import pinocchio

    def solve(kind: str, case: Case) -> np.ndarray:
        configuration = pink.Configuration(model, model.createData(), start)
        task = pink.tasks.FrameTask(LEFT, position_cost=1.0, orientation_cost=0.0, lm_damping=1e-6)
        task.set_target(pinocchio.SE3(np.eye(3), case[0][:3, 3]))
        for _ in range(iterations):
            try:
                velocity = pink.solve_ik(
                    configuration, [task], 0.1, solver=qp, damping=1e-4, safety_break=False
                )
            except pink.exceptions.NoSolutionFound:
                break
            configuration.integrate_inplace(velocity, 0.1)
            if np.linalg.norm(task.compute_error(configuration)) < 1e-4:
                break
        return np.clip(configuration.q, LOW, HIGH)

    return solve


def measure(kind: str, solvers: dict[str, Solver], targets: list[Case]) -> None:
    times: dict[str, list[float]] = {name: [] for name in solvers}
    solved = dict.fromkeys(solvers, 0)
    for case in targets:
        for name, solve in solvers.items():
            begin = time.perf_counter()
            q = solve(kind, case)
            times[name].append(time.perf_counter() - begin)
            solved[name] += is_solved(kind, case, q)
    for name in solvers:
        micro = 1e6 * np.array(times[name])
        print(
            f"| ({kind}) {CLASSES[kind]} | {name} | {100 * solved[name] / len(targets):.2f} | "
            f"{np.median(micro):.0f} | {np.percentile(micro, 99):.0f} |",
            flush=True,
        )


def measure_batch(count: int) -> None:
    q = np.random.default_rng(7).uniform(LOW, HIGH, (count, PEPPER.n))
    points = pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]
    pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points[:50]))
    for threads in (1, 2):
        runs = []
        for _ in range(3):
            cpu = time.process_time()
            found = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), threads=threads)
            runs.append((found.time, time.process_time() - cpu))
        wall, cpu = min(run[0] for run in runs), min(run[1] for run in runs)
        print(
            f"| {threads} | {count / wall:.0f} | {1e6 * cpu / count:.1f} | {100 * found.solved.mean():.3f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="10,000 targets per class instead of 1,000")
    parser.add_argument("--count", type=int, help="another number of targets per class")
    parser.add_argument("--classes", default="abcde")
    arguments = parser.parse_args()
    logging.getLogger().setLevel(logging.ERROR)  # Pink warns at every step that ends on a limit
    count = arguments.count or (10_000 if arguments.full else 1_000)
    solvers: dict[str, Solver] = {"fast": ours("fast", 32), "fast, first start only": ours("fast", 0)}
    solvers |= {"placo, lean loop": lean_placo()}
    for qp in ("daqp", "proxqp"):
        pink = lean_pink(qp)
        if pink is not None:
            solvers[f"Pink, {qp}"] = pink
    print("\n| targets | solver | solved [%] | median [us] | 99th percentile [us] |\n|---|---|---|---|---|")
    for kind in arguments.classes:
        targets = cases(count, seed=ord(kind), clear=kind == "e")
        able = {name: s for name, s in solvers.items() if kind in "ae" or "Pink" not in name}
        for solve in able.values():
            solve(kind, targets[0])
        measure(kind, able, targets)
    print("\n| threads | hand positions a second | CPU time each [us] | solved [%] |\n|---|---|---|---|")
    measure_batch(10 * count)


if __name__ == "__main__":
    main()
