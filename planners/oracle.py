"""The validity oracle: all that a planner knows of the world.

A planner never sees obstacles, joints or links.  It asks one question, "which of these states are valid?",
and asks it for many states at once, because a batch costs little more than a single state for a vectorised or
compiled oracle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline
from .metric import Metric
from .vectors import BoolArray, FloatArray, positive_number

MAX_BATCH = 256
"""Most states passed in one call: what a time budget can be overrun by."""

_FIRST_BATCH = 24
_GROWTH = 4


@runtime_checkable
class StateValidity(Protocol):
    """What a user supplies: a callable over a batch of states.

    It receives a C-contiguous float64 array of shape (m, n) with m >= 1, which it must not modify, and
    returns a boolean array of shape (m,), True where the state is valid.  The same state must always get the
    same answer.
    """

    def __call__(self, states: FloatArray, /) -> BoolArray:
        """Return which of the states are valid."""
        ...


class Advance(NamedTuple):
    """How far one gets on an edge.

    Attributes:
        valid_steps: Number of steps from the edge's start up to its last state known valid.
        steps: Number of steps of the whole edge.
    """

    valid_steps: int
    steps: int

    @property
    def reached(self) -> bool:
        """Whether the whole edge is valid."""
        return self.valid_steps == self.steps


@lru_cache(maxsize=256)
def visiting_order(count: int) -> NDArray[np.int64]:
    """Return 0 .. count - 1 in the order of the van der Corput sequence (base 2).

    Each prefix of the order is spread evenly over the whole range, so that an obstacle anywhere on an edge is
    met early.  Source: J. G. van der Corput, Verteilungsfunktionen, 1935: the digits of a counter, mirrored.
    """
    bits = max(1, (count - 1).bit_length())
    counter = np.arange(1 << bits)
    mirrored = np.zeros_like(counter)
    for bit in range(bits):
        mirrored |= ((counter >> bit) & 1) << (bits - 1 - bit)
    order = mirrored[mirrored < count]
    order.setflags(write=False)
    return order


class Oracle:
    """A validity function together with the metric and the resolution at which edges are checked; it counts.

    Edges are checked at states no further apart than the resolution, so each point of an edge found valid
    lies within half the resolution of a state that was checked.  If the invalid set is grown by half the
    resolution (measured in the metric), a valid edge is valid at every point; without such a margin it may
    cut a corner.

    When the time budget runs out, what has not been checked yet counts as not valid: no answer is ever
    guessed.

    The class is the one door for validity in Python; an oracle that is machine code may enter here too, since
    it is also a callable.  Compiled planners ask it by its address instead (see `CompiledValidity`).

    Attributes:
        metric: The metric of the edges.
        resolution: Greatest distance between checked states of an edge [length unit of the metric].
        calls: Number of calls of the validity function so far.
        states: Number of states asked about so far.
    """

    def __init__(
        self,
        valid: StateValidity,
        metric: Metric,
        resolution: float,
        deadline: Deadline | None = None,
    ) -> None:
        """Wrap a validity function.

        Args:
            valid: The function, see `StateValidity`.
            metric: The metric of the edges.
            resolution: Greatest distance between checked states of an edge [length unit of the metric].
            deadline: Time budget; none if omitted.

        Raises:
            InvalidValueError: The function is not callable or the resolution is not above zero.
        """
        if not callable(valid):
            raise InvalidValueError("oracle", valid, "a callable over states of shape (m, n)")
        self._valid = valid
        self._deadline = Deadline() if deadline is None else deadline
        self.metric = metric
        self.resolution = positive_number("resolution", resolution)
        self.calls = 0
        self.states = 0

    def states_valid(self, states: FloatArray) -> BoolArray:
        """Return which states are valid, asking for all of them at once.

        Args:
            states: Shape (m, n).

        Returns:
            Shape (m,), True where valid.

        Raises:
            InvalidValueError: The validity function answered with something else than (m,) booleans.
        """
        states = np.ascontiguousarray(states, dtype=np.float64)
        answer = np.asarray(self._valid(states))
        self.calls += 1
        self.states += len(states)
        if answer.shape != (len(states),) or answer.dtype != np.bool_:
            got = f"{answer.dtype} of shape {answer.shape} for {len(states)} states"
            raise InvalidValueError("answer of the oracle", got, f"bool of shape ({len(states)},)")
        return answer

    def edge_valid(self, a: FloatArray, b: FloatArray) -> bool:
        """Return whether the straight edge from a to b is valid, both ends included; shapes (n,)."""
        return self.polyline_valid(np.stack((a, b)))

    def polyline_valid(self, points: FloatArray) -> bool:
        """Return whether all edges between successive points are valid, ends included.

        The states are asked about in van der Corput order, in batches that grow; the first invalid one ends
        it.

        Args:
            points: Shape (k, n), k >= 2.

        Raises:
            InvalidValueError: A point is not finite.
        """
        lengths = self.metric.distance(points[:-1], points[1:])
        steps = np.array([self._steps(float(length)) for length in lengths])
        firsts = np.concatenate(([0], np.cumsum(steps)))
        order = visiting_order(int(firsts[-1]) + 1)
        for batch in self._batches(order.size):
            chosen = order[batch]
            edge = np.minimum(np.searchsorted(firsts, chosen, side="right") - 1, len(steps) - 1)
            fraction = ((chosen - firsts[edge]) / steps[edge])[:, None]
            states = points[edge] + fraction * (points[edge + 1] - points[edge])
            if self._deadline.expired or not self.states_valid(states).all():
                return False
        return True

    def advance(self, a: FloatArray, b: FloatArray) -> Advance:
        """Return how far one gets from a straight towards b; a itself is taken to be valid.

        Args:
            a: Start of the edge, shape (n,).
            b: End of the edge, shape (n,).

        Returns:
            Steps known valid and steps in all; step j is the state ``a + (b - a) j / steps``.

        Raises:
            InvalidValueError: An end is not finite.
        """
        scaled = (b - a) * self.metric.weights
        steps = self._steps(math.sqrt(float(scaled @ scaled)))
        return Advance(self.prefix(a, b, steps), steps)

    def prefix(self, a: FloatArray, b: FloatArray, steps: int) -> int:
        """Return how many states ``a + (b - a) j / steps``, j = 1 .. steps, are valid from the first on.

        Args:
            a: Start of the edge, shape (n,).
            b: End of the edge, shape (n,).
            steps: Number of steps, one or more.
        """
        difference = b - a
        for batch in self._batches(steps):
            fractions = np.arange(batch.start + 1, batch.stop + 1) / steps
            states = a + fractions[:, None] * difference
            if batch.stop == steps:
                states[-1] = b
            if self._deadline.expired:
                return batch.start
            valid = self.states_valid(states)
            if not valid.all():
                return batch.start + int(np.argmin(valid))
        return steps

    def _steps(self, length: float) -> int:
        if not math.isfinite(length):
            raise InvalidValueError("edge", f"length {length}", "finite end states")
        return max(1, math.ceil(length / self.resolution))

    @staticmethod
    def _batches(count: int) -> Iterator[slice]:
        start, size = 0, _FIRST_BATCH
        while start < count:
            stop = min(start + size, count)
            yield slice(start, stop)
            start, size = stop, min(size * _GROWTH, MAX_BATCH)
