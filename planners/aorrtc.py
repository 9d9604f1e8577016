"""AORRTC: a first path quickly, and then shorter and shorter ones.

Sources: T. S. Wilson, W. Thomason, Z. Kingston and J. D. Gammell, AORRTC: Almost-surely asymptotically
optimal planning with RRT-Connect, IEEE Robotics and Automation Letters 10(12), 2025; K. Hauser and Y. Zhou,
Asymptotically optimal planning by feasible kinodynamic planning in a state-cost space, IEEE Trans. on
Robotics 32(6), 2016; J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, Informed RRT*, IROS 2014, for the
samples.
"""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import FINEST_RESOLUTION, GoalSource, Problem
from .result import Improvement, Result, Status, StopReason
from .rrt_connect import Search, grow, luby, new_counters, plant
from .shortcut import shortcut, shorten
from .vectors import FloatArray, positive_number, whole_number

_UNLIMITED = 2**62
_LEAST_TIME = 1e-9  # [s]; a budget is above zero

# Rounds of the search: samples of one, and the bound on its path as a multiple of the best length.
_LEAST_ROUND, _MOST_ROUND, _OF_FIRST = 16_000, 64_000, 4
_FACTOR, _MOST_FACTOR, _AFTER_PATH, _AFTER_NONE = 1.5, 4.0, 0.9, 1.15
_EXACT_EVERY = 32  # rounds; one of these is bounded by the best length itself

# Short-cuts of a new path: attempts, and the multiple of the best length beyond which it is given up.
_RACE = ((60, 1.6), (200, 1.25), (400, 1.08), (800, 1.02), (1600, 1.0))
_PLAIN = 60  # attempts that need no detours yet
_POLISH = 600  # attempts to shorten the best path, which end when they gain less than this:
_LEAST_GAIN = 1e-5
_FINER = 2  # short-cuts graze obstacles, so they are checked more closely than the edges of trees
_POLISH_SHARE = 0.4  # of the samples of the round before: most attempts in all
_HISTORY_STEP = 1e-4  # part of the cost: smaller gains share an entry of the history


def aorrtc(
    problem: Problem,
    path: Path | None = None,
    *,
    seed: int = 0,
    timeout: float = 1.0,
    max_iterations: int | None = None,
    gap: float | None = None,
    step: float | None = None,
) -> Result:
    """Search a path, then keep shortening it until it is short enough or the time budget is used up.

    RRT-Connect finds a first path, if none is given.  Then rounds follow.  In each, two trees grow anew as in
    `rrt_connect`, but know the cost of every node: a sample is drawn where a path through it can be short
    enough; a tree is extended towards it from the nearest node that leads there at a cost drawn between the
    least possible and the greatest of use; a new node may change its parent for a cheaper one; and the trees
    meet only where the whole path is below a bound.  What is found is shortened (`shortcut` with detours).

    It runs as machine code.  A validity checker that is a Python callable is called back from there, which
    gives the same result, later.  Edges are checked at the problem's resolution.  Short paths graze
    obstacles: let the checker keep a margin.

    Args:
        problem: What to plan.  Where goals are drawn by a sampler, those drawn for the first path stay.
        path: A valid path to begin with, which is not checked again; it may begin and end elsewhere than the
            problem says.  Then its start counts, and its end is one more goal.
        seed: Seed of all random choices.
        timeout: Time budget [s]; all of it is used unless the path becomes short enough.
        max_iterations: Greatest number of samples.  Without it the time budget decides, and the result
            depends on the speed of the machine.
        gap: Stop where the length is at most ``1 + gap`` times the straight line to the nearest goal, the
            lower bound; None or 0: where it is the straight line.
        step: Greatest length of an extension [length unit of the metric]; a tenth of the box's diagonal if
            omitted.

    Returns:
        The result, with the history of costs, the lower bound and why it stopped; without a path its status
        tells why.  With a path given it is never longer than that.

    Raises:
        InvalidValueError: The path has another number of coordinates, an option is not allowed, or the
            checker answers in a wrong shape.
    """
    load_code(plant, grow, shorten)
    deadline = Deadline(timeout)
    seed, gap = whole_number("seed", seed), _checked_gap(gap)
    most = _UNLIMITED if max_iterations is None else whole_number("max_iterations", max_iterations)
    step = None if step is None else positive_number("step", step)
    task = problem if path is None else _from_path(problem, path)
    counters = new_counters()
    with machine_code_of(task, deadline, counters=counters) as code:
        search = Search(task, code, counters, seed, step)
        run = _Run(task, search, deadline, seed, gap)
        if path is None:
            status = search.run(GoalSource(task, seed), deadline, most)
            if status is not Status.SOLVED:
                return search.result(status, deadline, seed)
            run.begin(*search.path())
            run.improve(most)
        else:
            rooted = search.begin(deadline)
            run.begin(path.points, len(task.goals) - 1)
            if search.found_straight:
                run.offer(Path.trusted(search.path()[0], problem.metric), search.path()[1])
            if rooted:
                run.improve(most)
    reached = run.goal if run.goal < len(problem.goals) or problem.goal_sampler is not None else None
    return search.result(
        Status.SOLVED, deadline, seed, run.best, reached,
        history=tuple(run.history), lower_bound=run.lower_bound, stop_reason=run.stop_reason,
    )  # fmt: skip


