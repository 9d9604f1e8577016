"""Optimized motions beside sample + shortcut + retime, and beside general solvers."""

import time
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from harness import Times, figures, timed

import pepper_kin as pk
from pepper_kin.collision import checker_for
from pepper_kin.motion import Cost, Optimized, optimize
from pepper_kin.motion.static_limits import StaticLimits

PEPPER = pk.load_pepper().with_requirements("limits")
TABLE = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
JERK = Cost().jerk
CHECKED = (
    "position", "velocity", "acceleration", "torque", "velocity_continuity", "obstacle_clearance",
    "self_clearance",
)  # fmt: skip


class Row(NamedTuple):
    """A problem: its plan, whether the straight line collides, times, result, duration retimed, verdicts."""

    planned: pk.motion.Plan
    detour: bool
    plan: float
    retime: float
    processor: float
    found: Optimized
    again: float
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
    wall = {"clock": time.perf_counter}
    plan, planning = timed(pk.plan, PEPPER, start, goal, TABLE, timeout=10.0, **wall)
    if not plan.success:
        return None
    _, retiming = timed(pk.retime, PEPPER, plan.path, **wall)
    found, processor = timed(optimize, PEPPER, plan, TABLE, cost=cost)
    again = pk.retime(PEPPER, found.trajectory).duration if found.success else found.figures.duration
    check, before = found.trajectory.check(PEPPER, TABLE), found.before.check(PEPPER)
    straight = start + np.linspace(0, 1, 200)[:, None] * (goal - start)
    hits = bool(pk.collision.in_collision(PEPPER, straight, TABLE).any())
    green = all(getattr(check, part).success for part in CHECKED)
    balanced = before.balance.success, check.balance.success
    return Row(plan, hits, planning, retiming, processor, found, again, green, balanced)


def table_of(title: str, rows: list[Row]) -> Iterator[tuple | str]:
    def share(values: list[bool]) -> str:
        return f"{sum(values)} of {len(values)}"

    found = [row.found for row in rows]
    shorter, smoother = [f.shorter_by > 0.1 for f in found], [f.smoother_by > 0.1 for f in found]
    before = np.array([(f.figures_before.duration, f.figures_before.jerk) for f in found])
    after = np.array([(f.figures.duration, f.figures.jerk) for f in found])
    (planning, retiming), (d0, j0), (d1, j1) = (
        np.median(x, axis=0) for x in ([(row.plan, row.retime) for row in rows], before, after)
    )
    walls, works = [f.time for f in found], [row.processor for row in rows]
    wall, work = (1e3 * np.quantile(spent, (0.5, 0.9)) for spent in (walls, works))
    times = f"{wall[0]:.0f} ms (90 %: {wall[1]:.0f} ms; "
    times += f"processor {work[0]:.0f} ms, 90 %: {work[1]:.0f} ms)"
    ratios, jerks = (after / before).T
    again = np.median([row.again for row in rows] / before[:, 0])
    yield f"**{title}: {len(rows)} problems**"
    for row in (
        ("time, median", f"{planning:.3f} s + {retiming:.3f} s", times),
        ("duration, median", f"{d0:.3f} s", f"{d1:.3f} s"),
        ("jerk, median", f"{j0:.0f}", f"{j1:.0f}"),
        ("duration over duration, median (least, most)", 1,
         f"{np.median(ratios):.3f} ({ratios.min():.2f}, {ratios.max():.2f})"),
        ("the same, retimed along the optimized path", 1, f"{again:.3f}"),
        ("jerk over jerk, median", 1, f"{np.median(jerks):.3f}"),
        ("improved", "", share([f.success for f in found])),
        ("shorter by 10 %", "", share(shorter)),
        ("smoother by 10 %", "", share(smoother)),
        ("shorter or smoother by 10 %", "", share(np.logical_or(shorter, smoother).tolist())),
        ("certificate: limits, torque, clearance", "", share([r.green for r in rows])),
        ("balance (asked of neither)", *(share([r.balanced[k] for r in rows]) for k in (0, 1))),
    ):  # fmt: skip
        yield " | sample + shortcut + retime | + optimize", *row


def beside_references(plans: list[pk.motion.Plan], cost: Cost) -> Iterator[tuple | str]:
    """Yield how the solvers end on the same problems, and at which cost beside Newton's."""
    costs: list[float] = []
    for solver in ("newton", "ipopt", "fatrop"):
        times, timeout = Times(), 60.0 if solver == "ipopt" else None
        options = {"cost": cost, "solver": solver, "timeout": timeout}
        found = [times("optimize", optimize, PEPPER, plan, TABLE, **options) for plan in plans]
        values = [f.descent.cost if f.descent else np.inf for f in found]
        costs = costs or values
        ended = Counter(f.descent.status.value for f in found if f.descent)
        said = ", ".join(f"{count} {status}" for status, count in ended.items())
        solved = f"{sum(f.success for f in found)} of {len(found)}"
        over = np.median(np.array(values) / np.array(costs))
        yield (
            "solver | improved | searches ended | cost over newton's, median {:.4f} | processor time, "
            "median {:.0f} ms",
            solver, solved, said, over, times.at("optimize"),
        )  # fmt: skip
        yield from (f"<!-- {solver}: {f.report()} -->" for f in found if not f.success)


@figures("benchmarks/optimization.md", problems=2)
def optimize_whole_body(problems=24, jerk=JERK, seed=0, references=0) -> Iterator[tuple | str]:
    """Optimized motions against sample + shortcut + retime, whole body, beside a table.

    Start and goal are random postures of all joints that are free and can be held.  `plan` searches, shortens
    and smooths a path; `retime` gives the fastest motion along it, and `optimize`, with a weight of the jerk,
    starts from there.  All three run for each problem in turn.  Jerk is that of accelerations every 10 ms, in
    units of the joints' accelerations: `retime`'s accelerations jump.  `--references` solves the first
    problems by ipopt and fatrop, too, from the same start.
    """
    rng, cost, rows = np.random.default_rng(seed), Cost(jerk=jerk), []
    run(PEPPER.posture("Stand"), PEPPER.posture("StandZero"), cost)  # compiles what is not compiled yet
    while len(rows) < problems:
        row = run(posture(rng), posture(rng), cost)
        rows += [] if row is None else [row]
    if references:
        yield from beside_references([row.planned for row in rows[:references]], cost)
    yield from table_of("All", rows)
    for title, detour in (("The straight line is free", False), ("The straight line collides", True)):
        if some := [row for row in rows if row.detour is detour]:
            yield from table_of(title, some)
    ended = (f"{row.found.status.value} ({row.found.descent.iterations})" for row in rows)
    yield f"How they ended: {', '.join(ended)}"
