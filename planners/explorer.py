"""Walks along a manifold that stay valid."""

from __future__ import annotations

from types import TracebackType

import numpy as np

from . import native_manifold as native
from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .manifold import Manifold, OnSurface
from .native_edge import check_states
from .oracle import MAX_BATCH, Oracle
from .problem import Problem
from .vectors import BoolArray, FloatArray

_FIRST_PIECE = 8
_GROWTH = 4
_LONGEST_PIECE = 64
_MOST_STEPS = 100_000


class Explorer:
    """Walks on a manifold and asks the oracle about every state on the way; used in a `with` block."""

    def __init__(
        self, problem: Problem, manifold: Manifold, deadline: Deadline, resolution: float | None = None
    ) -> None:
        """Begin a run.

        Args:
            problem: Box, metric, oracle and resolution.
            manifold: The manifold.
            deadline: Time budget.
            resolution: Another resolution than the problem's [length unit of the metric].
        """
        self.oracle = problem.counting_oracle(deadline, resolution)
        if isinstance(problem.oracle, CompiledValidity):
            kept = _KeptMemory(problem.oracle)
            self.oracle = Oracle(kept, problem.metric, self.oracle.resolution, deadline)
        self._deadline = deadline
        self._weights = problem.metric.weights
        self._context = OnSurface(manifold, problem.lower, problem.upper, self._weights)

    def __enter__(self) -> Explorer:
        """Make room for machine code."""
        self.surface = self._context.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Raise what a residual function in Python raised."""
        self._context.__exit__(kind, error, traceback)

    def walk(
        self, origin: FloatArray, target: FloatArray, *, exact: bool, longest: float = np.inf
    ) -> tuple[FloatArray, bool]:
        """Walk towards a target as far as the manifold leads nearer and states are valid.

        Args:
            origin: A valid state on the manifold, shape (n,).
            target: Any state, shape (n,).
            exact: Whether the target is on the manifold and is to be met.
            longest: Length at which the walk is given up [length unit of the metric].

        Returns:
            The states after `origin`, shape (m, n), and whether the target was met.
        """
        pieces, size, current, walked, steps = [np.empty((0, origin.size))], _FIRST_PIECE, origin, 0.0, 0
        target = np.array(target)
        while not self._deadline.expired and steps < _MOST_STEPS and not self.surface.stop[0]:
            chain = np.empty((size, origin.size))
            count = native.extend(
                self.surface, np.array(current), target, self.oracle.resolution, exact, chain
            )
            ended, count = count < 0, (-count - 1 if count < 0 else count)
            if count == 0:
                break
            valid = self.oracle.states_valid(chain[:count])
            kept = count if valid.all() else int(np.argmin(valid))
            pieces.append(chain[:kept])
            steps += kept
            if kept < count:
                break
            walked += float(self.oracle.metric.arc_lengths(np.vstack((current, chain[:kept])))[-1])
            current = chain[kept - 1]
            if exact and np.array_equal(current, target):
                return np.concatenate(pieces), True
            if ended or walked > longest:
                break
            size = min(size * _GROWTH, _LONGEST_PIECE)
        return np.concatenate(pieces), False

    def project(self, states: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return states, shape (m, n), moved onto the manifold, and which are there, shape (m,)."""
        moved, done = np.array(states, order="C"), np.zeros(len(states), dtype=np.bool_)
        native.project_rows(self.surface, moved, native.INNER, done)
        return moved, done

    def polyline_holds(self, points: FloatArray) -> bool:
        """Return whether edges of a polyline are short and meet the constraints, and points are valid.

        Args:
            points: Shape (k, n).
        """
        spans = np.diff(self.oracle.metric.arc_lengths(points))
        if spans.max(initial=0.0) > self.oracle.resolution or not native.edges_hold(self.surface, points):
            return False
        for first in range(0, len(points), MAX_BATCH):
            if (
                self._deadline.expired
                or not self.oracle.states_valid(points[first : first + MAX_BATCH]).all()
            ):
                return False
        return True


class _KeptMemory:
    """Machine code as a callable over batches that makes its memory once."""

    def __init__(self, code: CompiledValidity) -> None:
        self._code, self._memory = code, code.fresh_memory()

    def __call__(self, states: FloatArray, /) -> BoolArray:
        answers = np.empty(len(states), dtype=np.bool_)
        check_states(self._code.address, self._memory, np.array(states, order="C"), answers)
        return answers
