"""The main job by this library's own code and by Pinocchio, placo, coal and toppra, problem by problem.

    python benchmarks/both_chains.py [--problems 200] [--cases 10000]
    python benchmarks/both_chains.py --kinds ik --part 1/8 --save ik1.jsonl     # a part, in minutes
    python benchmarks/both_chains.py --tables *.jsonl                           # the tables of parts

From Stand a hand reaches for points over a table, and the gaze follows.  Both chains solve each problem;
each motion is certified by both.  Then single steps are compared on the same random cases.
"""

import argparse
import json
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin import collision, dynamics, ik

CHAINS = {name: pk.load_pepper().with_solvers(name) for name in ("fast", "reference")}
LOW, HIGH = (0.30, -0.30, 0.78), (0.50, 0.35, 1.00)
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
STEPS = ("ik.solve", "plan", "retime", "check", "Twin.execute")
TIE = 1e-6
"""Distance to what touches below which verdicts may differ [m]."""


def hand_for(point: np.ndarray) -> str:
    """Return the hand on whose side a point is."""
    return "left" if point[1] > 0 else "right"


def reach(chain: str, point: np.ndarray) -> dict:
    """Return what a chain made of a problem, and the times of its steps [s]."""
    pepper, made = CHAINS[chain], {"certified": False}
    hand, start = hand_for(point), pepper.posture("Stand")
    tasks = [ik.HandPosition(hand, point), ik.LookAt(point)]

    def timed(step, function, *arguments, **options):
        begin = time.perf_counter()
        found = function(*arguments, **options)
        made[step] = time.perf_counter() - begin
        return found

    timed("ik.solve", ik.solve, pepper, tasks, start, scene=TABLE)
    plan = timed("plan", pk.plan, pepper, start, tasks, TABLE)
    if not plan.success:
        return made | {"why": plan.message}
    motion = timed("retime", pk.retime, pepper, plan)
    certificate = timed("check", motion.check, pepper, TABLE)
    run = timed("Twin.execute", pk.Twin(pepper).execute, motion, hold_time=0.5)
    other = CHAINS["fast" if chain == "reference" else "reference"]
    if not (certificate.success and motion.check(other, TABLE).success):
        return made | {"why": certificate.report()}
    frame = "LArm_effector" if hand == "left" else "RArm_effector"
    palm = pk.kinematics.frame_pose(CHAINS["fast"], run.position[-1], frame)[:3, 3]
    twin = pk.Twin(other).execute(motion, hold_time=0.5)
    return made | {
        "certified": True,
        "hand error [m]": float(np.linalg.norm(palm - point)),
        "duration [s]": motion.duration,
        "other twin's distance [rad]": float(np.abs(twin.position - run.position).max()),
    }


def problems(count: int, rows: slice) -> Iterator[dict]:
    """Yield what both chains made of each problem."""
    for point in np.random.default_rng(5).uniform(LOW, HIGH, (count, 3))[rows]:
        yield {chain: reach(chain, point) for chain in CHAINS}


def postures(count: int) -> np.ndarray:
    """Return random joint positions [rad], shape (count, n)."""
    fast = CHAINS["fast"]
    return np.random.default_rng(0).uniform(fast.lower_limits, fast.upper_limits, (count, fast.n))


def of_dynamics(count: int, rows: slice) -> Iterator[dict]:
    """Yield differences of dynamics, of the greatest value that an entry has in any case."""
    fast, other = CHAINS.values()
    q, (v, a) = postures(count), np.random.default_rng(1).normal(size=(2, count, fast.n))
    offs = {}
    for function, inputs in (
        (dynamics.inverse_dynamics, (q, v, a)),
        (dynamics.forward_dynamics, (q, v, a)),
        (dynamics.mass_matrix, (q,)),
    ):
        ours, theirs = function(fast, *inputs), function(other, *inputs)
        size = np.abs(theirs).max(axis=0, keepdims=True)
        off = np.abs(ours - theirs) / np.maximum(size, 1e-3 * size.max())
        offs[function.__name__] = off.reshape(count, -1).max(axis=1)[rows]
    for k in range(len(q[rows])):
        yield {name: float(off[k]) for name, off in offs.items()}


