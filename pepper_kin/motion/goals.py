"""Goals of a path from IK tasks: many solutions found in machine code, of which the clear ones stay."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.ik import IKResult, Task, TaskGroup, solve
from pepper_kin.ik.certificate import Evidence
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.descenders import make_descender
from pepper_kin.ik.precedence import balanced
from pepper_kin.ik.problem import flatten_tasks, make_problem, movable_joints
from pepper_kin.ik.search import Budget, search
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.checks import Checks

Array = NDArray[np.float64]

FURTHER = 3
"""Solutions of a goal's tasks besides the first."""

ROUNDS = (16, 48, 160, 512)
"""Starts of one round of inverse kinematics after the other."""

ROUNDS_FOR_MARGIN = 2
"""Rounds after which a solution nearer to something than the margin will do."""

ROUNDS_BEFORE_CARE = 3
"""Rounds after which a way clear of collisions is looked for, which is slow."""

DRAWS = 4
"""Postures drawn for each start of the later rounds, of which those that touch nothing are taken, if machine
code can tell."""

CAREFUL_STARTS = 2
"""Further starts of a search that keeps clear all the way, which is slow."""

STEPS = 150
"""Of inverse kinematics from each start."""

APART = 0.1
"""Solutions that differ by less than this in every joint count as one [rad or m]."""

_SEEDS_APART = 104_729


def clear_goals(
    checks: Checks,
    start: Array,
    tasks: Sequence[Task | TaskGroup],
    joints: str | Sequence[str] | None,
    margin: float,
    seed: int,
    timeout: float,
) -> tuple[Array, IKResult] | None:
    """Return solutions of tasks that touch nothing and can be held; None where none was found this way.

    Solutions from starts ever farther away are examined together.  Those with the margin to the scene are
    preferred to nearer ones without.

    Args:
        checks: The robot in its scene, compiled.
        start: Where the motion starts, shape (n,).
        tasks: Tasks that the fast solver knows.
        joints: Joints that may move: a group or names; None for all.
        margin: Distance to the scene that is preferred [m].
        seed: Draws the starts.
        timeout: Time budget [s]; it is looked at between rounds.

    Returns:
        Goals, shape (m, n), m of 1 to 4, the best first, and the result of inverse kinematics for that one.
    """
    begin = time.perf_counter()
    first = solve(checks.pepper, tasks, start, seed=seed, joints=joints, timeout=timeout)
    if not first.success:
        return None
    sought = _Search(checks, start, tasks, joints, margin, seed)
    good = sought.first(first.q)
    for number, count in enumerate(ROUNDS[1:], start=1):
        if len(good) or time.perf_counter() - begin > timeout:
            break
        if number == ROUNDS_BEFORE_CARE:
            good = sought.carefully(begin + timeout)
        if not len(good):
            good = sought.wide(number, count)
    if not len(good):
        return None
    q = read_only(good[0].copy())
    evidence = Evidence(checks.pepper, sought.parts, start, sought.movable, checks.exact.scene, q).certificate
    elapsed = time.perf_counter() - begin
    return good, replace(first, q=q, evidence=evidence, restarts=first.restarts + sought.spent, time=elapsed)


class _Search:
    """Solutions of tasks from many starts, examined together."""

    def __init__(
        self,
        checks: Checks,
        start: Array,
        tasks: Sequence[Task | TaskGroup],
        joints: str | Sequence[str] | None,
        margin: float,
        seed: int,
    ) -> None:
        self.checks, self.start, self.margin, self.seed = checks, start, margin, seed
        self.parts = tuple(flatten_tasks(checks.pepper, tasks))
        self.movable = None if joints is None else movable_joints(checks.pepper, joints)
        self.spare = np.empty((0, checks.pepper.n))  # clear, but for the margin
        self.spent = 0

    def look(self, candidates: Array) -> Array:
        """Return the candidates, shape (m, n), that keep the margin and can be held; keep the other clear."""
        candidates = candidates[self.checks.holds(candidates)]
        wide = self.checks.free(candidates, self.margin)
        if not wide.any():
            self.spare = np.concatenate([self.spare, candidates[self.checks.free(candidates)]])
        return candidates[wide]

    def first(self, found: Array) -> Array:
        """Return goals from starts ever farther away and a solution, shape (n,), that was found before.

        Joints on which no task depends stay where they are.
        """
        from pepper_kin.ik.fast import alternatives

        count = ROUNDS[0]
        more = alternatives(self.checks.pepper, self.parts, self.start, self.movable, self.seed, count, STEPS)
        self.spent += count
        return different(self.look(np.array([found, *more])), 1 + FURTHER)

    def wide(self, number: int, count: int) -> Array:
        """Return goals from `count` postures at most, drawn from all that touch nothing where that is cheap.

        All joints are drawn: the arm that is not asked for anything may stand in the way of what is.
        """
        from pepper_kin.ik.fast import solutions_from

        pepper, movable = self.checks.pepper, self.movable
        low = np.maximum(pepper.lower_limits, self.start - np.pi)
        high = np.minimum(pepper.upper_limits, self.start + np.pi)
        rng = np.random.default_rng(self.seed + _SEEDS_APART * number)
        quick = self.checks.quick
        starts = rng.uniform(low, high, (DRAWS * count if quick else count, pepper.n))
        if movable is not None:
            starts[:, ~movable] = self.start[~movable]
        starts = starts[self.checks.surely_free(starts, 0.0, 0.0)][:count] if quick else starts
        self.spent += len(starts)
        found = solutions_from(pepper, self.parts, self.start, movable, starts, STEPS) if len(starts) else []
        good = self.look(np.array(found)) if found else np.empty((0, pepper.n))
        if not len(good) and number + 1 >= ROUNDS_FOR_MARGIN:
            good = self.spare
        return different(good, 1 + FURTHER)

    def carefully(self, deadline: float) -> Array:
        """Return a goal that is come to along a way clear of collisions, if there is one."""
        pepper, scene = self.checks.pepper, self.checks.exact.scene
        movable = np.ones(pepper.n, dtype=bool) if self.movable is None else self.movable
        problem = make_problem(pepper, balanced(self.parts), self.start, movable, keep_idle=False)
        budget = Budget(self.seed, CAREFUL_STARTS, STEPS, deadline)
        found = search(problem, make_descender("fast", problem), Collisions(pepper, scene), budget)
        self.spent += found.restarts
        if not found.best.is_good:
            return self.spare
        good = self.look(found.best.q[None])
        return good if len(good) else self.spare


def different(solutions: Array, count: int) -> Array:
    """Return the first solutions that differ from one another, shape (m, n), m at most `count`."""
    kept: list[int] = []
    for k, q in enumerate(solutions):
        if all(np.abs(q - solutions[other]).max() >= APART for other in kept):
            kept.append(k)
            if len(kept) == count:
                break
    return solutions[kept]
