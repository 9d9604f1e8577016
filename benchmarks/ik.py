"""Inverse kinematics: beside its peers, clear, blocked, out of reach, at rest, in rows, under weights."""

from __future__ import annotations

import ctypes
import itertools
import json
import logging
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from harness import Times, figures, peer, timed
from ik_peers import (
    CLASSES,
    HIGH,
    LEFT,
    LOW,
    PEPPER,
    Case,
    Roboplan,
    Solver,
    cases,
    is_solved,
    lean_mink,
    lean_pink,
    lean_placo,
    tasks_of,
)
from numpy.typing import NDArray
from planning import ten_boxes
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.collision.checker import checker_for
from pepper_kin.ik import IKStatus
from pepper_kin.ik.batch import CODES, BatchResult
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast import solutions_from
from pepper_kin.ik.priorities import balanced
from pepper_kin.ik.problem import TaskProblem, flatten_tasks, make_problem
from pepper_kin.ik.standing import holds, rests
from pepper_kin.model.requirements import ROOM_TO_MOVE

OURS = "pepper_kin, fast"
RESTARTS = 32
TURN = 50


_tasks: dict[tuple[str, int], list[pk.ik.Task]] = {}


def ours(restarts: int) -> Solver:
    def solve(kind: str, case: Case) -> np.ndarray:
        checked = kind == "e"
        return pk.ik.solve(PEPPER, made_tasks(kind, case), restarts=restarts, collisions=checked).q

    return solve


def made_tasks(kind: str, case: Case) -> list[pk.ik.Task]:
    """Return the tasks of a target, made when first asked for."""
    key = (kind, id(case))
    if key not in _tasks:
        _tasks[key] = tasks_of(kind, case)
    return _tasks[key]


def measure(kind: str, solvers: dict, first: dict, targets: list[Case]) -> Iterator[tuple | str]:
    """Yield the table of one class; `first` are solvers without restarts where there are any, not timed."""
    times, solved = Times(time.perf_counter), dict.fromkeys(solvers, 0)
    for case in targets:
        made_tasks(kind, case)
    for number in range(0, len(targets), TURN):
        turn = targets[number : number + TURN]
        for name, solve in solvers.items():
            answers = []
            for case in turn:
                answers.append(times(name, solve, kind, case))
                if isinstance(solve, Roboplan):
                    times[name][-1] = solve.time
            solved[name] += sum(is_solved(kind, case, q) for case, q in zip(turn, answers, strict=True))
    yield f"({kind}) {CLASSES[kind]}, {len(targets)} targets"
    for name in times:
        at_first = solved[name]
        if name in first:
            at_first = sum(is_solved(kind, case, first[name](kind, case)) for case in targets)
        median, p99 = times.at(name, 50, 99, unit=1e6)
        yield (
            "solver | solved [%] {:.2f} | from the first start [%] {:.2f} | median [us] {:.0f} | p99 [us] "
            "{:.0f} | time / ours {:.1f}",
            name, 100 * solved[name] / len(targets), 100 * at_first / len(targets), median, p99,
            np.median(np.divide(times[name], times[OURS])),
        )  # fmt: skip


def batches(count: int) -> Iterator[tuple]:
    q = np.random.default_rng(7).uniform(LOW, HIGH, (count, PEPPER.n))
    task = pk.ik.HandPosition("left", pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3])
    for threads in (1, 2):
        runs = []
        for _ in range(3):
            found, spent = timed(pk.ik.solve_batch, PEPPER, task, threads=threads, collisions=False)
            runs.append((found.time, spent))
        wall, spent = np.min(runs, axis=0)
        yield (
            "threads | hand positions a second {:.0f} | CPU time each [us] {:.1f} | solved [%] {:.3f}",
            threads, count / wall, 1000000.0 * spent / count, 100 * found.success.mean(),
        )  # fmt: skip


