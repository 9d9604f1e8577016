"""States of a motion that are examined, and bounds on how it goes on between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.certificates.polynomials import evaluate
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.rate_bounds import CUT, Parts, RateBounds, cut
from pepper_kin.trajectory.sampling import TIME_TOLERANCE, State, examination_step, sample_times

if TYPE_CHECKING:
    from pepper_kin.trajectory.trajectory import Trajectory

RELATIVE_TOLERANCE = 1e-9  # of a limit, for rounding
ALLOWANCE = 1e-3
"""Share of a torque's or speed's limit by which its bound between the states examined may be beyond it."""
_CLOSER = (2, 4, 8, 16)  # parts of a gap between states, where that is too long for a bound


class Examined(NamedTuple):
    """States of a motion that are examined, and bounds on how it goes on between them.

    Attributes:
        step: Time between the regular ones [s].
        time: When [s], shape (T,).
        state: Arrays of shape (T, n).
        part: Of `rates`, to which each state belongs, shape (T,).
        gap: Longest time between successive states of each piece [s], shape (m,).
        bounds: Bounds on second derivatives on the pieces.
        rates: Bounds on |dq/dt| there, shape (m, n).
        breaks: Ends of the pieces [s], shape (m + 1,).
        trajectory: The motion.
        parts: How it is cut into the pieces.
    """

    step: float
    time: Array
    state: State
    part: NDArray[np.intp]
    gap: Array
    bounds: RateBounds
    rates: Array
    breaks: Array
    trajectory: Trajectory
    parts: Parts

    def closer(self, pieces: NDArray[np.intp], count: int) -> Examined:
        """Return states in some pieces alone, with gaps a `count`-th as long."""
        width = np.diff(self.breaks)[pieces]
        states = count * np.ceil(width / self.gap[pieces] - TIME_TOLERANCE).astype(int) + 1
        index = np.arange(states.sum()) - np.repeat(np.cumsum(states) - states, states)
        local = index * np.repeat(width / (states - 1), states)
        part = np.repeat(pieces, states)
        state = derivatives(self.trajectory, self.parts.segment[part], self.parts.offset[part] + local, 3)
        time = self.breaks[part] + local
        return self._replace(time=time, state=State(*state), part=part, gap=self.gap / count)

    def at_most(self, size: Array, second: Array) -> Array:
        """Return bounds on a quantity on the pieces, shape (m, w).

        Args:
            size: Its absolute values at the states, shape (T, w).
            second: Bounds on its second derivative on the pieces, shape (m, w).
        """
        highest = np.zeros_like(second)
        np.maximum.at(highest, self.part, size)
        return np.asarray(highest + second * (self.gap**2 / 8)[:, None])

    def between(self, size_of: Callable[[State], Array], size: Array, second: Array, limit: Array) -> Array:
        """Return what a quantity may be greater by between the states than at all of them, shape (w,).

        Args:
            size_of: Returns its absolute values, shape (T, w).
            size: Those at the states.
            second: Bounds on its second derivative on the pieces, shape (m, w).
            limit: Of the quantity, shape (w,).
        """
        value = size.max(axis=0)
        bound = self.proven(
            self.at_most(size, second),
            lambda closer: closer.at_most(size_of(closer.state), second),
            np.where(value <= limit * (1 + RELATIVE_TOLERANCE), limit * (1 + ALLOWANCE), np.inf),
        )
        return np.maximum(bound - value, 0.0)

    def proven(self, bound: Array, bound_of: Callable[[Examined], Array], most: Array) -> Array:
        """Return bounds over the motion, shape (w,), from closer states where they are not below `most`.

        Args:
            bound: Bounds on the pieces, shape (m, w); replaced where better ones are found.
            bound_of: Returns those by other states; those of pieces without a state are not used.
            most: Up to which a bound need not be better, shape (w,).
        """
        for count in _CLOSER:
            pieces = np.flatnonzero((bound > most).any(axis=1))
            if not pieces.size:
                break
            bound[pieces] = np.minimum(bound[pieces], bound_of(self.closer(pieces, count))[pieces])
        return np.asarray(bound.max(axis=0))


def examined_states(pepper: PepperModel, trajectory: Trajectory, loads: Loads) -> Examined:
    """Return states at every millisecond, and on both sides of every knot."""
    step = examination_step(trajectory.duration)
    parts = cut(trajectory, CUT * step)
    regular, width = sample_times(trajectory.duration, step), np.diff(parts.breaks)
    inside = np.clip(np.searchsorted(parts.breaks, regular, side="right") - 1, 0, width.size - 1)
    every = np.arange(width.size)
    part = np.concatenate([inside, every, every])
    local = np.concatenate([regular - parts.breaks[inside], 0 * width, width])
    time = np.concatenate([regular, parts.breaks[:-1], parts.breaks[1:]])
    state = derivatives(trajectory, parts.segment[part], parts.offset[part] + local, 3)
    bounds = RateBounds(pepper, parts.rates, loads)
    return Examined(
        step, time, State(*state), part, np.minimum(width, step), bounds, parts.rates[1], parts.breaks,
        trajectory, parts,
    )  # fmt: skip


def derivatives(trajectory: Trajectory, segment: NDArray[np.intp], local: Array, count: int) -> list[Array]:
    """Return value and first derivatives of the polynomials, shape (T, n) each."""
    state = np.empty((count, segment.size, trajectory.n))
    evaluate(trajectory.coefficients, segment, local, state)
    return list(state)
