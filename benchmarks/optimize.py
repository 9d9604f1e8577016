"""Optimized motions against sample + shortcut + retime, whole body, beside a table.

Start and goal are random postures of all joints that are free and can be held.  `plan` searches, shortens and
smooths a path; `retime` gives the fastest motion along it, and `optimize` starts from there.  All three run
for each problem in turn.  Jerk is that of accelerations every 10 ms, in units of the joints' accelerations:
`retime`'s accelerations jump.

python benchmarks/optimize.py [--problems 24] [--jerk 1e-4] [--references 6]

`--references` solves the first problems by ipopt and fatrop, too, from the same start.
"""

import argparse
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np

import pepper_kin as pk
from pepper_kin.collision import checker_for
from pepper_kin.motion import Cost, Optimized, optimize
from pepper_kin.motion.static_limits import StaticLimits

PEPPER = pk.load_pepper().with_requirements("limits")
TABLE = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
CHECKED = (
    "position",
    "velocity",
    "acceleration",
    "torque",
    "velocity_continuity",
    "obstacle_clearance",
    "self_clearance",
)


@dataclass
class Row:
    planned: pk.motion.Plan
    detour: bool  # whether the straight line collides
    plan: float
    retime: float
    optimize: float
    processor: float
    found: Optimized
    again: float  # duration after retiming along the optimized path
    green: bool
    balanced: tuple[bool, bool]


def posture(rng: np.random.Generator) -> np.ndarray:
    checker = checker_for(PEPPER, TABLE)
    while True:
        q = rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        held = StaticLimits(PEPPER).weakest(q) is None
        if held and not checker.in_collision(q) and checker.clearance(q) > 0.01:
            return q


def run(start: np.ndarray, goal: np.ndarray, cost: Cost) -> Row | None:
    begin = time.perf_counter()
    plan = pk.plan(PEPPER, start, goal, TABLE, timeout=10.0)
    planned = time.perf_counter()
    if not plan.success:
        return None
    pk.retime(PEPPER, plan.path)
    retimed = time.perf_counter()
    processor = time.process_time()
    found = optimize(PEPPER, plan, TABLE, cost=cost)
    processor = time.process_time() - processor
    again = pk.retime(PEPPER, found.trajectory).duration if found.success else found.figures.duration
    check, before = found.trajectory.check(PEPPER, TABLE), found.before.check(PEPPER)
    straight = start + np.linspace(0, 1, 200)[:, None] * (goal - start)
    hits = bool(pk.collision.in_collision(PEPPER, straight, TABLE).any())
    return Row(
        plan, hits, planned - begin, retimed - planned, found.time, processor, found, again,
        all(getattr(check, part).success for part in CHECKED),
        (before.balance.success, check.balance.success),
    )  # fmt: skip


def show(title: str, rows: list[Row]) -> None:
    def middle(values: list[float]) -> float:
        return float(np.median(values))

    def share(values: list[bool]) -> str:
        return f"{sum(values)} of {len(values)}"

    found = [row.found for row in rows]
    shorter, smoother = [f.shorter_by > 0.1 for f in found], [f.smoother_by > 0.1 for f in found]
    either = [a or b for a, b in zip(shorter, smoother, strict=True)]
    before, after = [f.figures_before for f in found], [f.figures for f in found]
    times = sorted(row.optimize for row in rows)
    print(f"\n**{title}: {len(rows)} problems**\n")
    print("| | sample + shortcut + retime | + optimize |\n|---|---|---|")
    print(
        f"| time, median | {middle([r.plan for r in rows]):.3f} s + {middle([r.retime for r in rows]):.3f} s "
        f"| {middle(times) * 1000:.0f} ms (90 %: {times[int(0.9 * len(times))] * 1000:.0f} ms; processor "
        f"{middle([r.processor for r in rows]) * 1000:.0f} ms, "
        f"90 %: {np.quantile([r.processor for r in rows], 0.9) * 1000:.0f} ms) |"
    )
    print(
        f"| duration, median | {middle([f.duration for f in before]):.3f} s "
        f"| {middle([f.duration for f in after]):.3f} s |"
    )
    print(
        f"| jerk, median | {middle([f.jerk for f in before]):.0f} | {middle([f.jerk for f in after]):.0f} |"
    )
    ratios = [f.duration / b.duration for f, b in zip(after, before, strict=True)]
    jerks = [f.jerk / b.jerk for f, b in zip(after, before, strict=True)]
    again = [row.again / b.duration for row, b in zip(rows, before, strict=True)]
    print(
        f"| duration over duration, median (least, most) | 1 "
        f"| {middle(ratios):.3f} ({min(ratios):.2f}, {max(ratios):.2f}) |"
    )
    print(f"| the same, retimed along the optimized path | 1 | {middle(again):.3f} |")
    print(f"| jerk over jerk, median | 1 | {middle(jerks):.3f} |")
    print(f"| improved | | {share([f.success for f in found])} |")
    print(f"| shorter by 10 % | | {share(shorter)} |")
    print(f"| smoother by 10 % | | {share(smoother)} |")
    print(f"| shorter or smoother by 10 % | | {share(either)} |")
    print(f"| certificate: limits, torque, clearance | | {share([r.green for r in rows])} |")
    balanced = [share([r.balanced[k] for r in rows]) for k in (0, 1)]
    print(f"| balance (asked of neither) | {balanced[0]} | {balanced[1]} |")


def show_references(plans: list[pk.motion.Plan], cost: Cost) -> None:
    """Print how the solvers end on the same problems, and at which cost beside Newton's."""
    print("\n| solver | improved | searches ended | cost over newton's, median | processor time, median |")
    print("|---|---|---|---|---|")
    costs: list[float] = []
    for solver in ("newton", "ipopt", "fatrop"):
        found, times = [], []
        for plan in plans:
            begin = time.process_time()
            timeout = 60.0 if solver == "ipopt" else None
            found.append(optimize(PEPPER, plan, TABLE, cost=cost, solver=solver, timeout=timeout))
            times.append(time.process_time() - begin)
        values = [f.descent.cost if f.descent else np.inf for f in found]
        costs = costs or values
        over = np.median(np.array(values) / np.array(costs))
        ended = Counter(f.descent.status.value for f in found if f.descent)
        said = ", ".join(f"{count} {status}" for status, count in ended.items())
        print(
            f"| {solver} | {sum(f.success for f in found)} of {len(found)} | {said} | {over:.4f} "
            f"| {1e3 * np.median(times):.0f} ms |"
        )
        for f in found:
            if not f.success:
                print(f"<!-- {solver}: {f.report()} -->")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=24)
    parser.add_argument("--jerk", type=float, default=Cost().jerk, help="weight of the jerk")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--references", type=int, default=0, help="problems for ipopt and fatrop, too")
    arguments = parser.parse_args()
    rng, cost = np.random.default_rng(arguments.seed), Cost(jerk=arguments.jerk)
    run(PEPPER.posture("Stand"), PEPPER.posture("StandZero"), cost)  # compiles what is not compiled yet
    rows: list[Row] = []
    while len(rows) < arguments.problems:
        row = run(posture(rng), posture(rng), cost)
        if row is not None:
            rows.append(row)
    if arguments.references:
        show_references([row.planned for row in rows[: arguments.references]], cost)
    show("All", rows)
    for title, detour in (("The straight line is free", False), ("The straight line collides", True)):
        some = [row for row in rows if row.detour is detour]
        if some:
            show(title, some)
    print("\nHow they ended: ", end="")
    print(", ".join(f"{row.found.status.value} ({row.found.descent.iterations})" for row in rows))


if __name__ == "__main__":
    main()