@figures("benchmarks/ik.md", "Pink, mink; RoboPlan's interpreter", count=20, alone=True)
def ik(count=1_000, classes="abcde", alone=False, roboplan_python="") -> Iterator:
    """Inverse kinematics beside its peers.

    Targets are reachable by construction: those of joint positions drawn evenly within the limits.  Solved
    means less than 1 mm and 0.5 degrees away, within the limits, judged here from q.  All solvers take the
    targets in turns of 50, and are judged after each turn; times are those of one call, from Python, and
    ratios are medians over the targets.  Our tasks are made before; what the peers' own loops set up for a
    target counts as theirs.  "From the first start" is what is solved without restarts; placo, Pink and mink
    have none, but Pink is also begun again by a loop around it.

    A peer that is not installed is left out with a message: `pip install --no-deps pin-pink qpsolvers daqp
    loop-rate-limiters mink`, so that `pin` stays as it is.  RoboPlan needs an environment of its own, named
    by `--roboplan-python PATH`, and a process of its own, where its calls are timed.
    """
    logging.getLogger().setLevel(logging.ERROR)  # Pink warns at every step that ends on a limit
    solvers, first = {OURS: ours(RESTARTS)}, {OURS: ours(0)}
    if not alone:
        peers = {
            "placo, lean loop": peer(lean_placo),
            "Pink, daqp": peer(lean_pink, "daqp"),
            f"Pink, daqp, {RESTARTS} restarts": peer(lean_pink, "daqp", RESTARTS),
            "Pink, proxqp": peer(lean_pink, "proxqp"),
            "mink, daqp": peer(lean_mink),
            "RoboPlan, simple IK": peer(Roboplan, roboplan_python, RESTARTS),
        }
        solvers |= {name: solve for name, solve in peers.items() if solve is not None}
        if "Pink, daqp" in solvers:
            first[f"Pink, daqp, {RESTARTS} restarts"] = solvers["Pink, daqp"]
        if "RoboPlan, simple IK" in solvers:
            first["RoboPlan, simple IK"] = Roboplan(roboplan_python, 0)
    for kind in classes:
        targets = cases(count, seed=ord(kind), clear=kind == "e")
        for solve in (*solvers.values(), *first.values()):
            solve(kind, targets[0])
        yield from measure(kind, solvers, first, targets)
    for solve in (*solvers.values(), *first.values()):
        if isinstance(solve, Roboplan):
            solve.close()
    yield from batches(10 * count)


TOLERANCE = 1e-3


def reachable(scene: pk.Scene | None, count: int, generator: np.random.Generator) -> np.ndarray:
    """Return places of the hand in postures that touch nothing, shape (count, 3) [m]."""
    found = np.empty((0, 3))
    while len(found) < count:
        q = generator.uniform(LOW, HIGH, (4096, PEPPER.n))
        q = q[~pk.collision.in_collision(PEPPER, q, scene)]
        found = np.concatenate([found, pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]])
    return found[:count]


def is_clear(scene: pk.Scene, q: np.ndarray, point: np.ndarray) -> bool:
    """Whether q puts the hand there, within the limits, and touches nothing, which coal says."""
    place = pk.kinematics.frame_pose(PEPPER, q, LEFT)[:3, 3]
    within = bool(((q >= LOW) & (q <= HIGH)).all())
    return (
        within
        and float(np.linalg.norm(place - point)) <= TOLERANCE
        and not bool(checker_for(PEPPER, scene).in_collision(q))
    )


def clear_search(scene: pk.Scene, point: np.ndarray, starts: int, seed: int) -> bool:
    """Whether descents from random postures find one that is clear."""
    task, generator = pk.ik.HandPosition("left", point), np.random.default_rng(seed)
    q0 = PEPPER.neutral()
    for _ in range(0, starts, 500):
        drawn = generator.uniform(LOW, HIGH, (500, PEPPER.n))
        found = solutions_from(PEPPER, [task], q0, None, drawn, 150)
        free = np.array(found)[~pk.collision.in_collision(PEPPER, found, scene)] if found else []
        if any(is_clear(scene, q, point) for q in free):
            return True
    return False


