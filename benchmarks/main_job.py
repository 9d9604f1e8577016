"""Whole jobs: the main job beside the field's solvers, with more in reserve, and into obstacles."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio
from harness import Times, figures, table, timed
from ik_peers import descent_of_placo
from ompl import geometric, util
from planning_peers import ompl_space, ompl_states
from trajectory import Direct

import pepper_kin as pk
from pepper_kin import collision, dynamics, ik
from pepper_kin.collision import in_collision, least_clearance
from pepper_kin.ik.solvers.placo import robot_of
from pepper_kin.model import MotionRequirements
from pepper_kin.trajectory import check

PEPPER = pk.load_pepper().with_requirements("limits")
STAND = PEPPER.posture("Stand")
ARMS = {"left": ("LArm_effector", 1.0), "right": ("RArm_effector", -1.0)}
MARGIN = 0.005  # [m] that the peer keeps
CLOSE = 2e-3  # [m]
STARTS, STEPS = 20, 60  # of the peer's inverse kinematics
GRIDPOINTS = 200


def scenes() -> dict[str, pk.Scene]:
    """Nothing, a table, a table with things on it, and a shelf."""
    things = table().add_box("box", (0.08, 0.08, 0.20), (0.42, 0.0, 0.83))
    things = things.add_box("book", (0.06, 0.06, 0.15), (0.50, 0.32, 0.81))
    things = things.add_cylinder("bottle", 0.03, 0.20, (0.50, -0.20, 0.83))
    shelf = pk.Scene().add_box("back", (0.02, 0.8, 1.4), (0.70, 0.0, 0.7))
    for k, z in enumerate((0.60, 1.05)):
        shelf = shelf.add_box(f"board {k}", (0.3, 0.8, 0.02), (0.56, 0.0, z))
    return {"free space": pk.Scene(), "table": table(), "table with things": things, "shelf": shelf}


class Job(NamedTuple):
    """A hand, "left" or "right", to a point [m], and the eyes on it, in the scene of a kind."""

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
        frame = ARMS[job.hand][0]
        q = descent_of_placo(self.robot, start, {frame: job.point}, gaze=job.point, steps=STEPS)
        error = np.linalg.norm(self.robot.get_T_world_frame(frame)[:3, 3] - job.point)
        return q if error < CLOSE else None

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
        space = ompl_space(self.low, self.high)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda s: self.free(np.array([s[i] for i in range(PEPPER.n)])))
        setup.getSpaceInformation().setStateValidityCheckingResolution(0.005)
        setup.setStartAndGoalStates(*ompl_states(space, STAND, goal))
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


@figures("benchmarks/planning.md", "OMPL, toppra", count=4, peers=1)
def main_job(count: int = 200, peers: int = 20) -> Iterator[tuple | str]:
    """The main job, from targets to a checked trajectory.

    A hand to a point and the eyes on it, from `Stand`: inverse kinematics, path, shortcuts, waypoints, and
    timing within velocity, acceleration and torque limits.  Ours is `pk.plan` and `pk.retime`, whose path has
    been examined by the compiled check.  The peer does the same with placo, OMPL's RRT-Connect and `simplify`
    over coal called directly, and toppra with torques by Pinocchio, as their users write it; it runs in turn
    with ours on a handful of the tasks only, for it takes long.  After the clock has stopped, every
    trajectory is certified by `trajectory.check` with coal.
    """
    util.setLogLevel(util.LOG_NONE)
    cases = jobs(count)
    worlds = {kind: Peer(scene) for kind, scene in {job.kind: job.scene for job in cases}.items()}
    for seed, job in enumerate(jobs(40, seed=1)):  # load code, make tables of the scenes
        ours(job._replace(scene=worlds[job.kind].checker.scene), seed)
    times, solved, passed, peer_name = Times(), Counter(), 0, "placo + OMPL + toppra"
    for seed, job in enumerate(cases):
        trajectory = times("pepper_kin", ours, job, seed)
        times[f"- {job.kind}"].append(times["pepper_kin"][-1])
        if seed < peers:
            solved[peer_name] += times(peer_name, worlds[job.kind], job, seed) is not None
        if trajectory is not None:
            solved.update(["pepper_kin", f"- {job.kind}"])
            passed += certified(trajectory, job.scene)
    for name in sorted(times, key=lambda name: name == peer_name):
        tasks = len(times[name])
        yield (
            "way | tasks | median [ms] {:.2f} | 99th percentile [ms] {:.1f} | solved [%] {:.0f}",
            name, tasks, *times.at(name, 50, 99), 100 * solved[name] / tasks,
        )  # fmt: skip
    done = solved["pepper_kin"]
    yield f"Of {done} trajectories {passed} pass the certificate: limits, torque, clearance by coal."
    for seed, job in enumerate(cases[1:count:4][:40]):
        times("fresh", ours, job._replace(scene=scenes()[job.kind]), seed)
    yield f"In a scene never seen before, with its tables: median {times.at('fresh'):.1f} ms."


CHAINS = {name: pk.load_pepper().with_solvers(name) for name in ("fast", "reference")}
POINTS = (0.30, -0.30, 0.78), (0.50, 0.35, 1.00)
CHAIN = ("ik.solve", "plan", "retime", "check", "Twin.execute")
TIE = 1e-6
"""Distance to what touches below which verdicts may differ [m]."""


def hand_for(point: np.ndarray) -> str:
    """Return the hand on whose side a point is."""
    return "left" if point[1] > 0 else "right"


def reach(chain: str, point: np.ndarray) -> dict:
    """Return what a chain made of a problem, and the times of its steps [s]."""
    pepper, made = CHAINS[chain], {"certified": False}
    hand, start = hand_for(point), pepper.posture("Stand")
    tasks = [pk.ik.HandPosition(hand, point), pk.ik.LookAt(point)]

    def step(name, function, *arguments, **options):
        found, made[name] = timed(function, *arguments, clock=time.perf_counter, **options)
        return found

    step("ik.solve", ik.solve, pepper, tasks, start, scene=table())
    plan = step("plan", pk.plan, pepper, start, tasks, table())
    if not plan.success:
        return made | {"why": plan.message}
    motion = step("retime", pk.retime, pepper, plan)
    certificate = step("check", motion.check, pepper, table())
    run = step("Twin.execute", pk.Twin(pepper).execute, motion, hold_time=0.5)
    other = CHAINS["fast" if chain == "reference" else "reference"]
    if not (certificate.success and motion.check(other, table()).success):
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


def both_reach(count: int, rows: slice) -> Iterator[dict]:
    """Yield what both chains made of each problem."""
    for point in np.random.default_rng(5).uniform(*POINTS, (count, 3))[rows]:
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
        differs = len({bool(collision.in_collision(pepper, q, table())) for pepper in CHAINS.values()}) > 1
        apart = float(collision.clearance(fast, q, table())) if differs else 0.0
        yield {"differs": differs, "distance": apart}


def of_ik(count: int, rows: slice) -> Iterator[dict]:
    """Yield what `met` does of places of the left palm in random postures that touch nothing."""
    fast, q = CHAINS["fast"], postures(3 * count)
    free = q[~collision.in_collision(fast, q)][:count]
    yield from met(pk.kinematics.frame_pose(fast, free, "LArm_effector")[:, :3, 3][rows])


def of_ik_in_box(count: int, rows: slice) -> Iterator[dict]:
    """Yield what `met` does of places over the table, on both sides, of which not all can be reached."""
    yield from met(np.random.default_rng(2).uniform(*POINTS, (count, 3))[: count // 4][rows])


def met(points: np.ndarray) -> Iterator[dict]:
    """Yield which chain's left hand meets points, shape (m, 3) [m]; where only one does, what helps.

    That a target is met is what the certificate says, which computes the pose from the joint positions.
    """
    ours, theirs = CHAINS.values()
    start = ours.posture("Stand")
    for point in points:
        task = pk.ik.HandPosition("left", point)
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
    "problems": both_reach, "dynamics": of_dynamics, "collisions": of_collisions, "ik": of_ik,
    "ik in a box": of_ik_in_box, "timing": of_timing,
}  # fmt: skip


def tables_of_problems(rows: list[dict]) -> Iterator[tuple | str]:
    """Yield the tables of the main job."""
    of = {chain: [row[chain] for row in rows] for chain in CHAINS}
    head = "step, median [ms] | this library {:.3g} | by the field's {:.3g} | ratio {:.0f}"
    for step in CHAIN:
        ours, theirs = (1e3 * np.median([row[step] for row in of[chain] if step in row]) for chain in CHAINS)
        yield head, f"`{step}`", ours, theirs, theirs / ours
    totals = ([sum(row.get(step, np.nan) for step in CHAIN[1:]) for row in of[chain]] for chain in CHAINS)
    ours, theirs = (1e3 * np.nanmedian(total) for total in totals)
    yield head, "from `plan` to `Twin.execute`", ours, theirs, theirs / ours
    good = {chain: [row for row in of[chain] if row["certified"]] for chain in CHAINS}
    head = " | this library | by the field's"
    yield head, f"certified by both, of {len(rows)}", *map(len, good.values())
    for quantity in ("hand error [m]", "other twin's distance [rad]"):
        most = (f"{max(one[quantity] for one in good[chain]):.1e}" for chain in CHAINS)
        yield head, f"{quantity}, most", *most
    medians = (f"{np.median([one['duration [s]'] for one in good[chain]]):.3f}" for chain in CHAINS)
    yield head, "duration [s], median", *medians
    for chain in CHAINS:
        yield from (f"Not certified, {chain}: {row['why']}" for row in of[chain] if not row["certified"])


def table_of_cases(found: dict[str, list[dict]]) -> Iterator[tuple]:
    """Yield the table of single steps, as far as they were compared."""
    head = "step | cases | greatest difference | unexplained"
    rows = found.get("dynamics", [])
    for name in rows[0] if rows else ():
        off = np.array([row[name] for row in rows])
        yield head, f"`{name}`, relative", len(off), f"{off.max():.1e}", int((off > 1e-10).sum())
    if rows := found.get("collisions"):
        apart = np.array([abs(row["distance"]) for row in rows if row["differs"]])
        ties = int((apart < TIE).sum())
        yield head, "`in_collision`", len(rows), f"{len(apart)} differ, ties: {ties}", len(apart) - ties
    for kind in ("ik", "ik in a box"):
        if rows := found.get(kind):
            ours, theirs = ([row[chain] for row in rows] for chain in CHAINS)
            aside = [row["in collision"] for row in rows if "in collision" in row]
            more = [row["with 320 restarts"] for row in rows if "with 320 restarts" in row]
            words = (
                f"{sum(map(min, ours, theirs))} by both; "
                f"{len(aside)} by ours only, of which placo meets {sum(aside)} in collision; "
                f"{len(more)} by placo only, of which ours meets {sum(more)} with 320 restarts"
            )
            unexplained = len(aside) - sum(aside) + len(more) - sum(more)
            yield head, f"`{kind}`, met to 1 mm", len(rows), words, unexplained
    if rows := found.get("timing"):
        off = np.array([row["off"] for row in rows if row["off"] is not None])
        single = [row["not held"] for row in rows if row.get("by one")]
        words = (
            f"{off.max():.1e}; none possible: {len(rows) - len(off) - len(single)}; by one chain only: "
            f"{len(single)}, of which past a posture that cannot be held at rest: {sum(single)}"
        )
        unexplained = int((off > 2e-3).sum()) + len(single) - sum(single)
        yield head, "`retime`, relative", len(rows), words, unexplained


@figures("reference_solvers.md", "placo, toppra, proxsuite", problems=2, cases=20)
def both_chains(
    problems=200, cases=10_000, kinds=tuple(KINDS), part="1/1", save: Path | None = None, tables=()
) -> Iterator[tuple | str]:
    """The main job by this library's own code and by Pinocchio, placo, coal and toppra, problem by problem.

    From Stand a hand reaches for points over a table, and the gaze follows.  Both chains solve each problem;
    each motion is certified by both.  Then single steps are compared on the same random cases.  With `--part
    K/N` every N-th row from the K-th on is computed, in minutes, with `--save` written to a file, and with
    `--tables` the tables of such files are printed.
    """
    first, step = map(int, part.split("/"))
    found: dict[str, list[dict]] = {}
    for path in tables:
        for line in Path(path).read_text("utf-8").splitlines():
            row = json.loads(line)
            found.setdefault(row.pop("kind"), []).append(row)
    for kind in () if tables else kinds:
        count = problems if kind == "problems" else cases
        found[kind] = list(KINDS[kind](count, slice(first - 1, None, step)))
    if save:
        lines = [json.dumps({"kind": kind} | row) for kind, rows in found.items() for row in rows]
        save.write_text("\n".join(lines) + "\n", "utf-8")
        return
    yield ", ".join(f"{name} {version(name)}" for name in ("pin", "coal", "placo", "proxsuite", "toppra"))
    if "problems" in found:
        yield from tables_of_problems(found.pop("problems"))
    yield from table_of_cases(found)


SETTINGS = {
    '`with_requirements("limits")`': (MotionRequirements(None, 1.0), False),
    "balance 10 mm, all of the torque": (MotionRequirements(0.01, 1.0), False),
    "default: balance 10 mm, 90 % of the torque": (MotionRequirements(), False),
    "balance 10 mm, 85 % of the torque": (MotionRequirements(0.01, 0.85), False),
    "default, `plan(smooth=True)`": (MotionRequirements(), True),
}


def held_back(pepper: pk.PepperModel, point: np.ndarray, smooth: bool) -> tuple[float, bool, float, float]:
    """Return duration [s], whether the certificate is green, the twin's most [rad], and planning time [s]."""
    tasks = [pk.ik.HandPosition("left" if point[1] > 0 else "right", point), pk.ik.LookAt(point)]
    begin = time.process_time()
    plan = pk.plan(pepper, pepper.posture("Stand"), tasks, table(), smooth=smooth)
    if not plan.success:
        return np.nan, False, np.nan, np.nan
    try:
        motion = plan.trajectory or pk.retime(pepper, plan)
    except pk.exceptions.InfeasibleError:
        return np.inf, False, np.nan, np.nan
    spent = time.process_time() - begin
    run = pk.Twin(pepper).execute(motion, hold_time=0.5)
    behind = float(np.abs(run.position - run.reference_position).max())
    return motion.duration, motion.check(pepper, table()).success, behind, spent


