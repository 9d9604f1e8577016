"""What is to be planned: a box of states, a start, goals and an oracle of validity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .goal_source import GoalSampler
from .metric import Metric
from .oracle import Oracle, StateValidity
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
"""Of the diagonal: a finer resolution would put more than a million states on one edge."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A motion planning problem in a box of n coordinates.

    Everything is checked when the problem is made, and copied; arrays are read-only.  Whether start and goals
    are *valid* is not asked here: that is a finding, and a status in the planner's result.

    Attributes:
        lower: Lower bounds of the box that is searched, shape (n,), finite.  A coordinate without bounds
            needs a finite sampling range here.
        upper: Upper bounds, shape (n,), finite, none below `lower`.
        start: Start state, shape (n,), inside the box.
        goals: Goal states, shape (k, n), inside the box; any of them will do.  One goal may be given as (n,).
            A callable that draws goals may be given instead (see `GoalSampler`); the attribute then has the
            shape (0, n).
        oracle: Which states are valid: a callable (see `StateValidity`), or machine code
            (`CompiledValidity`), with which planners run as machine code themselves.
        weights: Weights of the metric, shape (n,), see `Metric`; ones if omitted.
        resolution: Greatest distance between checked states of an edge [length unit of the metric]; a
            hundredth of the box's diagonal if omitted.
        labels: Names of the n coordinates, for messages; none if omitted.
        metric: The metric, made from the weights.
        goal_sampler: The callable that was given as `goals`; None if goals were given.
    """

    lower: FloatArray
    upper: FloatArray
    start: FloatArray
    goals: Any  # given as states or as a sampler; an array once the problem is made
    oracle: StateValidity
    weights: FloatArray | None = None
    resolution: float | None = None
    labels: tuple[str, ...] | None = None
    metric: Metric = field(init=False, repr=False)
    goal_sampler: GoalSampler | None = field(init=False, repr=False)

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
        _require_oracle(self.oracle, n)
        metric = Metric.of(self.weights, n)
        diagonal = float(metric.distance(lower, upper))
        resolution = _checked_resolution(self.resolution, diagonal)
        values: dict[str, object] = dict(lower=lower, upper=upper, start=start, goals=goals)
        values["weights"] = metric.weights
        values |= dict(resolution=resolution, labels=labels, metric=metric, goal_sampler=sampler)
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.lower.size)

    @property
    def spacing(self) -> float:
        """The resolution, which is a number once the problem is made [length unit of the metric]."""
        return float(self.resolution)  # type: ignore[arg-type]

    @cached_property
    def diagonal(self) -> float:
        """Length of the box's diagonal [length unit of the metric]."""
        return float(self.metric.distance(self.lower, self.upper))

    def towards(self, goal: int) -> Problem:
        """Return the same problem with one of its goals only."""
        return self._with(goals=read_only(self.goals[goal : goal + 1].copy()))

    def judged_by(self, oracle: StateValidity) -> Problem:
        """Return the same problem with another oracle of validity.

        Raises:
            InvalidValueError: The oracle is machine code for another number of coordinates, or no callable.
        """
        _require_oracle(oracle, self.n)
        return self._with(oracle=oracle)

    def resolved(self, resolution: float) -> Problem:
        """Return the same problem at another resolution.

        Raises:
            InvalidValueError: The resolution is not allowed.
        """
        return self._with(resolution=_checked_resolution(resolution, self.diagonal))

    def _with(self, **fields: Any) -> Problem:
        """Return a copy with other fields that are known to be sound."""
        made = object.__new__(Problem)
        made.__dict__.update(self.__dict__, **fields)
        return made

    def counting_oracle(self, deadline: Deadline | None = None, resolution: float | None = None) -> Oracle:
        """Return a fresh oracle adapter whose counters start at zero.

        Args:
            deadline: Time budget of the run; none if omitted.
            resolution: Another resolution than the problem's [length unit of the metric].

        Raises:
            InvalidValueError: The resolution is not allowed.
        """
        wanted = self.resolution if resolution is None else resolution
        return Oracle(self.oracle, self.metric, _checked_resolution(wanted, self.diagonal), deadline)


def _one_or_many(goals: ArrayLike) -> ArrayLike:
    try:
        return read_only(np.asarray(goals)[None, :].copy()) if np.ndim(goals) == 1 else goals
    except ValueError:  # ragged rows: refused with a message by the check that follows
        return goals


def _checked_labels(labels: Sequence[str] | None) -> tuple[str, ...] | None:
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
    for quantity, value in (("lower", lower), ("upper", upper)):
        bounds = np.asarray(value)
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


def _require_oracle(oracle: object, n: int) -> None:
    if isinstance(oracle, CompiledValidity):
        if oracle.n != n:
            raise InvalidValueError("oracle", f"machine code for {oracle.n} coordinates", f"{n} coordinates")
    elif not callable(oracle):
        raise InvalidValueError("oracle", oracle, "a callable over states of shape (m, n)")


def _checked_resolution(resolution: float | None, diagonal: float) -> float:
    if resolution is None:
        return diagonal / 100.0
    value = positive_number("resolution", resolution)
    if value < FINEST_RESOLUTION * diagonal:
        raise InvalidValueError(
            "resolution", value, f"at least {FINEST_RESOLUTION:g} of the diagonal, {diagonal:.6g}"
        )
    return value