def of_collisions(count: int, rows: slice) -> Iterator[dict]:
    """Yield whether the verdicts differ, and if so by what distance [m]."""
    fast = CHAINS["fast"]
    for q in postures(count)[rows]:
        differs = len({bool(collision.in_collision(pepper, q, TABLE)) for pepper in CHAINS.values()}) > 1
        yield {"differs": differs, "distance": float(collision.clearance(fast, q, TABLE)) if differs else 0.0}


def of_ik(count: int, rows: slice) -> Iterator[dict]:
    """Yield what `met` does of places of the left palm in random postures that touch nothing."""
    fast, q = CHAINS["fast"], postures(3 * count)
    free = q[~collision.in_collision(fast, q)][:count]
    yield from met(pk.kinematics.frame_pose(fast, free, "LArm_effector")[:, :3, 3][rows])


def of_ik_in_box(count: int, rows: slice) -> Iterator[dict]:
    """Yield what `met` does of places over the table, on both sides, of which not all can be reached."""
    yield from met(np.random.default_rng(2).uniform(LOW, HIGH, (count, 3))[: count // 4][rows])


def met(points: np.ndarray) -> Iterator[dict]:
    """Yield which chain's left hand meets points, shape (m, 3) [m]; where only one does, what helps.

    That a target is met is what the certificate says, which computes the pose from the joint positions.
    """
    ours, theirs = CHAINS.values()
    start = ours.posture("Stand")
    for point in points:
        task = ik.HandPosition("left", point)
        case = {name: ik.solve(one, task, start).success for name, one in CHAINS.items()}
        if case["fast"] and not case["reference"]:
            case["in collision"] = ik.solve(theirs, task, start, collisions=False).success
        if case["reference"] and not case["fast"]:
            case["with 320 restarts"] = ik.solve(ours, task, start, restarts=320).success
        yield case


def of_timing(count: int, rows: slice) -> Iterator[dict]:
    """Yield the difference of the durations of a straight path, as a part; None where none is feasible.

    Where one chain finds a motion, whether the path passes a posture that cannot be held at rest.
    """
    fast, q = CHAINS["fast"], 0.5 * postures(2 * count)
    for ends in q.reshape(count, 2, -1)[rows]:
        path, times = np.clip(ends, fast.lower_limits, fast.upper_limits), []
        for pepper in CHAINS.values():
            try:
                times.append(pk.retime(pepper, path, balance=None).duration)
            except pk.exceptions.InfeasibleError:
                times.append(np.inf)
        feasible = np.isfinite(times)
        if feasible.all():
            yield {"off": abs(times[1] / times[0] - 1.0)}
            continue
        torque = dynamics.gravity_torque(fast, np.linspace(*path, 1000))
        most = fast.requirements.torque_scale * fast.effort_limits
        yield {"off": None, "by one": bool(feasible.any()), "not held": bool((np.abs(torque) > most).any())}


KINDS = {
    "problems": problems, "dynamics": of_dynamics, "collisions": of_collisions, "ik": of_ik,
    "ik in a box": of_ik_in_box, "timing": of_timing,
}  # fmt: skip


def print_problems(rows: list[dict]) -> None:
    """Print the tables of the main job."""
    print("| step, median [ms] | this library | by the field's | ratio |\n|---|---|---|---|")
    of = {chain: [row[chain] for row in rows] for chain in CHAINS}
    totals = {
        chain: [sum(row.get(step, np.nan) for step in STEPS[1:]) for row in of[chain]] for chain in CHAINS
    }
    for step in STEPS:
        medians = [1e3 * np.median([row[step] for row in of[chain] if step in row]) for chain in CHAINS]
        print(f"| `{step}` | {medians[0]:.2f} | {medians[1]:.1f} | {medians[1] / medians[0]:.0f} |")
    medians = [1e3 * np.nanmedian(totals[chain]) for chain in CHAINS]
    ratio = medians[1] / medians[0]
    print(f"| from `plan` to `Twin.execute` | {medians[0]:.1f} | {medians[1]:.0f} | {ratio:.0f} |")
    print("\n| | this library | by the field's |\n|---|---|---|")
    good = {chain: [row for row in of[chain] if row["certified"]] for chain in CHAINS}
    print(f"| certified by both, of {len(rows)} | {' | '.join(str(len(good[chain])) for chain in CHAINS)} |")
    for quantity in ("hand error [m]", "other twin's distance [rad]"):
        most = (f"{max(one[quantity] for one in good[chain]):.1e}" for chain in CHAINS)
        print(f"| {quantity}, most | {' | '.join(most)} |")
    medians = (f"{np.median([one['duration [s]'] for one in good[chain]]):.3f}" for chain in CHAINS)
    print(f"| duration [s], median | {' | '.join(medians)} |")
    for chain in CHAINS:
        for row in of[chain]:
            if not row["certified"]:
                print(f"\nNot certified, {chain}: {row['why']}")


def print_cases(found: dict[str, list[dict]]) -> None:
    """Print the table of single steps, as far as they were compared."""
    print("\n| step | cases | greatest difference | unexplained |\n|---|---|---|---|")
    rows = found.get("dynamics", [])
    for name in rows[0] if rows else ():
        off = np.array([row[name] for row in rows])
        print(f"| `{name}`, relative | {len(off)} | {off.max():.1e} | {int((off > 1e-10).sum())} |")
    if rows := found.get("collisions"):
        apart = np.array([abs(row["distance"]) for row in rows if row["differs"]])
        ties = int((apart < TIE).sum())
        print(f"| `in_collision` | {len(rows)} | {len(apart)} differ, ties: {ties} | {len(apart) - ties} |")
    for kind in ("ik", "ik in a box"):
        if rows := found.get(kind):
            ours, theirs = ([row[chain] for row in rows] for chain in CHAINS)
            aside = [row["in collision"] for row in rows if "in collision" in row]
            more = [row["with 320 restarts"] for row in rows if "with 320 restarts" in row]
            print(
                f"| `{kind}`, met to 1 mm | {len(rows)} | {sum(map(min, ours, theirs))} by both; "
                f"{len(aside)} by ours only, of which placo meets {sum(aside)} in collision; "
                f"{len(more)} by placo only, of which ours meets {sum(more)} with 320 restarts | "
                f"{len(aside) - sum(aside) + len(more) - sum(more)} |"
            )
    if rows := found.get("timing"):
        off = np.array([row["off"] for row in rows if row["off"] is not None])
        single = [row["not held"] for row in rows if row.get("by one")]
        print(
            f"| `retime`, relative | {len(rows)} | {off.max():.1e}; none possible: "
            f"{len(rows) - len(off) - len(single)}; by one chain only: {len(single)}, "
            f"of which past a posture that cannot be held at rest: {sum(single)} | "
            f"{int((off > 2e-3).sum()) + len(single) - sum(single)} |"
        )


def main() -> None:
    """Print the tables of the page on the field's solvers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=[*KINDS])
    parser.add_argument("--part", default="1/1", help="every N-th row from the K-th on, as K/N")
    parser.add_argument("--save", type=Path, help="file of rows to write; nothing is printed")
    parser.add_argument("--tables", type=Path, nargs="+", help="files of rows to print the tables of")
    arguments = parser.parse_args()
    first, step = map(int, arguments.part.split("/"))
    found: dict[str, list[dict]] = {}
    for path in arguments.tables or ():
        for line in path.read_text("utf-8").splitlines():
            row = json.loads(line)
            found.setdefault(row.pop("kind"), []).append(row)
    if not arguments.tables:
        for kind in arguments.kinds:
            count = arguments.problems if kind == "problems" else arguments.cases
            found[kind] = list(KINDS[kind](count, slice(first - 1, None, step)))
    if arguments.save:
        lines = [json.dumps({"kind": kind} | row) for kind, rows in found.items() for row in rows]
        arguments.save.write_text("\n".join(lines) + "\n", "utf-8")
        return
    names = ("pin", "coal", "placo", "proxsuite", "toppra")
    print(", ".join(f"{name} {version(name)}" for name in names), "\n")
    if "problems" in found:
        print_problems(found.pop("problems"))
    print_cases(found)


if __name__ == "__main__":
    main()
