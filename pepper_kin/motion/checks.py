"""Collision checks of a robot in a scene at any margin, compiled or by coal: the verdicts are the same."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.batch import kernel
from pepper_kin.collision import CollisionChecker, Scene, checker_for
from pepper_kin.kernels.compilation import Compilation
from pepper_kin.model import PepperModel
from pepper_kin.motion.validity import TORQUE_SHARE, holds, validity

Array = NDArray[np.float64]

LEAST_MARGIN = 1e-4
"""A margin smaller than this counts as none [m]."""


class Checks:
    """Answers for one robot in one scene.

    Args:
        pepper: The robot.
        scene: The world; None for the robot alone.
        compiled: Whether machine code is used; a robot with shapes without bounds is left to coal.

    Attributes:
        exact: Coal's checker without margins.
        quick: Whether coal is asked about nothing but ties, so that many questions cost little.
    """

    def __init__(self, pepper: PepperModel, scene: Scene | None, compiled: bool) -> None:
        self.pepper, self.scene, self.compiled, self.quick = pepper, scene, compiled, False
        self.exact: CollisionChecker = checker_for(pepper, scene)
        if compiled:
            _load_code()
            from pepper_kin.collision.fast import fast_checker_for

            fast = fast_checker_for(pepper, scene)
            self.compiled, self.quick = fast.supported, fast.alone

    def free(self, q: ArrayLike, margin: float = 0.0, self_margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether nothing is nearer than the margins, shape (...), at q, shape (..., n)."""
        if self.compiled:
            from pepper_kin.collision.fast import fast_checker_for

            return ~fast_checker_for(self.pepper, self.scene, margin, self_margin).in_collision(q)
        return ~checker_for(self.pepper, self.scene, margin, self_margin).in_collision(q)

    def surely_free(self, q: Array, margin: float, self_margin: float) -> NDArray[np.bool_]:
        """Return what `free` does, but never wait for coal: what machine code cannot tell counts as near.

        See `FastChecker.surely_free`.
        """
        if not self.compiled:
            return self.free(q, margin, self_margin)
        from pepper_kin.collision.fast import fast_checker_for

        return fast_checker_for(self.pepper, self.scene, margin, self_margin).surely_free(q)

    def holds(self, q: Array) -> NDArray[np.bool_]:
        """Whether the joints can hold q, shape (m, n), still, with a little to spare; shape (m,)."""
        if not self.compiled:
            return holds(self.pepper, q)
        torque = kernel(self.pepper, "gravity_torque")(q)
        return np.asarray((np.abs(torque) <= TORQUE_SHARE * self.pepper.effort_limits).all(axis=-1))

    def oracle(
        self, frozen: Array, free: NDArray[np.int64], margins: tuple[float, float], *, for_edges: bool
    ) -> planners.StateValidity:
        """Return the planner's oracle for the free joints, the others standing as in `frozen`, shape (n,).

        Args:
            frozen: A whole configuration, shape (n,).
            free: Places of the joints that move, shape (k,).
            margins: To the scene and to the robot itself [m].
            for_edges: Whether it is asked for edges, of which machine code looks at few states at a time; or
                for many states at once.
        """
        if not self.compiled:
            return validity(checker_for(self.pepper, self.scene, *margins), frozen, free)
        from pepper_kin.collision.fast import fast_checker_for

        checker = fast_checker_for(self.pepper, self.scene, *margins)
        if not for_edges:
            return validity(checker, frozen, free)
        made = checker.compiled(frozen, free, TORQUE_SHARE * self.pepper.effort_limits)
        kept = threading.local()

        def memory() -> Array:
            """Return this thread's block: no search of a path calls another of the same problem."""
            if not hasattr(kept, "block"):
                kept.block = made.new_memory()
            return np.asarray(kept.block)

        return planners.CompiledValidity(made.address, int(free.size), memory, keep_alive=made)

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
    """Load, or compile, what planning will need, before any clock starts."""
    import pepper_kin.collision.fast.loop
    import pepper_kin.ik.fast

    compilation = Compilation("the planners")
    import pepper_kin.planners.compiled_shortcut  # noqa: F401
    from pepper_kin.motion.native_curve import stations
    from pepper_kin.planners.native_connect import grow
    from pepper_kin.planners.native_rejoin import shortest_end

    codes = (stations, grow, shortest_end)
    compilation.end(compiled=any(code.stats.cache_misses for code in codes))
