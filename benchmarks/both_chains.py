"""The main job by this library's own code and by Pinocchio, placo, coal and toppra, problem by problem.

    python benchmarks/both_chains.py [--problems 200] [--cases 10000]

From Stand a hand reaches for points over a table, and the gaze follows.  Both chains solve each problem;
each motion is certified by both.  Then single steps are compared on the same random cases.
"""

import argparse
import time
from collections import defaultdict
from importlib.metadata import version

import numpy as np

import pepper_kin as pk
from pepper_kin import collision, dynamics, ik

CHAINS = {name: pk.load_pepper().with_solvers(name) for name in ("fast", "reference")}
LOW, HIGH = (0.30, -0.30, 0.78), (0.50, 0.35, 1.00)
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
STEPS = ("ik.solve", "plan", "retime", "check", "Twin.execute")


class Clock:
    """Times of steps [s], by chain and step."""

    def __init__(self) -> None:
        self.seconds = defaultdict(list)

    def timed(self, chain, step, function, *arguments, **options):
        """Call a function, and keep how long it took."""
        begin = time.perf_counter()
        found = function(*arguments, **options)
        self.seconds[chain, step].append(time.perf_counter() - begin)
        return found


def reach(chain: str, point: np.ndarray, clock: Clock) -> dict[str, float] | None:
    """Return what a chain made of a problem; None without a motion that both certify."""
    pepper = CHAINS[chain]
    hand, start = "left" if point[1] > 0 else "right", pepper.posture("Stand")
    tasks = [ik.HandPosition(hand, point), ik.LookAt(point)]
    clock.timed(chain, "ik.solve", ik.solve, pepper, tasks, start, scene=TABLE)
    plan = clock.timed(chain, "plan", pk.plan, pepper, start, tasks, TABLE)
    if not plan.success:
        return None
    motion = clock.timed(chain, "retime", pk.retime, pepper, plan)
    certificate = clock.timed(chain, "check", motion.check, pepper, TABLE)
    run = clock.timed(chain, "Twin.execute", pk.Twin(pepper).execute, motion, hold_time=0.5)
    other = CHAINS["fast" if chain == "reference" else "reference"]
    if not (certificate.success and motion.check(other, TABLE).success):
        return None
    frame = "LArm_effector" if hand == "left" else "RArm_effector"
    palm = pk.kinematics.frame_pose(CHAINS["fast"], run.position[-1], frame)[:3, 3]
    twin = pk.Twin(other).execute(motion, hold_time=0.5)
    return {
        "hand error [m]": float(np.linalg.norm(palm - point)),
        "duration [s]": motion.duration,
        "other twin's distance [rad]": float(np.abs(twin.position - run.position).max()),
    }


def problems(count: int) -> None:
    """Print the table of the main job."""
    points, clock = np.random.default_rng(5).uniform(LOW, HIGH, (count, 3)), Clock()
    found = {chain: [] for chain in CHAINS}
    for point in points:
        for chain in CHAINS:
            found[chain].append(reach(chain, point, clock))
    print("| step, median [ms] | this library | by the field's | ratio |\n|---|---|---|---|")
    totals = {chain: np.zeros(count) for chain in CHAINS}
    for step in STEPS:
        fast, other = (np.array(clock.seconds[chain, step]) for chain in CHAINS)
        for chain, seconds in zip(CHAINS, (fast, other), strict=True):
            if step != "ik.solve" and len(seconds) == count:  # `plan` solves it again
                totals[chain] += seconds
        medians = 1e3 * np.median(fast), 1e3 * np.median(other)
        print(f"| `{step}` | {medians[0]:.2f} | {medians[1]:.1f} | {medians[1] / medians[0]:.0f} |")
    medians = [1e3 * np.median(totals[chain]) for chain in CHAINS]
    ratio = medians[1] / medians[0]
    print(f"| from `plan` to `Twin.execute` | {medians[0]:.1f} | {medians[1]:.0f} | {ratio:.0f} |")
    print()
    print("| | this library | by the field's |\n|---|---|---|")
    good = {chain: [one for one in found[chain] if one] for chain in CHAINS}
    print(f"| certified by both, of {count} | {' | '.join(str(len(good[chain])) for chain in CHAINS)} |")
    for quantity in ("hand error [m]", "other twin's distance [rad]"):
        most = (f"{max(one[quantity] for one in good[chain]):.1e}" for chain in CHAINS)
        print(f"| {quantity}, most | {' | '.join(most)} |")
    medians = (f"{np.median([one['duration [s]'] for one in good[chain]]):.3f}" for chain in CHAINS)
    print(f"| duration [s], median | {' | '.join(medians)} |")