def _checked_gap(gap: float | None) -> float:
    """Return a gap as a number."""
    if gap is None:
        return 0.0
    if not (isinstance(gap, int | float) and 0.0 <= gap < math.inf):
        raise InvalidValueError("gap", gap, "a finite number of 0 or more, or None")
    return float(gap)


def _from_path(problem: Problem, path: Path) -> Problem:
    """Return the problem of a path: its start, and its end as the last goal."""
    if path.n != problem.n:
        got = f"{path.n} coordinates"
        raise InvalidValueError("path", got, f"{problem.n} coordinates, as in the problem")
    goals = np.concatenate((problem.goals, path.points[-1:]))
    return problem.begun_at(path.points[0], goals)


class _Run:
    """The best path so far, and how it is made shorter.

    A new path is shortened in stages as long as it stays near the best, and the best path in between until
    nothing is gained.  Nearly all rounds have a bound above the best length, because short-cuts save a good
    part of a new path; the factor falls when a round finds a path and rises when it does not, so that about
    half of them do.  One in 32 is AORRTC itself: its bound is the best length, and its size follows Luby's
    sequence.  These make the length tend to that of the shortest path with probability one.
    """

    def __init__(self, problem: Problem, search: Search, deadline: Deadline, seed: int, gap: float) -> None:
        self._problem, self._search, self._deadline, self._gap = problem, search, deadline, gap
        self._seed, self._calls = seed, 0
        self._fine = max(problem.spacing / _FINER, FINEST_RESOLUTION * problem.diagonal)
        self.goal, self.lower_bound = -1, 0.0
        self.history: list[Improvement] = []

    def begin(self, points: FloatArray, goal: int) -> None:
        """Begin with a path to one of the goals."""
        self.best, self.goal = Path.trusted(points, self._problem.metric), goal
        self.lower_bound = self._search.straight_length()
        self.history.append(Improvement(self._deadline.elapsed, self.best.length, self._search.samples))

    @property
    def stop_reason(self) -> StopReason:
        """Why no more is done."""
        if self._short_enough:
            return StopReason.GAP_REACHED
        return StopReason.TIME_UP if self._deadline.expired else StopReason.ITERATIONS_USED

    @property
    def _short_enough(self) -> bool:
        return self.best.length <= self.lower_bound * (1.0 + max(self._gap, 1e-9))

    def improve(self, most: int) -> None:
        """Shorten the best path until it is short enough, or samples or time run out."""
        search = self._search
        if search.samples < most:
            self._race(self.best, self.goal)
        factor, rounds, gained = _FACTOR, 0, True
        usual = min(max(_LEAST_ROUND, _OF_FIRST * search.samples), _MOST_ROUND)
        while search.samples < most and not (self._deadline.expired or self._short_enough):
            rounds += 1
            exact = rounds % _EXACT_EVERY == 0
            size = usual * luby(rounds // _EXACT_EVERY) if exact else usual
            before, length = search.samples, self.best.length
            bound = length * (1.0 if exact else factor)
            found = search.below(bound, min(size, most - before), self._deadline)
            if found:
                points, goal = search.path()
                self._race(Path.trusted(points, self._problem.metric), goal)
            if not exact:
                factor *= _AFTER_PATH if found else _AFTER_NONE
                factor = min(max(factor, 1.0), _MOST_FACTOR)
            gained = gained or self.best.length < length
            if gained:
                gained = self._polish(_POLISH_SHARE * (search.samples - before))

    def _race(self, path: Path, goal: int) -> None:
        """Shorten a path in stages as long as it is near the best."""
        for attempts, share in _RACE:
            path = self._shortened(path, attempts)
            self.offer(path, goal)
            if path.length > share * self.best.length or self._deadline.expired or self._short_enough:
                return

    def _polish(self, attempts: float) -> bool:
        """Shorten the best path; return whether the last attempts still gained."""
        done = 0
        while True:
            length = self.best.length
            self.offer(self._shortened(self.best, _POLISH), self.goal)
            gained, done = self.best.length < length * (1.0 - _LEAST_GAIN), done + _POLISH
            if not gained or done >= attempts or self._deadline.expired or self._short_enough:
                return gained

    def _shortened(self, path: Path, attempts: int) -> Path:
        """Return a path after some short-cuts, each time with other random choices."""
        self._calls += 1
        return shortcut(
            self._problem, path, seed=self._seed + (self._calls << 64), iterations=attempts,
            timeout=max(self._deadline.left, _LEAST_TIME), resolution=self._fine,
            detours=attempts > _PLAIN,
        )  # fmt: skip

    def offer(self, path: Path, goal: int) -> None:
        """Take a path if it is the best so far, and valid edge by edge: short-cuts leave parts of others."""
        if path.length >= self.best.length or not self._search.is_valid(path.points):
            return
        self.best, self.goal = path, goal
        entry = Improvement(self._deadline.elapsed, path.length, self._search.samples)
        history = self.history
        if len(history) > 1 and history[-1].cost > history[-2].cost * (1.0 - _HISTORY_STEP):
            history.pop()
        history.append(entry)
