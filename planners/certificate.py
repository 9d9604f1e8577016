"""Independent check of a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .path import Path
from .problem import Problem
from .smooth import SmoothPath
from .vectors import FloatArray, positive_number

_ROUNDING = 1e-12  # tolerance for rounding, relative to the box's size


@dataclass(frozen=True, eq=False)
class PathCertificate:
    """Properties of a path, computed from the problem and the path alone.

    Attributes:
        first_invalid: The first invalid state met, shape (n,); None if all are valid.
        within_bounds: Whether all states checked are inside the box.
        start_error: Distance of the path's first state from the start [length unit of the metric].
        goal_error: Distance of the path's last state from the nearest goal [length unit of the metric]; 0 if
            goals are drawn by a sampler, which cannot tell whether a state is a goal.
        states_checked: Number of states that were checked.
        resolution: Maximum step between checked states [length unit of the metric].
    """

    first_invalid: FloatArray | None
    within_bounds: bool
    start_error: float
    goal_error: float
    states_checked: int
    resolution: float

    @property
    def success(self) -> bool:
        """Whether all states checked are valid and inside the box, and the ends are exact."""
        ends_met = self.start_error == 0.0 and self.goal_error == 0.0
        return self.first_invalid is None and self.within_bounds and ends_met


def certify(problem: Problem, path: Path | SmoothPath, *, resolution: float | None = None) -> PathCertificate:
    """Check a path against a problem, state by state.

    Args:
        problem: The problem that was to be solved.
        path: A polyline or a smooth path.
        resolution: Maximum step between checked states [length unit of the metric]; the problem's if
            omitted. A finer one than the planner's shows how much of the validity is due to coarse checks.

    Returns:
        The certificate.

    Raises:
        InvalidValueError: The path has another number of coordinates, or the resolution is not allowed.
    """
    problem.require_same("path", path.n)
    validator = problem.validator(resolution=resolution)
    spacing = positive_number("resolution", validator.resolution)
    if isinstance(path, Path):
        states = Path(path.points, problem.weights).resample(spacing).points
    else:
        states = path.sample(spacing)
    valid = validator.states_valid(states)
    sampled = problem.goal_sampler is not None
    slack = _ROUNDING * (problem.upper - problem.lower)
    within = (states >= problem.lower - slack) & (states <= problem.upper + slack)
    return PathCertificate(
        first_invalid=None if valid.all() else states[int(np.argmin(valid))],
        within_bounds=bool(within.all()),
        start_error=float(problem.metric.distance(states[0], problem.start)),
        goal_error=0.0 if sampled else float(problem.metric.distance(states[-1], problem.goals).min()),
        states_checked=len(states),
        resolution=spacing,
    )
