"""AORRTC, an anytime planner: a first path quickly, then ever shorter ones.

Sources: T. S. Wilson, W. Thomason, Z. Kingston and J. D. Gammell, AORRTC: Almost-surely asymptotically
optimal planning with RRT-Connect, IEEE Robotics and Automation Letters 10(12), 2025; K. Hauser and Y. Zhou,
Asymptotically optimal planning by feasible kinodynamic planning in a state-cost space, IEEE Trans. on
Robotics 32(6), 2016; J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, Informed RRT*, IROS 2014, for the
samples.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import FINEST_RESOLUTION, Problem
from .result import Improvement, Result, Status, StopReason
from .rrt_connect import Search
from .sampling import luby, stream_key, uniform
from .shortcut import LEAST_GAIN, shortcut, shorten
from .tree import take_trees
from .tree_growth import first_round, grow
from .vectors import positive_number, seed_number, whole_number

_UNLIMITED = 2**62
_LEAST_TIME = 1e-9  # minimum budget [s], since a budget must be above zero

# Rounds of the search.  Number of samples of one round: minimum, maximum, multiple of the first path's.  For
# rounds in the whole box, the bound on the path as a multiple of the best length: at first, minimum, maximum,
# and its factor after a path found soon, found late, and not found.
_LEAST_ROUND, _MOST_ROUND, _OF_FIRST = 8_000, 64_000, 2
_FACTOR, _LEAST_FACTOR, _MOST_FACTOR, _AFTER_SOON, _AFTER_LATE, _AFTER_NONE = 4.0, 1.1, 16.0, 0.95, 1.05, 1.3
_SOON = 0.25  # fraction of a round within which a path counts as found soon
# Rounds near the straight line: their fraction of all rounds; excess length of the ellipsoid relative to the
# line at first, minimum, maximum, and its factors after a round with and without a path.
_NEAR, _WIDTH, _LEAST_WIDTH, _MOST_WIDTH, _NARROWER, _WIDER = 0.8, 4.0, 0.02, 64.0, 0.75, 1.1
# Number of their samples: multiple of the mean number that a path took, minimum, weight of the last path in
# that mean, and factor on the mean where no path is found.
_OF_USED, _LEAST_NEAR, _WEIGHT, _LONGER = 2.0, 500, 0.3, 1.3
_JITTER = 0.5  # random variation of the logarithm of the ellipsoid's excess length
_STREAM = 2
_EXACT_EVERY = 32  # rounds: one in so many is bounded by the best length itself

# Short-cuts of paths: attempts without detours, attempts up to the first stage, and the factor by which each
# stage has more attempts in all and fewer paths than the stage before.
_PLAIN, _FIRST_STAGE, _STAGE_FACTOR = 60, 400, 4
# Minimum gain of the first shortcuts of a path and of the best path, relative to the length: saves checks.
_FIRST_GAIN, _FIRST_POLISH = 8e-3, 4e-4
_POLISH = 1600  # attempts to shorten the best path at once
_MOST_WAITING = 64  # maximum number of waiting paths of a stage
_LAST_PART = 0.15  # fraction of the time, at its end, for the best path alone
_FINER = 2  # factor of finer checks of shortcuts than of tree edges, since shortcuts graze obstacles
_HISTORY_STEP = 1e-4  # gains below this ratio of the cost share an entry of the history


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

    RRT-Connect finds a first path, if none is given.  Then rounds follow.  In each, two new trees grow as in
    `rrt_connect`, but store the cost of every node: a sample is drawn where a path through it can be short
    enough; a tree is extended towards the sample from the nearest node that reaches it at a cost drawn
    between the minimum possible and the maximum of use; a new node may change its parent for a cheaper one;
    and the trees meet only where the whole path is below a bound.  Paths are shortened (`shortcut` with
    detours), good ones more than others; most of the time goes into that.

    It runs as machine code.  A validity checker that is a Python callable is called back from there, which
    gives the same result, later.  Edges are checked at the problem's resolution.  Short paths graze
    obstacles: let the checker keep a margin.

    Args:
        problem: The problem.  If a sampler draws goals, the goals drawn for the first path are kept.
        path: A valid initial path, which is not checked again.  Its ends may differ from the problem's: its
            start is used, and its end is one more goal.
        seed: Seed of all random choices.
        timeout: Time budget [s]; all of it is used unless the path becomes short enough.
        max_iterations: Maximum number of samples.  Without it the time budget decides, and the result
            depends on the speed of the machine.
        gap: Stop once the length is at most ``1 + gap`` times the straight line to the nearest goal, the
            lower bound; None or 0: once it is the straight line.
        step: Maximum length of an extension [length unit of the metric]; a tenth of the box's diagonal if
            omitted.

    Returns:
        The result, with the history of costs, the lower bound and the reason to stop; without a path its
        status says why.  Its path is never longer than a path given.

    Raises:
        InvalidValueError: The path has another number of coordinates, an option is not allowed, or the
            checker answers in a wrong shape.
    """
    load_code(first_round, grow, shorten)
    deadline = Deadline(timeout)
    seed, gap = seed_number(seed), checked_gap(gap)
    most = _UNLIMITED if max_iterations is None else whole_number("max_iterations", max_iterations)
    step = None if step is None else positive_number("step", step)
    task = problem if path is None else _from_path(problem, path)
    trees = take_trees(task.n)
    with machine_code_of(task, deadline, counters=trees.counters) as code:
        search = Search(task, code, trees, seed, step)
        run = _BestPath(task, search, deadline, seed, gap)
        if path is None:
            status = search.run(deadline, most)
            if status is not Status.SOLVED:
                return search.result(status, deadline, seed)
            run.begin(*search.path())
            run.shorten(most)
        else:
            rooted = search.begin(deadline)
            run.begin(Path.trusted(path.points, task.metric), len(task.goals) - 1)
            if search.found_straight:
                run.offer(*search.path())
            if rooted:
                run.shorten(most)
    reached = run.goal if run.goal < len(problem.goals) or problem.goal_sampler is not None else None
    return search.result(
        Status.SOLVED, deadline, seed, run.best, reached,
        history=tuple(run.history), lower_bound=run.lower_bound, stop_reason=run.stop_reason,
    )  # fmt: skip