@figures("trajectories.md", count=4)
def reserve(count: int = 120, save: Path | None = None, beside: Path | None = None) -> Iterator[tuple]:
    """Durations, certificates and the twin's distance of reaches that keep more or less in reserve.

    From Stand a hand reaches for points over a table, and the gaze follows: `plan`, `retime`, `check` and
    `Twin.execute`, without further options but `smooth=True` in the last row, of robots with different
    requirements.  `--save` keeps the durations with `with_requirements("limits")`; `--beside` adds ratios to
    those that another commit has saved.  The last column is processor time of `plan` and `retime`.
    """
    points = np.random.default_rng(5).uniform(*POINTS, (count, 3))
    others = [] if beside is None else [np.loadtxt(beside)]
    for name, (requirements, smooth) in SETTINGS.items():
        pepper = pk.load_pepper().with_requirements(requirements)
        held_back(pepper, points[0], smooth)  # compiles what it needs
        found = [held_back(pepper, point, smooth) for point in points]
        duration, green, behind, spent = map(np.array, zip(*found, strict=True))
        if requirements.balance is None:
            others.insert(0, duration)
            if save is not None:
                np.savetxt(save, duration)
        ratios = [(duration / other)[np.isfinite(duration / other)] for other in others]
        yield (
            "keeps | green, refused | twin behind, most {:.1f} mrad | duration: median, 90 % | "
            + "duration beside FILE: median, 90 % | " * (len(others) - 1)
            + "median [s] {:.2f} | [ms] {:.1f}",
            name, f"{int(green.sum())}, {int((~np.isfinite(duration)).sum())}", 1e3 * np.nanmax(behind),
            *(f"{np.median(ratio):.2f}, {np.quantile(ratio, 0.9):.2f}" for ratio in ratios),
            np.nanmedian(duration), 1e3 * np.nanmedian(spent),
        )  # fmt: skip


