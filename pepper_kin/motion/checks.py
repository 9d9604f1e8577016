"""Which configurations a motion may pass through: collision checks at any margin, and torques that hold."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import CollisionChecker, Scene, checker_for
from pepper_kin.collision.fast import CompiledValidity, fast_checker_for
from pepper_kin.collision.fast.checker import TIE
from pepper_kin.model import PepperModel
from pepper_kin.motion.static_limits import StaticLimits

Array = NDArray[np.float64]

LEAST_MARGIN = 1e-4
"""A margin smaller than this counts as none [m]."""

FINEST = 0.0005
"""Least distance that any point of the body moves between states of a curve that are looked at [m]."""


class Checks:
    """Answers for one robot in one scene.

    They come from machine code, and from coal where a shape of the robot has no bounds.

    Args:
        pepper: The robot.
        scene: The world; None for the robot alone.
        statics: What can be held; None: the robot's own weight by its joints.

    Attributes:
        statics: What can be held.
        exact: Coal's checker without margins.
        compiled: Whether machine code answers.
        quick: Whether coal is asked about nothing but ties, so that many questions cost little.
    """

    def __init__(self, pepper: PepperModel, scene: Scene | None, statics: StaticLimits | None = None) -> None:
        self.pepper, self.scene = pepper, scene
        self.statics = StaticLimits(pepper) if statics is None else statics
        _load_code()
        self.exact: CollisionChecker = checker_for(pepper, scene)
        fast = fast_checker_for(pepper, scene)
        self.compiled, self.quick = fast.supported, fast.alone
        self._made: dict[tuple[bytes, bytes], CompiledValidity] = {}

    def free(self, q: ArrayLike, margin: float = 0.0, self_margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether nothing is nearer than the margins, shape (...), at q, shape (..., n)."""
        return ~fast_checker_for(self.pepper, self.scene, margin, self_margin).in_collision(q)

    def surely_free(self, q: Array, margin: float, self_margin: float) -> NDArray[np.bool_]:
        """Return what `free` does, but never wait for coal: what machine code cannot tell counts as near.

        See `FastChecker.surely_free`.
        """
        return fast_checker_for(self.pepper, self.scene, margin, self_margin).surely_free(q)

    def along(
        self,
        standing: Array,
        moving: NDArray[np.int64],
        margins: tuple[float, float],
        *,
        surely: bool = False,
    ) -> Callable[[Array], NDArray[np.bool_]]:
        """Return what tells of states of one motion, shape (m, n), what `free`, or `surely_free`, does.

        What stands is looked at once, here.

        Args:
            standing: A configuration in which the joints stand that do not move, shape (n,).
            moving: Places of the joints that move, shape (k,).
            margins: To the scene and to the robot itself [m].
            surely: Whether what machine code cannot tell counts as near, so that coal is never asked.
        """
        if not self.compiled or (surely and not self.quick):
            checker = fast_checker_for(self.pepper, self.scene, *margins)
            return checker.surely_free if surely else lambda states: ~checker.in_collision(states)
        code = self._moving(standing, moving).at(*margins)

        def test(states: Array) -> NDArray[np.bool_]:
            verdicts = code.verdicts(states)
            if not surely and (verdicts == TIE).any():
                ties = np.flatnonzero(verdicts == TIE)
                exact = checker_for(self.pepper, self.scene, *margins)
                verdicts[ties] = exact.in_collision(states[ties])
            return np.asarray(verdicts == 0)

        return test

    def holds(self, q: Array) -> NDArray[np.bool_]:
        """Whether q, shape (m, n), can be held still, with a little to spare; shape (m,)."""
        return self.statics.hold(q)

    def too_near(self, q: Array, what: str, least: float) -> str:
        """Return a sentence on what an end of a path, shape (n,), is too near to; empty where to nothing.

        Args:
            q: The configuration.
            what: Its name, such as "start".
            least: What a curve must keep from the scene all along, which is looked at `FINEST` apart [m].
        """
        if least == 0.0 or self.free(q, least + FINEST):
            return ""
        names = self.exact.with_margins(least + FINEST, 0.0).contacts(q)
        near = "".join(f": {' and '.join(pair)} are nearer" for pair in names[:1])
        return f"The {what} does not keep least_margin, {1000 * least:.1f} mm{near}."

    def validity(
        self, frozen: Array, free: NDArray[np.int64], margins: tuple[float, float]
    ) -> planners.StateValidityChecker:
        """Return which states of the free joints are valid, the others standing as in `frozen`, shape (n,).

        A state is valid where nothing touches, the margins are kept, and the posture can be held.

        Args:
            frozen: A whole configuration, shape (n,).
            free: Places of the joints that move, shape (k,).
            margins: To the scene and to the robot itself [m].
        """
        if not self.compiled:
            checker = fast_checker_for(self.pepper, self.scene, *margins)

            def valid(states: Array) -> NDArray[np.bool_]:
                q = np.tile(frozen, (len(states), 1))
                q[:, free] = states
                ok = self.holds(q)
                ok[ok] = ~checker.in_collision(q[ok])
                return ok

            return valid
        made = self._moving(frozen, free).at(*margins)
        # No search of a path calls another of the same problem, so that a thread needs one block.
        return planners.CompiledMotionValidator(made.address, int(free.size), made.memory, keep_alive=made)

    def _moving(self, frozen: Array, free: NDArray[np.int64]) -> CompiledValidity:
        """Return the validity without margins of what some joints move, made once for one motion."""
        key = frozen.tobytes(), free.tobytes()
        found = self._made.get(key)
        if found is None:
            effort, loads = self.statics.effort_limits, self.statics.loads()
            found = fast_checker_for(self.pepper, self.scene).compiled(frozen, free, effort, loads)
            self._made = {key: found}
        return found

    def margins(self, start: Array, goals: Array, margin: float) -> tuple[float, float]:
        """Return the margins kept to the scene and to the robot itself [m], as far as the ends allow.

        Each is halved until the start and a goal keep it; to itself the robot gives up half of what it could
        keep, since joints near one another must have room to move.

        Args:
            start: Start configuration, shape (n,).
            goals: Goals, shape (m, n); one that keeps the margins will do.
            margin: The margin wished [m].
        """
        ends = np.vstack([start, goals])
        kept_self = self._halved(ends, margin, lambda m: (0.0, m))
        kept_self = kept_self if kept_self == margin else kept_self / 2
        return self._halved(ends, margin, lambda m: (m, kept_self)), kept_self

    def _halved(self, ends: Array, margin: float, margins: Callable[[float], tuple[float, float]]) -> float:
        kept = margin
        while kept > LEAST_MARGIN:
            free = self.free(ends, *margins(kept))
            if free[0] and free[1:].any():
                return kept
            kept /= 2
        return 0.0


@functools.cache
def _load_code() -> None:
    """Load, or compile, what planning needs, before any clock starts."""
    from pepper_kin.core.collision.check import check_many
    from pepper_kin.core.inverse_kinematics.multi_start import solve_rows
    from pepper_kin.motion.examination import count_intervals
    from pepper_kin.planners.deadline import load_code
    from pepper_kin.planners.rejoin import shortest_end
    from pepper_kin.planners.rrt_connect import grow
    from pepper_kin.planners.shortcut import shorten
    from pepper_kin.planners.smooth import schoenberg_spline

    load_code(check_many, solve_rows, count_intervals, shortest_end, grow, shorten, schoenberg_spline)