def checked_gap(gap: float | None) -> float:
    """Return a gap as a number, 0 for None.

    Raises:
        InvalidValueError: It is below 0, or not finite.
    """
    if gap is None:
        return 0.0
    allowed = "a finite number of 0 or more, or None"
    if not (isinstance(gap, int | float) and 0.0 <= gap < math.inf):
        raise InvalidValueError("gap", gap, allowed)
    try:
        return float(gap)
    except OverflowError:
        raise InvalidValueError("gap", gap, allowed) from None


def _from_path(problem: Problem, path: Path) -> Problem:
    """Return the problem of a path: its start, and its end as the last goal."""
    problem.require_same("path", path.n)
    goals = np.concatenate((problem.goals, path.points[-1:]))
    return problem.begun_at(path.points[0], goals)


class _Stage:
    """Paths that have had the same number of shortcuts.

    Attributes:
        lengths: Lengths of all paths that reached the stage, in ascending order.
        waiting: Paths that have not gone on to the next stage, as (length, number, path, goal), best first.
    """

    def __init__(self) -> None:
        self.lengths: list[float] = []
        self.waiting: list[tuple[float, int, Path, int]] = []

    def add(self, path: Path, number: int, goal: int) -> None:
        """Add a path."""
        insort(self.lengths, path.length)
        insort(self.waiting, (path.length, number, path, goal))
        del self.waiting[_MOST_WAITING:]

    def best(self, least: int) -> tuple[float, int, Path, int] | None:
        """Remove and return the best waiting path if it is in the best quarter or among the best `least`."""
        if not self.waiting:
            return None
        rank = bisect_left(self.lengths, self.waiting[0][0])
        return self.waiting.pop(0) if rank < max(len(self.lengths) // _STAGE_FACTOR, least) else None


class _BestPath:
    """The best path so far, and the search for shorter ones.

    Where two paths pass obstacles on different sides, shortcuts do not turn one into the other, and only
    many shortcuts show which is shorter.  So paths are searched repeatedly and compete: all are shortened a
    little, the best quarter four times as much, the best quarter of that quarter again four times as much,
    and so on (L. Li et al., A system for massively parallel hyperparameter tuning, MLSys 2020: asynchronous
    successive halving).  Where time counts, the first shortcuts skip small gains, which cost as many checks
    as large ones.

    Short-cuts save most of a new path, but seldom lead to another side of an obstacle, so nearly all rounds
    search without a bound or with a generous one.  Four in five rounds draw samples near the straight line,
    from the ellipsoid of the states through which paths up to a length lead.  The ellipsoid becomes narrower
    after a round that finds a path and wider after one that does not, so that paths lie as near to the
    straight line as the time of a round allows; it may be narrower than the best path, since the shortest
    path may be.  Such a round ends after twice the samples that a path took on average, or most of the time
    would go into rounds without a path.  Other rounds draw from the whole box and bound the path by a
    multiple of the best length, which falls and rises in the same way.  One round in 32 is AORRTC itself: its
    bound is the best length, and its size follows Luby's sequence.  AORRTC's rounds make the length converge
    to the minimum with probability one.
    """

    def __init__(self, problem: Problem, search: Search, deadline: Deadline, seed: int, gap: float) -> None:
        self._problem, self._search, self._deadline, self._gap = problem, search, deadline, gap
        self._seed, self._calls = seed, 0
        self._fine = max(problem.spacing / _FINER, FINEST_RESOLUTION * problem.diagonal)
        self.goal, self.lower_bound = -1, 0.0
        self.history: list[Improvement] = []
        self._stages: list[_Stage] = []
        self._key = stream_key(seed, _STREAM)
        self._factor, self._width, self._first_gain = _FACTOR, _WIDTH, 0.0
        self._used = math.inf  # samples that rounds near the straight line took to a path, on average

    def begin(self, path: Path, goal: int) -> None:
        """Begin with a path to one of the goals."""
        self.best, self.goal = path, goal
        self.lower_bound = self._search.straight_length()
        self.history.append(Improvement(self._deadline.elapsed, self.best.length, self._search.samples))

    @property
    def stop_reason(self) -> StopReason:
        """Reason why the search stopped."""
        if self._short_enough:
            return StopReason.GAP_REACHED
        return StopReason.TIME_UP if self._deadline.expired else StopReason.ITERATIONS_USED

    @property
    def _short_enough(self) -> bool:
        return self.best.length <= self.lower_bound * (1.0 + max(self._gap, 1e-9))

    @property
    def _over(self) -> bool:
        return self._deadline.expired or self._short_enough

    def shorten(self, most: int) -> None:
        """Shorten the best path until it is short enough, or samples or time run out."""
        search, rounds = self._search, 0
        usual = min(max(_LEAST_ROUND, _OF_FIRST * search.samples), _MOST_ROUND)
        last, gain = 0.0, _FIRST_POLISH
        if most == _UNLIMITED:  # time counts, and its last part makes up for gains passed over
            last, self._first_gain = self._deadline.timeout * _LAST_PART, _FIRST_GAIN
        if search.samples < most:
            self._compete(self.best, self.goal, 0)
        while search.samples < most and not self._over:
            if self._deadline.left < last:
                self.offer(self._shortened(self.best, _POLISH, gain), self.goal)
                gain = max(gain / 2.0, LEAST_GAIN)
                continue
            if self._promote():
                continue
            rounds += 1
            exact = rounds % _EXACT_EVERY == 0
            size = usual * (luby(rounds // _EXACT_EVERY) if exact else 1)
            size = min(size, most - search.samples)
            if exact:
                found = search.below(self.best.length, size, self._deadline)
            elif uniform(self._key, 2 * rounds) < _NEAR:
                found = self._search_inside(size, rounds)
            else:
                found = self._search_below(size)
            if found:
                self._compete(*search.path(), 0)
        while not self._over and self._promote():
            pass

    def _search_below(self, size: int) -> bool:
        """Search a path below a multiple of the best length, which adapts; return whether there is one."""
        search, before = self._search, self._search.samples
        found = search.below(self.best.length * self._factor, size, self._deadline)
        soon = search.samples - before < _SOON * size
        self._factor *= (_AFTER_SOON if soon else _AFTER_LATE) if found else _AFTER_NONE
        self._factor = min(max(self._factor, _LEAST_FACTOR), _MOST_FACTOR)
        return found

    def _search_inside(self, size: int, number: int) -> bool:
        """Search a path near the straight line, in an ellipsoid that adapts; return whether there is one.

        Args:
            size: Maximum number of samples; fewer if paths take fewer.
            number: Index of the round, for its random numbers.
        """
        width = self._width * math.exp(_JITTER * (2.0 * uniform(self._key, 2 * number + 1) - 1.0))
        self._used = min(self._used, size / _OF_USED)
        before, most = self._search.samples, int(min(max(_OF_USED * self._used, _LEAST_NEAR), size))
        found = self._search.below(math.inf, most, self._deadline, self.lower_bound * (1.0 + width))
        if found:
            self._used += _WEIGHT * (self._search.samples - before - self._used)
        else:
            self._used *= _LONGER
        self._width *= _NARROWER if found else _WIDER
        self._width = min(max(self._width, _LEAST_WIDTH), _MOST_WIDTH)
        return found

    def _promote(self) -> bool:
        """Shorten one of the best paths of a stage up to the next stage; return whether there was one."""
        for k in reversed(range(len(self._stages))):
            entry = self._stages[k].best(1 if k == 0 else 0)
            if entry is not None:
                self._compete(entry[2], entry[3], k + 1)
                return True
        return False

    def _compete(self, path: Path, goal: int, stage: int) -> None:
        """Shorten a path up to a stage, and let it wait there."""
        attempts = _FIRST_STAGE * _STAGE_FACTOR**stage
        if not stage:
            path = self._shortened(path, _PLAIN, LEAST_GAIN, detours=False)
        gain = max(self._first_gain / _STAGE_FACTOR**stage, LEAST_GAIN)
        path = self._shortened(path, attempts - (attempts // _STAGE_FACTOR if stage else _PLAIN), gain)
        if stage == len(self._stages):
            self._stages.append(_Stage())
        self.offer(path, goal)
        if len(path) > 2:  # a straight edge cannot become shorter
            self._stages[stage].add(path, self._calls, goal)

    def _shortened(self, path: Path, attempts: int, gain: float, *, detours: bool = True) -> Path:
        """Return a path after some shortcuts, each time with other random choices."""
        self._calls += 1
        return shortcut(
            self._problem, path, seed=self._seed + (self._calls << 64), iterations=attempts,
            timeout=max(self._deadline.left, _LEAST_TIME), resolution=self._fine, least_gain=gain,
            detours=detours,
        )  # fmt: skip

    def offer(self, path: Path, goal: int) -> None:
        """Keep a path if it is the best so far and valid edge by edge: shortcuts may leave partial edges."""
        if path.length >= self.best.length or not self._search.is_valid(path.points):
            return
        self.best, self.goal = path, goal
        entry = Improvement(self._deadline.elapsed, path.length, self._search.samples)
        history = self.history
        if len(history) > 1 and history[-1].cost > history[-2].cost * (1.0 - _HISTORY_STEP):
            history.pop()
        history.append(entry)