@figures("benchmarks/ik.md", count=20, long=500)
def ik_clear(count: int = 1_000, long: int = 10_000) -> Iterator[tuple]:
    """IK that touches nothing.

    Places of the left hand, clear of the robot's own body, and of the body and ten boxes.  Targets are where
    the hand is in random postures that touch nothing: they can be solved.  A tenth as many more are random
    points around the robot; whether they can be solved is told by a long search of another kind: descents
    without collisions from random postures of the whole body, each end judged by coal.  What is solved is
    judged by coal and by the hand's place.  Times are processor time of one call from Python; `--long 0`
    leaves the long search, of so many starts, out.
    """
    anywhere = np.random.default_rng(2).uniform((-0.7, -0.8, 0.1), (0.9, 1.0, 1.6), (max(count // 10, 1), 3))
    worlds = {"the body": pk.Scene(), "the body and ten boxes": ten_boxes()}
    for (name, scene), what in itertools.product(worlds.items(), ("reachable", "anywhere")):
        points = reachable(scene, count, np.random.default_rng(1)) if what == "reachable" else anywhere
        times, missed, touching = Times(), 0, 0
        pk.ik.solve(PEPPER, pk.ik.HandPosition("left", points[0]), scene=scene)
        for number, point in enumerate(points):
            result, spent = timed(pk.ik.solve, PEPPER, pk.ik.HandPosition("left", point), scene=scene)
            times["solved" if result.success else "not"].append(spent)
            if result.success:
                touching += not is_clear(scene, result.q, point)
            elif what == "reachable":
                missed += 1
            elif long and result.status is pk.ik.IKStatus.CLOSEST_COLLISION:
                missed += clear_search(scene, point, long, number)
        solved = len(times["solved"])
        median, p99, most = times.at("solved", 50, 99, 100) if solved else (np.nan,) * 3
        yield (
            "clear of | targets | can be solved | of these solved [%] {:.2f} | of these touching | median "
            "[ms] {:.3f} | p99 [ms] {:.2f} | longest [ms] {:.1f} | not solved: median [ms]",
            f"{name}, {what}", len(points), solved + missed, 100 * solved / max(solved + missed, 1), touching,
            median, p99, most, f"{times.at('not'):.1f}" if times["not"] else "–",
        )  # fmt: skip


LEAST, MOST = (-0.5, -1.0, 0.0), (1.0, 1.0, 1.7)
PIECE, SHARE = 1000, 0.03
FEW = 8
"""Restarts of those kinds that have few."""


def unsolvable(count: int, generator: np.random.Generator) -> np.ndarray:
    """Return points of the box that are not reached [m], shape (count, 3)."""
    points = generator.uniform(LEAST, MOST, (2 * count + 50, 3))
    return points[~solve(points, closest=False).success][:count]


def solve(points: np.ndarray, *, closest: bool, restarts: int = 32) -> BatchResult:
    task = pk.ik.HandPosition("left", points)
    return pk.ik.solve_batch(PEPPER, task, closest=closest, restarts=restarts)


@figures("ik.md", rows=1000, long=100)
def ik_rows(rows: int = 20_000, long: int = 2_000, seed: int = 0) -> Iterator[tuple | str]:
    """Rows of a dataset of IK solutions, some of which cannot be solved.

    Reachable targets are where the left hand is in random postures clear of self-collision.  Others are drawn
    evenly in a box around the robot and kept where `solve_batch` finds no solution; they are mixed in
    between.  Collisions are examined.  Each kind is measured in turn, a thousand rows at a time, in processor
    time.  Then all rows, `long` of them in the table, are solved with the search for the closest
    configuration too, and what is solved is compared; and as many points of the box with few restarts and
    with all.
    """
    generator = np.random.default_rng(seed)
    solvable = reachable(None, rows, generator)
    mixed = solvable.copy()
    places = generator.permutation(rows)[: round(SHARE * rows)]
    mixed[places] = unsolvable(places.size, generator)
    kinds = {
        "all reachable": (solvable, False, rows, 32),
        "3 % not, `closest=False`": (mixed, False, rows, 32),
        f"all reachable, `restarts={FEW}`": (solvable, False, rows, FEW),
        f"3 % not, `closest=False, restarts={FEW}`": (mixed, False, rows, FEW),
        "3 % not, `closest=True`": (mixed, True, min(long, rows), 32),
    }
    times, reasons = Times(), Counter[str]()
    for begin in range(0, rows, PIECE):
        for name, (points, closest, count, restarts) in kinds.items():
            piece = points[begin : min(begin + PIECE, count)]
            if len(piece):
                found = times(name, solve, piece, closest=closest, restarts=restarts)
                if points is mixed and not closest and restarts != FEW:
                    proven = np.any(found.shortfalls > 1e-3, axis=1)
                    reasons.update(
                        CODES[code].value + (", proven out of reach" if sure else "")
                        for code, sure in zip(found.codes, proven, strict=True)
                    )
                    assert all(found.reason(int(row)) for row in np.flatnonzero(~found.success))
    each = {name: 1e6 * sum(times[name]) / kinds[name][2] for name in kinds}
    for name, micro in each.items():
        ratio = f"{micro / each['all reachable']:.2f}"
        yield "rows | count | us a row {:.1f} | of all reachable", name, kinds[name][2], micro, ratio
    yield str(dict(reasons))
    before = solve(solvable, closest=True)
    yield f"of {len(solvable)} reachable rows {int(before.success.sum())} are solved with closest=True"
    box = generator.uniform(LEAST, MOST, (rows, 3))
    there = solve(box, closest=False)
    for restarts in (32, FEW):
        after = solve(solvable, closest=False, restarts=restarts)
        few = there if restarts == 32 else solve(box, closest=False, restarts=restarts)
        yield (
            f"closest=False, restarts={restarts}: {int(after.success.sum())} are solved, "
            f"{int(np.sum(before.success & ~after.success))} lost, "
            f"{int(np.sum(np.all(before.q == after.q, axis=1)))} answers the same to the last bit; "
            f"of {len(box)} in the box {int(few.success.sum())} solved, "
            f"{int(np.sum(there.success & ~few.success))} lost beside 32 restarts"
        )


def blocked_targets(count: int, seed: int = 3) -> list[tuple[np.ndarray, pk.Scene]]:
    """Return points of the left hand [m], shape (3,), each with a scene that it cannot be reached in."""
    generator, found = np.random.default_rng(seed), []
    while len(found) < count:
        q = generator.uniform(LOW, HIGH, (64, PEPPER.n))
        q = q[~pk.collision.in_collision(PEPPER, q, pk.Scene())]
        for point in pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]:
            size = generator.uniform(0.1, 0.5, 3)
            middle = point + generator.uniform(-0.3, 0.3, 3) * size
            scene = pk.Scene().add_box("obstacle", size=size, position=middle)
            if generator.random() < 0.5:
                low = point + generator.uniform((-0.3, -0.3, -0.5), (0.3, 0.3, -0.2))
                scene = scene.add_box("shelf", size=(0.5, 0.6, 0.04), position=low)
            if pk.collision.in_collision(PEPPER, PEPPER.neutral(), scene):
                continue
            result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=scene)
            if result.status is IKStatus.CLOSEST_COLLISION:
                found.append((point, scene))
    return found[:count]


@figures("theory/ik.md", targets=3, seeds=2)
def ik_blocked(targets: int = 50, seeds: int = 20, known: Path | None = None) -> Iterator[str]:
    """IK of blocked targets.

    Each target is where the left hand is in a random posture, with an obstacle put around it: it is reached
    only in collision.  Asked with many seeds, `solve` should come equally close each time.  Printed are the
    spread of the distance over the seeds, and the gap to the closest that any seed came, or that the file
    `known` of earlier runs has, which is written anew.  Every answer is checked by coal.  Times are processor
    time of one call.
    """
    problems, times, touching = blocked_targets(targets), Times(), 0
    distances = np.empty((len(problems), seeds))
    for (row, (point, scene)), seed in itertools.product(enumerate(problems), range(seeds)):
        task = pk.ik.HandPosition("left", point)
        result = times("ik", pk.ik.solve, PEPPER, task, scene=scene, seed=seed)
        touching += bool(pk.collision.in_collision(PEPPER, result.q, scene))
        place = pk.kinematics.frame_pose(PEPPER, result.q, LEFT)[:3, 3]
        distances[row, seed] = np.linalg.norm(place - point)
    best = distances.min(axis=1)
    if known is not None and known.exists():
        best = np.minimum(best, json.loads(known.read_text())[: len(best)])
    if known is not None:
        known.write_text(json.dumps(best.tolist()))
    gaps, spread = 100 * (distances - best[:, None]), 100 * np.ptp(distances, axis=1)
    yield f"{len(problems)} targets, {seeds} seeds; {touching} answers touch"
    yield f"spread over seeds: median {np.median(spread):.2f} cm, largest {spread.max():.2f} cm"
    yield (
        f"gap to the best known: mean {gaps.mean():.2f} cm, median {np.median(gaps):.2f}, "
        f"90 % {np.quantile(gaps, 0.9):.2f}, largest {gaps.max():.2f} cm; "
        f"within 5 mm: {100 * np.mean(gaps <= 0.5):.1f} %"
    )
    mean, (median, most) = 1e3 * np.mean(times["ik"]), times.at("ik", 50, 100)
    yield f"time: median {median:.1f} ms, mean {mean:.1f}, largest {most:.1f} ms"


STARTS = 64


@figures("ik.md", count=20)
def ik_at_rest(count: int = 1000) -> Iterator[str]:
    """How many solutions of `ik.solve` a plan may end at, over hand positions all over the workspace."""
    pepper, rng, times = pk.load_pepper(), np.random.default_rng(0), Times()
    kept, torque, more, solved = 0, 0, 0, 0
    share, balance = pepper.requirements.holding_share, pepper.requirements.balance
    motors = pk.ik.HoldingTorque(share, tolerance=1e-4)
    wheels = pk.ik.CenterOfMassOverWheels(balance + ROOM_TO_MOVE, tolerance=1e-4)
    while solved < count:
        q = rng.uniform(pepper.lower_limits, pepper.upper_limits)
        if pk.collision.in_collision(pepper, q):
            continue
        hand, frame = (("right", "r_gripper"), ("left", "l_gripper"))[solved % 2]
        reach = pk.ik.HandPosition(hand, pk.kinematics.frame_pose(pepper, q, frame)[:3, 3])
        found = times("ik", pk.ik.solve, pepper, reach)
        solved += 1
        if found.success and rests(pepper, found.q, balance, ()):
            kept += 1
            continue
        torque += not holds(pepper, found.q, ())
        more += pk.ik.solve(pepper, [reach, motors, wheels], restarts=STARTS).success
    yield f"{count} hand positions: {kept} end at rest as motions keep it, {torque} lack torque"
    yield f"of the {count - kept} others {STARTS} starts with both as tasks find {more}"
    mean = 1e3 * np.mean(times["ik"][5:])
    yield f"processor time: median {times.at('ik'):.3f} ms, mean {mean:.3f} ms"


Array = NDArray[np.float64]
CENTER = np.array([0.0, 0.0, 0.9])
FARTHEST = 3.0
ALLOWED = 5e-3  # [m]
LONG_STARTS, LONG_STEPS, POLISHED = 200, 60, 10


def used_joints() -> NDArray[np.int64]:
    """Return the places of the joints that move the hand."""
    jacobian = pk.kinematics.frame_jacobian(PEPPER, 0.5 * (LOW + HIGH) + 0.1, LEFT)[:3]
    return np.flatnonzero(np.abs(jacobian).max(axis=0) > 1e-9)


MOVING = used_joints()
LOWEST, HIGHEST = LOW[MOVING], HIGH[MOVING]


def whole(x: Array) -> Array:
    """Return joint vectors (..., n) of the joints that move the hand, shape (..., k)."""
    q = np.zeros((*x.shape[:-1], PEPPER.n))
    q[..., MOVING] = x
    return q


def hand(x: Array) -> Array:
    return pk.kinematics.frame_pose(PEPPER, whole(x), LEFT)[..., :3, 3]


def slope_of(x: Array) -> Array:
    return pk.kinematics.frame_jacobian(PEPPER, whole(x), LEFT)[..., :3, MOVING]


def projected_descents(target: Array, x: Array) -> Array:
    """Return where damped Gauss-Newton steps, cut off at the limits, lead from each start, shape (s, k).

    Joints at a limit that the gradient pushes against rest (Bertsekas, Projected Newton methods for
    optimization problems with simple constraints, 1982).
    """
    damping = np.full(len(x), 1e-2)
    residual = hand(x) - target
    cost = np.sum(residual**2, axis=1)
    eye = np.eye(x.shape[1])
    for _ in range(LONG_STEPS):
        jacobian = slope_of(x)
        gradient = np.einsum("sik,si->sk", jacobian, residual)
        rests = ((x <= LOWEST + 1e-9) & (gradient > 0)) | ((x >= HIGHEST - 1e-9) & (gradient < 0))
        jacobian = np.where(rests[:, None, :], 0.0, jacobian)
        matrix = np.einsum("sik,sij->skj", jacobian, jacobian) + damping[:, None, None] * eye
        step = np.linalg.solve(matrix, np.where(rests, 0.0, -gradient)[..., None])[..., 0]
        trial = np.clip(x + step, LOWEST, HIGHEST)
        trial_residual = hand(trial) - target
        trial_cost = np.sum(trial_residual**2, axis=1)
        better = trial_cost < cost
        x, residual = np.where(better[:, None], trial, x), np.where(better[:, None], trial_residual, residual)
        cost = np.where(better, trial_cost, cost)
        damping = np.clip(np.where(better, damping / 3, damping * 4), 1e-7, 1e4)
    return x


def long_search(target: Array, generator: np.random.Generator) -> float:
    """Return the least distance of the hand to a target that many starts lead to [m]."""
    ends = projected_descents(target, generator.uniform(LOWEST, HIGHEST, (LONG_STARTS, MOVING.size)))
    order = np.argsort(np.sum((hand(ends) - target) ** 2, axis=1))

    def cost(x: Array) -> tuple[float, Array]:
        residual = hand(x) - target
        return 0.5 * float(residual @ residual), slope_of(x).T @ residual

    bounds = list(zip(LOWEST, HIGHEST, strict=True))
    least = math.inf
    for k in order[:POLISHED]:
        found = minimize(cost, ends[k], jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 50})
        least = min(least, math.sqrt(2 * found.fun), math.dist(hand(ends[k]), target))
    return least