@figures("twin.md", count=2)
def blocked_runs(count=50, seed=0, margin=0.0, least_margin=0.0) -> Iterator[str]:
    """What the twin says of motions into obstacles, and of motions planned around them.

    Each scene has a box somewhere before the robot.  A motion into it is timed along the straight line from
    Stand to a posture in which a hand is at the box's center.  A motion around it is planned, with a margin
    where it can be kept and a least one, from Stand to a point beside or behind the box, where the straight
    line to a posture that has the hand there passes through the box.  Coal measures how deep a reference goes
    into the box, and how near the twin comes to it.  Both run on `Twin(pepper, scene=scene)`, with the
    defaults of `retime` and the twin.
    """
    pepper, rng = pk.load_pepper(), np.random.default_rng(seed)
    into, around, refused = Counter[str](), Counter[str](), Counter[str]()
    margins, depths, errors, nearest = {"margin": margin, "least_margin": least_margin}, [], [], []
    while into.total() < count or around.total() < count:
        scene, blocked, free = draw(pepper, rng)
        if blocked is not None and into.total() < count:
            motion = pk.retime(pepper, [pepper.posture("Stand"), blocked])
            run = pk.Twin(pepper, scene=scene).execute(motion)
            into[run.status.value] += 1
            depths.append(-distance(pepper, motion.sample(0.002).position, scene))
            errors.append(float(np.abs(run.tracking_error[-1]).max()))
        if free is not None and around.total() < count:
            plan = pk.plan(pepper, pepper.posture("Stand"), [free], scene, seed=seed, **margins)
            if not plan.success:
                refused[plan.status.value] += 1
                continue
            run = pk.Twin(pepper, scene=scene).execute(pk.retime(pepper, plan))
            around[run.status.value] += 1
            nearest.append(distance(pepper, run.position[::2], scene))
    yield f"into obstacles ({min(depths):.3f} to {max(depths):.3f} m deep): {dict(into)}"
    yield f"  off the reference at the end: {min(errors):.2f} to {max(errors):.2f} rad"
    yield f"around them: {dict(around)}; the twin's least distance {1000 * min(nearest):.1f} mm"
    yield f"  drawn besides, without a plan: {dict(refused)}"


