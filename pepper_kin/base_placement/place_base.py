"""Base placement: search for the base pose from which targets are best reached."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.base_placement.job import Job, make_job
from pepper_kin.base_placement.moving_base import wrapped
from pepper_kin.base_placement.obstacles import obstacle_clearance
from pepper_kin.base_placement.proposals import propose
from pepper_kin.base_placement.result import Placement, PlacementResult, PlacementStatus
from pepper_kin.base_placement.score import PlacementTerms, PlacementWeights
from pepper_kin.base_placement.task_sets import Given, TaskSet
from pepper_kin.base_placement.trial import Trials
from pepper_kin.ik.certificate import CertificateInputs
from pepper_kin.ik.result import IKResult, IKStatus
from pepper_kin.ik.solve import solve
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, check_whole

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

# Rounds of local search: number of best base poses, samples around each, and deviations [m], [rad].
ROUNDS = ((12, 6, 0.10, 0.30), (8, 6, 0.04, 0.10))

# Restarts of the inverse kinematics at a base pose whose first search failed.
RESTARTS = 8

# Maximum number of base poses that fail in the final search.
FAILURES = 2

# Number of base poses whose exact clearance is computed, and minimum distances of two placements [m], [rad].
MEASURED = 24
APART = (0.10, 0.25)


def place_base(
    pepper: PepperModel,
    tasks: Given,
    start: ArrayLike | None = None,
    *,
    stand: ArrayLike | None = None,
    scene: Scene | None = None,
    collisions: bool = True,
    joints: str | Sequence[str] | None = None,
    candidates: int | ArrayLike = 192,
    keep: int = 5,
    weights: PlacementWeights | None = None,
    seed: int = 0,
    threads: int = 1,
) -> PlacementResult:
    """Find base poses from which targets are reached, the best first.

    Candidates come from inverse reachability: base poses that result if the inverse kinematics may move the
    base, too (see `proposals`). From each, the inverse kinematics with a fixed base is solved for every set
    of tasks; then base poses near the best ones are tried. The same arguments give the same result for any
    number of threads.

    Args:
        pepper: The robot; a fixed base is moved, too, with targets and scene in the world in which its
            current pose is `stand`.
        tasks: One task; a list of tasks that one configuration has to meet; or a list of lists of tasks, each
            met by its own configuration from the same base pose. Tasks with N targets stand for N lists.
        start: Joint positions at the start [rad or m], shape (n,); `pepper.neutral()` if None.
        stand: Current base pose: x, y [m], yaw [rad], shape (3,); None for the pose in `start`, or the
            origin.
        scene: Obstacles around the robot; None for none. Self-collision is checked with or without a scene.
            The way to the base pose is not checked.
        collisions: Whether collisions are checked; the result says if they are not.
        joints: Joints that may move, by names of joints and groups, without the base's; None for all.
        candidates: Number of base poses to try first, or base poses, shape (N, 3) [m, m, rad]; then only
            these and the current one are tried.
        keep: Maximum number of placements to return.
        weights: Weights of the score's terms.
        seed: Seed of the candidates and the restarts.
        threads: Number of threads that share the work.

    Returns:
        Placements and all trials; `result.status` says why no base pose was found.

    Raises:
        InvalidValueError: for no task, or numbers that are malformed, NaN or infinite.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a start outside the joint limits.
    """
    begin = time.perf_counter()
    job = make_job(
        pepper, tasks, start, stand, scene, collisions, joints, weights, seed=seed, threads=threads
    )
    check_whole("keep", keep, 1)
    trials = _tried(job, candidates)
    placements = _finalists(job, trials, keep)
    status = _status(trials, placements)
    unreached = tuple(np.flatnonzero(~trials.reached.any(axis=0)).tolist())
    return PlacementResult(
        status=status,
        placements=placements,
        unreached=unreached,
        places=read_only(trials.places),
        scores=read_only(trials.scores),
        reached=read_only(trials.reached, bool),
        touching=read_only(trials.touching, bool),
        names=tuple(", ".join(task.label for task in group) for group in job.evaluator.sets),
        time=time.perf_counter() - begin,
        seed=job.evaluator.seed,
        conflicts=tuple(_conflict(job, job.evaluator.sets[k]) for k in unreached),
    )


MOST_CANDIDATES = 1_000_000


def _tried(job: Job, candidates: Any) -> Trials:
    """Evaluate base poses, shape (N, 3) [m, m, rad], or a number of proposals and neighbors of the best."""
    evaluator = job.evaluator
    if isinstance(candidates, list | tuple | np.ndarray):
        checked = as_finite(candidates, "candidates", (None, 3)).copy()
        checked[:, 2] = wrapped(checked[:, 2])
        return evaluator(np.concatenate([job.stand[None], checked]))
    count = check_whole("candidates", candidates, 1, MOST_CANDIDATES)
    places = propose(
        evaluator.moving,
        evaluator.sets,
        evaluator.q0,
        job.stand,
        job.movable,
        count,
        evaluator.seed,
        evaluator.scene if evaluator.obstacles else None,
    )
    return _look_around(job, evaluator(places))


def _look_around(job: Job, trials: Trials) -> Trials:
    """Evaluate base poses around the best ones."""
    evaluator, generator = job.evaluator, np.random.default_rng((job.evaluator.seed, 1))
    base = evaluator.moving.base
    low, high = evaluator.moving.robot.lower_limits[base], evaluator.moving.robot.upper_limits[base]
    for best, times, meters, radians in ROUNDS:
        centers = np.repeat(trials.places[trials.order()[:best]], times, axis=0)
        places = np.clip(
            centers + (meters, meters, radians) * generator.standard_normal(centers.shape), low, high
        )
        places[:, 2] = wrapped(places[:, 2])
        trials = trials.with_more(evaluator(places))
    return trials


def _finalists(job: Job, trials: Trials, keep: int) -> tuple[Placement, ...]:
    """Return the best base poses, distinct and after a full search; if none is suitable, the nearest ones."""
    chosen: list[Placement] = []
    failed: list[Placement] = []
    for row in _order(job, trials):
        if len(chosen) == keep or len(failed) == FAILURES or (chosen and not trials.good[row]):
            break
        x, y, yaw = trials.places[row].tolist()
        near = any(
            np.hypot(x - p.x, y - p.y) < APART[0] and abs(wrapped(np.array(yaw - p.yaw))) < APART[1]
            for p in chosen + failed
        )
        if not near:
            placement = _placement(job, trials, row)
            (chosen if placement.success else failed).append(placement)
    if not chosen:
        return tuple(failed)
    return tuple(sorted(chosen, key=lambda placement: -placement.score))


def _order(job: Job, trials: Trials) -> list[int]:
    """Return the rows, the best first; with obstacles, the first rows are ranked by exact clearance."""
    order = trials.order()
    good = order[trials.good[order]][:MEASURED]
    evaluator = job.evaluator
    if not evaluator.obstacles or not good.size:
        return [int(row) for row in order]
    q = trials.q[:, good]
    distances = obstacle_clearance(evaluator.moving.robot, q, cast("Scene", evaluator.scene))
    margin, _ = evaluator.scorer.limit_margins(q)
    travels = evaluator.scorer.travels(trials.places[good])
    scores = evaluator.scorer.scores(margin, evaluator.scorer.manipulabilities(q), distances, *travels)
    first = good[np.argsort(-scores, kind="stable")]
    return [int(row) for row in (*first, *order[~np.isin(order, first)])]


def _placement(job: Job, trials: Trials, row: int) -> Placement:
    """Return one base pose with its solutions, from the trial if they are good, else from a longer search."""
    evaluator, place = job.evaluator, trials.places[row]
    moving, scene = evaluator.moving, evaluator.scene
    start = moving.states(evaluator.q0, place[None])[0]
    results = []
    for k, tasks in enumerate(evaluator.sets):
        if trials.good[row]:
            q = read_only(trials.q[k, row])
            evidence = CertificateInputs(moving.robot, tasks, start, job.movable, scene, q).certificate
            counts = int(trials.iterations[row, k]), int(trials.restarts[row, k])
            result = IKResult(
                IKStatus.SOLVED, q, *counts, 0.0, "fast", seed=evaluator.seed, evidence=evidence
            )
            results.append(result)
        else:
            results.append(
                solve(
                    moving.robot, tasks, start, scene=scene, collisions=scene is not None,
                    joints=evaluator.names, seed=evaluator.seed, restarts=RESTARTS,
                )
            )  # fmt: skip
    found = np.array([result.q for result in results])
    terms, score = _terms(job, found, place)
    success = all(result.success for result in results)
    x, y, yaw = place.tolist()
    q = read_only(found[:, moving.body])
    return Placement(x, y, yaw, score if success else 0.0, terms, q, tuple(results))


def _terms(job: Job, q: Array, place: Array) -> tuple[PlacementTerms, float]:
    """Return the terms and the score of configurations, shape (T, n), at a base pose."""
    scorer, states = job.evaluator.scorer, q[:, None]
    margin, joint = scorer.limit_margins(states)
    skill, (distance, turn) = scorer.manipulabilities(states), scorer.travels(place[None])
    near, evaluator = np.full(1, np.inf), job.evaluator
    if evaluator.obstacles:
        near = obstacle_clearance(evaluator.moving.robot, states, cast("Scene", evaluator.scene))
    score = scorer.scores(margin, skill, near, distance, turn)
    terms = PlacementTerms(
        limit_margin=None if joint[0] < 0 else float(margin[0]),
        tightest_joint="" if joint[0] < 0 else job.evaluator.moving.robot.joint_names[joint[0]],
        manipulability=None if np.isnan(skill[0]) else float(skill[0]),
        clearance=float(near[0]) if np.isfinite(near[0]) else None,
        distance=float(distance[0]),
        turn=float(turn[0]),
    )
    return terms, float(score[0])


def _status(trials: Trials, placements: tuple[Placement, ...]) -> PlacementStatus:
    """Return the status from the trials and the final placements."""
    if placements[0].success:
        return PlacementStatus.FOUND
    if trials.all_reached.any():
        return PlacementStatus.BLOCKED_BY_COLLISION
    if not trials.reached.any(axis=0).all():
        return PlacementStatus.UNREACHABLE
    return PlacementStatus.NOT_TOGETHER


def _conflict(job: Job, tasks: TaskSet) -> tuple[str, ...]:
    """Return the names of tasks that contradict each other in a set that no base pose reaches.

    The base may move like a joint, so tasks that can be met one by one, from any base pose, count, too.
    """
    if len(tasks) < 2:
        return ()
    evaluator = job.evaluator
    robot, base = evaluator.moving.robot, evaluator.moving.base
    return solve(
        robot,
        tasks,
        evaluator.moving.states(evaluator.q0, job.stand[None])[0],
        collisions=False,
        joints=[*evaluator.names, *(robot.joint_names[j] for j in base)],
        seed=evaluator.seed,
        restarts=RESTARTS,
    ).conflict