@figures("benchmarks/ik.md", count=5)
def ik_unreachable(count: int = 1_000, seed: int = 0) -> Iterator[tuple]:
    """Closest points of targets out of reach, beside a long search.

    Random targets up to 3 m from a point between the shoulders; most are beyond reach, some behind the robot
    or inside it.  The answer of one call (`pk.ik.solve`, collisions left out) is compared with a search of
    another kind that shares only the kinematics: projected Gauss-Newton from 200 random starts at once in
    NumPy, the best ten then each brought to their end by SciPy's L-BFGS-B.  An answer counts where its hand
    is at most 5 mm farther from the target.  The long search takes about 0.3 s a target.
    """
    generator, times, difference = np.random.default_rng(seed), Times(time.perf_counter), []
    pk.ik.solve(PEPPER, pk.ik.HandPosition("left", CENTER), collisions=False)
    direction = generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for target in CENTER + direction * generator.uniform(0.0, FARTHEST, (count, 1)):
        result, spent = timed(
            pk.ik.solve, PEPPER, pk.ik.HandPosition("left", target), collisions=False, clock=time.perf_counter
        )
        if not np.all((result.q >= LOW) & (result.q <= HIGH)):
            raise SystemExit(f"an answer left the limits: target {target}")
        ours = math.dist(hand(result.q[MOVING]), target)
        if not (result.success and ours < 1e-3):
            other = long_search(target, generator)
        if not result.success:
            times["call"].append(spent)
            difference.append(ours - other)
    median, p99 = times.at("call", 50, 99, unit=1e6)
    off = np.array(difference)
    yield (
        "targets | reached | others within 5 mm of the long search [%] {:.2f} | worst [mm] {:.1f} | closer "
        "than the long search by over 1 mm | median of a call [us] {:.0f} | 99th percentile [us] {:.0f}",
        count, count - off.size, 100 * np.mean(off <= ALLOWED), 1000.0 * off.max(), np.sum(off < -1e-3),
        median, p99,
    )  # fmt: skip