def draw(pepper, rng) -> tuple[pk.Scene, np.ndarray | None, pk.ik.HandPosition | None]:
    """Return a scene, a posture with a hand in its box, and where a hand is free; None for none found."""
    stand, hand = pepper.posture("Stand"), str(rng.choice(["left", "right"]))
    side = 1.0 if hand == "left" else -1.0
    center = np.array([rng.uniform(0.3, 0.5), side * rng.uniform(0.0, 0.35), rng.uniform(0.7, 1.1)])
    scene = pk.Scene().add_box("box", size=rng.uniform(0.08, 0.2, 3), position=center)
    if in_collision(pepper, stand, scene):
        return scene, None, None
    inside = pk.ik.solve(pepper, [pk.ik.HandPosition(hand, center)], seed=0)
    shift = rng.uniform(-0.05, 0.1), side * rng.choice([-1.0, 1.0]) * 0.25, rng.uniform(-0.15, 0.15)
    goal = center + np.array(shift)
    task = pk.ik.HandPosition(hand, goal)
    beside = pk.ik.solve(pepper, [task], scene=scene, seed=0)
    straight = stand + np.linspace(0.0, 1.0, 100)[:, None] * (beside.q - stand)
    passes = beside.success and distance(pepper, straight, scene) <= 0.0
    return scene, inside.q if inside.success else None, task if passes else None


def distance(pepper: pk.PepperModel, q: np.ndarray, scene: pk.Scene) -> float:
    """Return the least distance to the obstacles over configurations q, shape (T, n) [m]."""
    return least_clearance(pepper, q, scene, to="obstacles").distance
