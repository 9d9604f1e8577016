"""Inverse kinematics beside its peers: python benchmarks/ik.py [--full].

Targets are reachable by construction: those of joint positions drawn evenly within the limits.  Solved means
less than 1 mm and 0.5 degrees away, within the limits, judged here from q.  All solvers take the targets in
turns of 50, and are judged after each turn; times are those of one call, from Python, and ratios are medians
over the targets.  Our tasks are made before; what the peers' own loops set up for a target counts as theirs.
"From the first start" is what is solved without restarts; placo, Pink and mink have none, but Pink is also
begun again by a loop around it.

A peer that is not installed is left out with a message: `pip install --no-deps pin-pink qpsolvers daqp
loop-rate-limiters mink`, so that `pin` stays as it is.  RoboPlan needs an environment of its own, named by
`--roboplan-python PATH`, and a process of its own, where its calls are timed.
"""

from __future__ import annotations

import argparse
import logging
import time

import numpy as np
from ik_peers import Roboplan, lean_mink, lean_pink, lean_placo, roboplan
from ik_targets import CLASSES, HIGH, LEFT, LOW, PEPPER, Case, Solver, cases, is_solved, tasks_of

import pepper_kin as pk

OURS = "pepper_kin, fast"
RESTARTS = 32
TURN = 50


def ours(restarts: int) -> Solver:
    def solve(kind: str, case: Case) -> np.ndarray:
        checked = kind == "e"
        return pk.ik.solve(PEPPER, made_tasks(kind, case), restarts=restarts, collisions=checked).q

    return solve


_tasks: dict[tuple[str, int], list[pk.ik.Task]] = {}


def made_tasks(kind: str, case: Case) -> list[pk.ik.Task]:
    """Return the tasks of a target, made when first asked for."""
    key = (kind, id(case))
    if key not in _tasks:
        _tasks[key] = tasks_of(kind, case)
    return _tasks[key]


def measure(kind: str, solvers: dict[str, Solver], first: dict[str, Solver], targets: list[Case]) -> None:
    """Print the table of one class.

    Args:
        kind: The class.
        solvers: What is timed.
        first: The same without restarts, for those that have any; not timed.
        targets: The targets.
    """
    times: dict[str, list[float]] = {name: [] for name in solvers}
    solved, at_first = dict.fromkeys(solvers, 0), dict.fromkeys(solvers, 0)
    for case in targets:
        made_tasks(kind, case)
    for number in range(0, len(targets), TURN):
        turn = targets[number : number + TURN]
        for name, solve in solvers.items():
            answers = []
            for case in turn:
                begin = time.perf_counter()
                answers.append(solve(kind, case))
                duration = time.perf_counter() - begin
                times[name].append(solve.time if isinstance(solve, Roboplan) else duration)
            solved[name] += sum(is_solved(kind, case, q) for case, q in zip(turn, answers, strict=True))
    for name in solvers:
        solve = first.get(name)
        at_first[name] = (
            solved[name]
            if solve is None
            else sum(is_solved(kind, case, solve(kind, case)) for case in targets)
        )
    base = np.array(times[OURS])
    print(f"\n({kind}) {CLASSES[kind]}, {len(targets)} targets\n")
    print("| solver | solved [%] | from the first start [%] | median [us] | p99 [us] | time / ours |")
    print("|---|---|---|---|---|---|")
    for name, found in times.items():
        micro, part = 1e6 * np.array(found), 100 / len(targets)
        print(
            f"| {name} | {part * solved[name]:.2f} | {part * at_first[name]:.2f} | {np.median(micro):.0f} | "
            f"{np.percentile(micro, 99):.0f} | {np.median(found / base):.1f} |",
            flush=True,
        )


def measure_batch(count: int) -> None:
    q = np.random.default_rng(7).uniform(LOW, HIGH, (count, PEPPER.n))
    points = pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]
    pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points[:50]), collisions=False)
    print("\n| threads | hand positions a second | CPU time each [us] | solved [%] |\n|---|---|---|---|")
    for threads in (1, 2):
        runs = []
        for _ in range(3):
            cpu = time.process_time()
            found = pk.ik.solve_batch(
                PEPPER, pk.ik.HandPosition("left", points), threads=threads, collisions=False
            )
            runs.append((found.time, time.process_time() - cpu))
        wall, cpu = min(run[0] for run in runs), min(run[1] for run in runs)
        print(
            f"| {threads} | {count / wall:.0f} | {1e6 * cpu / count:.1f} | {100 * found.success.mean():.3f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="10,000 targets per class instead of 1,000")
    parser.add_argument("--count", type=int, help="another number of targets per class")
    parser.add_argument("--classes", default="abcde")
    parser.add_argument("--alone", action="store_true", help="leave the peers out")
    parser.add_argument("--roboplan-python", help="interpreter of an environment with RoboPlan")
    arguments = parser.parse_args()
    logging.getLogger().setLevel(logging.ERROR)  # Pink warns at every step that ends on a limit
    count = arguments.count or (10_000 if arguments.full else 1_000)
    peers: dict[str, Solver | None] = {}
    if not arguments.alone:
        peers = {
            "placo, lean loop": lean_placo(),
            "Pink, daqp": lean_pink("daqp"),
            f"Pink, daqp, {RESTARTS} restarts": lean_pink("daqp", RESTARTS),
            "Pink, proxqp": lean_pink("proxqp"),
            "mink, daqp": lean_mink(),
            "RoboPlan, simple IK": roboplan(arguments.roboplan_python, RESTARTS),
        }
    solvers: dict[str, Solver] = {OURS: ours(RESTARTS)}
    solvers |= {name: peer for name, peer in peers.items() if peer is not None}
    first: dict[str, Solver] = {OURS: ours(0)}
    if "Pink, daqp" in solvers:
        first[f"Pink, daqp, {RESTARTS} restarts"] = solvers["Pink, daqp"]
    single = None
    if peers.get("RoboPlan, simple IK") is not None:
        single = roboplan(arguments.roboplan_python, 0)
    if single is not None:
        first["RoboPlan, simple IK"] = single
    for kind in arguments.classes:
        targets = cases(count, seed=ord(kind), clear=kind == "e")
        for solve in (*solvers.values(), *first.values()):
            solve(kind, targets[0])
        measure(kind, solvers, first, targets)
    for solve in (*solvers.values(), *first.values()):
        if isinstance(solve, Roboplan):
            solve.close()
    measure_batch(10 * count)


if __name__ == "__main__":
    main()