N = PEPPER.n
SCIPY_STARTS, FIRM, ROWS = 30, 100.0, 32
SCALE = 1e4  # of the cost, beside which L-BFGS-B's tolerances are small


def problem_of_kind(kind: int, generator: np.random.Generator) -> list[pk.ik.Task | pk.ik.TaskGroup]:
    """Return tasks with random targets, most of which cannot be met together."""

    def point() -> np.ndarray:
        direction = generator.normal(size=3)
        return (0, 0, 0.9) + direction / np.linalg.norm(direction) * generator.uniform(0.2, 1.5)

    def weight() -> float:
        return float(10 ** generator.uniform(-2, 0))

    def hand(side: str, counts: float | None = None) -> pk.ik.Task:
        return pk.ik.HandPosition(side, point(), weight=counts or weight())

    def pose(side: str) -> pk.ik.TaskGroup:
        target = np.eye(4)
        target[:3, :3], target[:3, 3] = Rotation.random(None, generator).as_matrix(), point()
        weights = {"weight": weight(), "orientation_weight": weight()}
        return pk.ik.HandPose(side, target, **weights, position_first=False)

    kinds: tuple[Callable[[], list[pk.ik.Task | pk.ik.TaskGroup]], ...] = (
        lambda: [hand("left"), hand("right")],
        lambda: [hand("left", 10.0), pk.ik.LookAt(point(), weight=0.1)],
        lambda: [hand("left", 0.1), pk.ik.LookAt(point(), weight=10.0)],
        lambda: [pose("left")],
        lambda: [pose("left"), pose("right")],
        lambda: [hand("left"), hand("right"), pk.ik.LookAt(point(), weight=weight())],
        lambda: [hand("left"), pk.ik.Point("left", generator.normal(size=3), weight=weight())],
        lambda: [
            hand("left"),
            hand("right"),
            pk.ik.CenterOfMass(generator.uniform(-0.1, 0.1, 2), weight=weight()),
        ],
    )
    return kinds[kind % len(kinds)]()