def cases(count: int) -> None:
    """Print how far single steps agree."""
    fast, other = CHAINS.values()
    rng = np.random.default_rng(0)
    q = rng.uniform(fast.lower_limits, fast.upper_limits, (count, fast.n))
    v, a = rng.normal(size=(2, count, fast.n))
    print("\n| step | cases | greatest difference | unexplained |\n|---|---|---|---|")
    for function, inputs in (
        (dynamics.inverse_dynamics, (q, v, a)),
        (dynamics.forward_dynamics, (q, v, a)),
        (dynamics.mass_matrix, (q,)),
    ):
        ours, theirs = function(fast, *inputs), function(other, *inputs)
        size = np.abs(theirs).max(axis=0, keepdims=True)
        off = np.abs(ours - theirs) / np.maximum(size, 1e-3 * size.max())
        print(f"| `{function.__name__}`, relative | {count} | {off.max():.1e} | {int((off > 1e-10).sum())} |")
    verdicts = [collision.in_collision(pepper, q, TABLE) for pepper in CHAINS.values()]
    ties = np.abs(collision.clearance(fast, q[verdicts[0] != verdicts[1]], TABLE)) < 1e-6
    wrong = int((verdicts[0] != verdicts[1]).sum())
    print(
        f"| `in_collision` | {count} | {wrong} differ, ties: {int(ties.sum())} | {wrong - int(ties.sum())} |"
    )
    solved, points = [], rng.uniform(LOW, HIGH, (count, 3))
    for point in points:
        task = ik.HandPosition("left", point)
        solved.append([ik.solve(one, task, fast.posture("Stand")).success for one in CHAINS.values()])
    ours, theirs = np.array(solved).T
    only = f"{int((ours & ~theirs).sum())} by ours only, {int((theirs & ~ours).sum())} by the field's only"
    aside = [  # met by the field's solver where collisions do not count
        ik.solve(other, ik.HandPosition("left", point), fast.posture("Stand"), collisions=False).success
        for point in points[ours & ~theirs]
    ]
    unexplained = len(aside) - sum(aside)
    print(
        f"| `ik.solve`, met to 1 mm | {count} | {only}; {sum(aside)} met but in collision | {unexplained} |"
    )
    worst, unequal = 0.0, 0
    for start, end in zip(q[:-1:2] * 0.5, q[1::2] * 0.5, strict=True):
        path = np.clip([start, end], fast.lower_limits, fast.upper_limits)
        try:
            times = [pk.retime(pepper, path, balance=None).duration for pepper in CHAINS.values()]
        except pk.exceptions.InfeasibleError:
            continue
        off = abs(times[1] / times[0] - 1.0)
        worst, unequal = max(worst, off), unequal + (off > 2e-3)
    print(f"| `retime`, relative | {count // 2} | {worst:.1e} | {unequal} above 0.2 % |")


def main() -> None:
    """Print the tables of the page on the field's solvers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--cases", type=int, default=10_000)
    arguments = parser.parse_args()
    names = ("pin", "coal", "placo", "proxsuite", "toppra")
    print(", ".join(f"{name} {version(name)}" for name in names), "\n")
    problems(arguments.problems)
    cases(arguments.cases)


if __name__ == "__main__":
    main()
