"""Planning problems: a box of states, a start, goals and the validity of states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline
from .metric import Metric
from .motion_validator import CompiledMotionValidator, MotionValidator, StateValidityChecker
from .vectors import (
    FloatArray,
    coordinate_name,
    finite_points,
    finite_vector,
    positive_number,
    read_only,
    require_inside,
)

FINEST_RESOLUTION = 1e-6
"""Minimum resolution relative to the diagonal: a finer one puts more than a million states on one edge."""

BETWEEN_DRAWS = 32
"""Number of iterations between the first two draws of a goal; it doubles with each draw."""

_STREAM = 0x60A1


class GoalSampler(Protocol):
    """Callable that a user supplies instead of goals: draws a goal, or returns None if it has none now.

    It is called between parts of the search: until the first valid goal is drawn, and occasionally
    afterwards.  A state that it returns must lie inside the box; its validity is checked then.
    """

    def __call__(self, rng: np.random.Generator, /) -> ArrayLike | None:
        """Return a goal state, shape (n,), or None."""
        ...


@dataclass(frozen=True, eq=False)
class Problem:
    """A motion planning problem in a box of n coordinates.

    All fields are checked and copied when the problem is made; arrays are read-only.  Whether start and goals
    are *valid* is not checked here: the planner's result has a status for it.

    Attributes:
        lower: Lower bounds of the box that is searched, shape (n,), finite.  A coordinate without bounds
            needs a finite sampling range here.
        upper: Upper bounds, shape (n,), finite, none below `lower`.
        start: Start state, shape (n,), inside the box.
        goals: Goal states, shape (k, n), inside the box; a path to any one solves the problem.  One goal may
            be given as (n,).  A callable that draws goals may be given instead (see `GoalSampler`); the
            attribute then has the shape (0, n).
        validity: Validity of states: a callable (see `StateValidityChecker`), or machine code
            (`CompiledMotionValidator`), which planners call without Python.
        weights: Weights of the metric, shape (n,), see `Metric`; ones if omitted.
        resolution: Maximum distance between checked states of an edge [length unit of the metric]; a
            hundredth of the box's diagonal if omitted.
        labels: Names of the n coordinates, for messages; none if omitted.
        metric: The metric, made from the weights.
        goal_sampler: The callable that was given as `goals`; None if goals were given.
        n: Number of coordinates.
        extent: Upper bounds minus lower bounds, shape (n,).
        diagonal: Length of the box's diagonal [length unit of the metric].
    """

    lower: FloatArray
    upper: FloatArray
    start: FloatArray
    goals: Any  # given as states or as a sampler; an array once the problem is made
    validity: StateValidityChecker
    weights: FloatArray | None = None
    resolution: float | None = None
    labels: tuple[str, ...] | None = None
    metric: Metric = field(init=False, repr=False)
    goal_sampler: GoalSampler | None = field(init=False, repr=False)
    n: int = field(init=False, repr=False)
    extent: FloatArray = field(init=False, repr=False)
    diagonal: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check and copy all fields.

        Raises:
            InvalidValueError: A field has the wrong shape or a value that is not allowed; the message names
                the coordinate by index and label.
        """
        labels = _checked_labels(self.labels)
        n = len(labels) if labels is not None else None
        lower, upper = _checked_bounds(self.lower, self.upper, n, labels)
        n = lower.size
        start = finite_vector("start", self.start, n, labels)
        require_inside("start", start, lower, upper, labels)
        sampler = self.goals if callable(self.goals) else None
        if sampler is None:
            goals = finite_points("goals", _one_or_many(self.goals), n, labels)
            if not ((goals >= lower) & (goals <= upper)).all():
                for k, goal in enumerate(goals):
                    require_inside(f"goals[{k}]", goal, lower, upper, labels)
        else:
            goals = read_only(np.empty((0, n)))
        _require_validity(self.validity, n)
        metric = Metric.of(self.weights, n)
        diagonal = float(metric.distance(lower, upper))
        resolution = _checked_resolution(self.resolution, diagonal)
        values: dict[str, object] = dict(lower=lower, upper=upper, start=start, goals=goals)
        values["weights"] = metric.weights
        values |= dict(resolution=resolution, labels=labels, metric=metric, goal_sampler=sampler)
        values |= dict(n=n, diagonal=diagonal, extent=read_only(upper - lower))
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def spacing(self) -> float:
        """The resolution as a number [length unit of the metric]."""
        return float(self.resolution)  # type: ignore[arg-type]

    def with_validity(self, validity: StateValidityChecker) -> Problem:
        """Return the same problem with another validity of states.

        Raises:
            InvalidValueError: It is machine code for another number of coordinates, or not callable.
        """
        _require_validity(validity, self.n)
        return self._with(validity=validity)

    def begun_at(self, start: FloatArray, goals: FloatArray) -> Problem:
        """Return the same problem with other ends inside the box, shapes (n,) and (k, n).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        start = finite_vector("start", start, self.n, self.labels)
        return self._with(
            start=start, goals=finite_points("goals", goals, self.n, self.labels), goal_sampler=None
        )

    def _with(self, **fields: Any) -> Problem:
        """Return a copy with other fields that need no check."""
        made = object.__new__(Problem)
        made.__dict__.update(self.__dict__, **fields)
        return made

    def require_same(self, quantity: str, n: int) -> None:
        """Refuse a quantity, such as a path, of another number n of coordinates.

        Raises:
            InvalidValueError: naming both numbers.
        """
        if n != self.n:
            raise InvalidValueError(quantity, f"{n} coordinates", f"{self.n} coordinates, as the problem")

    def validator(self, deadline: Deadline | None = None, resolution: float | None = None) -> MotionValidator:
        """Return a fresh validator of motions, whose counters start at zero.

        Args:
            deadline: Time budget of the run; none if omitted.
            resolution: Another resolution than the problem's [length unit of the metric].

        Raises:
            InvalidValueError: The resolution is not allowed.
        """
        wanted = self.resolution if resolution is None else resolution
        return MotionValidator(
            self.validity, self.metric, _checked_resolution(wanted, self.diagonal), deadline
        )


class GoalSource:
    """Goals of one run of a planner: the problem's goals, then the goals that its sampler draws.

    Attributes:
        problem: The problem.
        count: Number of goals so far.
    """

    def __init__(self, problem: Problem, seed: int) -> None:
        """Begin a run.

        Args:
            problem: The problem.
            seed: Seed of the generator that is passed to the sampler.
        """
        self.problem = problem
        self.count = len(problem.goals)
        self._rng = np.random.default_rng((_STREAM, seed))

    def draw(self) -> FloatArray | None:
        """Return another goal, shape (1, n); None if the sampler has none now.

        Raises:
            InvalidValueError: The sampler did not return a finite state inside the box.
        """
        problem = self.problem
        if problem.goal_sampler is None:
            return None
        drawn = problem.goal_sampler(self._rng)
        if drawn is None:
            return None
        goal = finite_vector("goal drawn", drawn, problem.n, problem.labels)
        require_inside("goal drawn", goal, problem.lower, problem.upper, problem.labels)
        self.count += 1
        return goal[None, :]


def _one_or_many(goals: ArrayLike) -> ArrayLike:
    """Return goal states, shape (k, n); one of shape (n,) becomes the only row, others are unchanged."""
    try:
        return read_only(np.asarray(goals)[None, :].copy()) if np.ndim(goals) == 1 else goals
    except ValueError:  # ragged rows: refused with a message by the check that follows
        return goals


def _checked_labels(labels: Sequence[str] | None) -> tuple[str, ...] | None:
    """Return labels as a tuple of different names, or None; refuse anything else."""
    if labels is None:
        return None
    allowed = "n different names, or None"
    if isinstance(labels, str) or not all(isinstance(label, str) for label in labels):
        raise InvalidValueError("labels", labels, allowed)
    if not labels or len(set(labels)) != len(labels):
        raise InvalidValueError("labels", tuple(labels), allowed)
    return tuple(labels)


def _checked_bounds(
    lower: ArrayLike, upper: ArrayLike, n: int | None, labels: tuple[str, ...] | None
) -> tuple[FloatArray, FloatArray]:
    """Return the bounds of the box, shape (n,) each.

    Args:
        lower: Lower bounds, shape (n,).
        upper: Upper bounds, shape (n,).
        n: Number of coordinates; None for the number of lower bounds.
        labels: Names of the coordinates for messages.

    Raises:
        InvalidValueError: for a wrong shape, a bound that is not finite, a lower one above its upper one, or
            a box without extent.
    """
    for quantity, value in (("lower", lower), ("upper", upper)):
        try:
            bounds = np.asarray(value)
        except ValueError:  # ragged rows
            raise InvalidValueError(quantity, value, "a vector of finite numbers") from None
        if bounds.dtype.kind == "f" and bounds.ndim == 1 and (labels is None or len(labels) == bounds.size):
            infinite = np.isinf(bounds)
            if infinite.any():
                i = int(np.argmax(infinite))
                name = coordinate_name(quantity, i, labels)
                raise InvalidValueError(
                    name, bounds[i], "a finite bound: give an unbounded coordinate a finite sampling range"
                )
    low = finite_vector("lower", lower, n, labels)
    high = finite_vector("upper", upper, low.size, labels)
    if not (low <= high).all():
        i = int(np.argmax(low > high))
        raise InvalidValueError(coordinate_name("upper", i, labels), high[i], f"at least lower, {low[i]:g}")
    if not (high > low).any():
        raise InvalidValueError("upper", high, "one coordinate or more with upper > lower")
    return low, high


def _require_validity(validity: object, n: int) -> None:
    """Refuse a validity that is not callable, or machine code for another number of coordinates."""
    if isinstance(validity, CompiledMotionValidator):
        if validity.n != n:
            got = f"machine code for {validity.n} coordinates"
            raise InvalidValueError("validity", got, f"{n} coordinates")
    elif not callable(validity):
        raise InvalidValueError("validity", validity, "a callable over states of shape (m, n)")


def _checked_resolution(resolution: float | None, diagonal: float) -> float:
    """Return the resolution [length unit of the metric], 1 % of the diagonal for None."""
    if resolution is None:
        return diagonal / 100.0
    value = positive_number("resolution", resolution)
    if value < FINEST_RESOLUTION * diagonal:
        raise InvalidValueError(
            "resolution", value, f"at least {FINEST_RESOLUTION:g} of the diagonal, {diagonal:.6g}"
        )
    return value