class NearPairs:
    """Shortages of the distances of bodies nearer than 5 mm, and slopes of the distances."""

    def __init__(self) -> None:
        self._collisions = Collisions(PEPPER, pk.Scene())
        tests = self._collisions.tests(np.zeros(8, np.int64))
        self._near = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)(tests.near)
        self._memory, self._rows = tests.near_memory, np.zeros((ROWS, N + 2))

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return shortages [m], shape (k,), and slopes, shape (k, n)."""
        q = np.ascontiguousarray(q)
        count = self._near(q.ctypes.data, self._rows.ctypes.data, ROWS, self._memory)
        return self._rows[:count, N], self._rows[:count, :N]


def least_cost(problem: TaskProblem, near: NearPairs | None, generator: np.random.Generator) -> float:
    """Return the least weighted cost that SciPy ends at."""
    index = np.arange(N) if near else np.flatnonzero(problem.movable)
    low, high = LOW[index], HIGH[index]
    checker, least = checker_for(PEPPER, pk.Scene()), math.inf

    def whole_of(x: np.ndarray) -> np.ndarray:
        q = problem.q0.copy()
        q[index] = x
        return q

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        q = whole_of(x)
        residual = problem.stack(problem.residuals(q))
        value, slope = 0.5 * float(residual @ residual), problem.jacobian(q).T @ residual
        if near:
            shortages, slopes = near(q)
            value += 0.5 * FIRM**2 * float(shortages @ shortages)
            slope -= FIRM**2 * slopes.T @ shortages
        return SCALE * value, SCALE * slope[index]

    bounds = list(zip(low, high, strict=True))
    for _ in range(SCIPY_STARTS):
        start = generator.uniform(low, high)
        end = whole_of(minimize(cost, start, jac=True, bounds=bounds, options={"maxiter": 300}).x)
        value = problem.task_cost(problem.residuals(end))
        if value < least and not (near and bool(checker.in_collision(end))):
            least = value
    return least


@figures("benchmarks/ik.md", count=8)
def ik_weights(count: int = 200, seed: int = 0) -> Iterator[tuple]:
    """Closest postures under unequal weights, beside SciPy.

    Problems of several tasks of different weights that no posture meets together, eight kinds in turn: hands,
    gazes, directions, orientations and centers of mass, with weights from 0.01 to 1 or of 10 and 0.1.  The
    weighted cost of the answer of `pk.ik.solve` is compared with the least that SciPy's L-BFGS-B ends at from
    30 random starts.  It descends on residuals and Jacobians from Pinocchio.

    Self-collision off, both move the joints of the tasks.  Self-collision on, in a quarter as many problems,
    SciPy moves all joints, and its cost has a term for each pair of bodies nearer than 5 mm, which `solve`
    keeps too where it can; of its ends those count that touch nothing, which coal says.
    """
    for near, problems in ((None, count), (NearPairs(), max(count // 4, 1))):
        generator, ratios, times, number = np.random.default_rng(seed), [], Times(), 0
        while len(ratios) < problems:
            tasks = problem_of_kind(number, generator)
            number += 1
            result, spent = timed(pk.ik.solve, PEPPER, tasks, collisions=near is not None)
            if result.success:
                continue
            if near is not None and result.in_collision:
                raise SystemExit(f"an answer touches something: {result.report()}")
            parts = balanced(flatten_tasks(PEPPER, tasks))
            problem = make_problem(PEPPER, parts, PEPPER.neutral(), np.ones(N, dtype=bool), keep_idle=True)
            best = least_cost(problem, near, generator)
            ratios.append((problem.task_cost(problem.residuals(result.q)) + 1e-10) / (best + 1e-10))
            times["call"].append(spent)
        of, (median, p99) = np.array(ratios), times.at("call", 50, 99)
        yield (
            "self-collision | problems | over 2 % above SciPy's best | highest, of it {:.3f} | over 2 % "
            "below | median of a call [ms] {:.1f} | p99 [ms] {:.1f}",
            "on" if near else "off", problems, np.sum(of > 1.02), of.max(), np.sum(of < 0.98), median, p99,
        )  # fmt: skip
