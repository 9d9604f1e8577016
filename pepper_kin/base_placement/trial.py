"""Evaluation of candidate base poses: reached targets and scores."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.base_placement.moving_base import MovingBase
from pepper_kin.base_placement.score import Scorer
from pepper_kin.base_placement.task_sets import TaskSet
from pepper_kin.collision import in_collision
from pepper_kin.ik.batch import solve_batch

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

STARTS = 3
STEPS = 60
"""Restarts and steps of the first search; only the best base poses get a full search."""

OTHER_STARTS = 4
HALF_WAY = 0.5
"""Number of further starts for a solution in collision, and their fraction of the way to a random posture."""


@dataclass(frozen=True, eq=False)
class Trials:
    """N base poses and the solutions found at each, for T sets of tasks.

    Attributes:
        places: Base poses: x, y [m], yaw [rad], shape (N, 3).
        q: Joint positions of the moving robot [rad or m], shape (T, N, n).
        reached: Whether each set is met, shape (N, T).
        iterations: Number of steps over all starts, shape (N, T).
        restarts: Number of starts used after q0, shape (N, T).
        violation: Sum of the tasks' ratios error / tolerance that are above 1, shape (N,).
        touching: Whether any configuration is in collision, shape (N,); checked only if all sets are met and
            collisions count.
        scores: Scores without clearance, shape (N,); 0 if a set is not met.
    """

    places: Array
    q: Array
    reached: np.ndarray
    iterations: np.ndarray
    restarts: np.ndarray
    violation: Array
    touching: np.ndarray
    scores: Array

    @property
    def all_reached(self) -> np.ndarray:
        """Whether all sets are met, shape (N,)."""
        return np.asarray(self.reached.all(axis=1))

    @property
    def good(self) -> np.ndarray:
        """Whether all sets are met without collision, shape (N,)."""
        return self.all_reached & ~self.touching

    def order(self) -> np.ndarray:
        """Return the rows, the best first: good ones, then by number of reached sets, violation and score."""
        return np.lexsort(
            (np.arange(len(self.places)), -self.scores, self.violation, -self.reached.sum(axis=1), ~self.good)
        )

    def with_more(self, more: Trials) -> Trials:
        """Return these trials followed by others."""
        joined: dict[str, Any] = {}
        for entry in fields(self):
            axis = 1 if entry.name == "q" else 0
            joined[entry.name] = np.concatenate([getattr(self, entry.name), getattr(more, entry.name)], axis)
        return Trials(**joined)


@dataclass(frozen=True, eq=False)
class CandidateEvaluator:
    """Evaluator of candidate base poses.

    Attributes:
        moving: The robot with a moving base.
        sets: Sets of tasks.
        q0: Joint positions at the start, shape (n,) [rad or m].
        names: Names of the joints that may move.
        scorer: Scorer of the solutions.
        scene: Scene of the collision checks; None for no checks.
        seed: Seed of the restarts.
        threads: Number of threads that share the base poses.
    """

    moving: MovingBase
    sets: tuple[TaskSet, ...]
    q0: Array
    names: tuple[str, ...]
    scorer: Scorer
    scene: Scene | None
    seed: int
    threads: int

    @property
    def obstacles(self) -> bool:
        """Whether there are obstacles."""
        return self.scene is not None and bool(self.scene.objects)

    def __call__(self, places: Array) -> Trials:
        """Search a configuration for every set at every base pose, shape (N, 3) [m, m, rad]."""
        starts = self.moving.states(self.q0, places)
        found = [
            solve_batch(
                self.moving.robot, tasks, starts, seed=self.seed, collisions=False, joints=self.names,
                restarts=STARTS, max_iterations=STEPS, threads=self.threads,
            )
            for tasks in self.sets
        ]  # fmt: skip
        q = np.array([batch.q for batch in found])
        reached = np.array([batch.success for batch in found]).T
        iterations = np.array([batch.iterations for batch in found]).T
        restarts = np.array([batch.restarts for batch in found]).T
        violation = np.zeros(len(places))
        for tasks, batch in zip(self.sets, found, strict=True):
            share = batch.errors / np.array([task.tolerance for task in tasks])
            violation += np.where(share > 1, share, 0.0).sum(axis=1)
        every = reached.all(axis=1)
        rows = np.flatnonzero(every)
        scores, touching = np.zeros(len(places)), np.zeros(len(places), dtype=bool)
        if rows.size:
            q[:, rows], touching[rows] = self._kept_clear(starts[rows], q[:, rows])
            margin, _ = self.scorer.limit_margins(q[:, rows])
            unknown = np.full(rows.size, np.inf)
            skill = self.scorer.manipulabilities(q[:, rows])
            scores[rows] = self.scorer.scores(margin, skill, unknown, *self.scorer.travels(places[rows]))
        return Trials(places, q, reached, iterations, restarts, violation, touching, scores)

    def _kept_clear(self, starts: Array, q: Array) -> tuple[Array, np.ndarray]:
        """Search other solutions in place of those in collision.

        Args:
            starts: Joint vectors from which the search started [rad or m], shape (N, n).
            q: Solutions [rad or m], shape (T, N, n).

        Returns:
            Solutions, with replacements where found, shape (T, N, n), and whether a solution of each base
            pose is still in collision, shape (N,).
        """
        touching = np.zeros(q.shape[1], dtype=bool)
        if self.scene is None:
            return q, touching
        robot, found, generator = self.moving.robot, q.copy(), np.random.default_rng((self.seed, 2))
        movable = np.isin(robot.joint_names, self.names)
        low = np.maximum(robot.lower_limits[movable], -np.pi)
        high = np.minimum(robot.upper_limits[movable], np.pi)
        for k, tasks in enumerate(self.sets):
            rows = np.flatnonzero(~touching)
            rows = rows[in_collision(robot, found[k, rows], self.scene)]
            for _ in range(OTHER_STARTS):
                if not rows.size:
                    break
                others = starts[rows].copy()
                others[:, movable] += HALF_WAY * (generator.uniform(low, high) - others[:, movable])
                batch = solve_batch(
                    robot, tasks, others, collisions=False, joints=self.names, restarts=0,
                    max_iterations=STEPS, threads=self.threads,
                )  # fmt: skip
                free = batch.success.copy()
                free[free] = ~in_collision(robot, batch.q[free], self.scene)
                found[k, rows[free]] = batch.q[free]
                rows = rows[~free]
            touching[rows] = True
        return found, touching
