"""Validity of the configurations of a motion: collision checks at any margin, and holding torques."""

from __future__ import annotations

import functools
from collections.abc import Callable
from threading import get_ident

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.curve_checks import NO_BLOCKS, CurveChecks, HoldingLimits
from pepper_kin.collision.fast import CompiledValidity, fast_checker_for
from pepper_kin.collision.kept_size import MOST_BYTES, checker_size
from pepper_kin.collision.mesh_changes import as_on_disk
from pepper_kin.core.collision.check import check_many, valid_steps
from pepper_kin.core.collision.curve_check import SHORTEST, MotionCheck, kept_margins, sound_ends
from pepper_kin.core.collision.gjk import TIE
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.motion.static_limits import StaticLimits
from pepper_kin.planners.compiled import load_code

LEAST_MARGIN = 1e-4
"""Margin below which it counts as zero [m]."""


class Checks(CurveChecks):
    """Checks for paths of one robot in one scene: freedom of collision, and holding torques.

    Args:
        pepper: The robot.
        scene: The world; None for the robot alone.
        statics: Static limits to keep; None: the joints must hold the robot's own weight.

    Attributes:
        statics: Static limits to keep.
    """

    def __init__(self, pepper: PepperModel, scene: Scene | None, statics: StaticLimits | None = None) -> None:
        self.statics = held = StaticLimits(pepper) if statics is None else statics
        super().__init__(
            pepper, scene, HoldingLimits(held.effort_limits, held.loads, held.loads_along, held.step)
        )
        _load_code()
        self._whole: CompiledValidity | None = None
        self._of_configurations: dict[int, MotionCheck] = {}

    @functools.cached_property
    def asking_coal(self) -> Checks:
        """Checks in which coal decides wherever machine code cannot, also for edges of searches.

        Machine code replaces a mesh that is not convex by its convex hull, and cannot decide inside the hull.
        """
        other = Checks(self.pepper, self.scene, self.statics)
        other.compiled = other.quick = False
        return other

    def free(self, q: ArrayLike, margin: float = 0.0, self_margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether configurations q, shape (..., n), keep the margins [m], shape (...)."""
        if margin == 0.0 and self_margin == 0.0:
            return ~self._fast.in_collision(q)
        return ~fast_checker_for(self.pepper, self.scene, margin, self_margin).in_collision(q)

    @property
    def edges(self) -> int:
        """Address of the compiled check of edges, which takes a block of `of_motion`; 0 if not compiled."""
        return int(valid_steps.address) if self.compiled else 0

    def along(
        self, standing: Array, moving: NDArray[np.int64], margins: tuple[float, float]
    ) -> Callable[[Array], NDArray[np.bool_]]:
        """Return a function that tells which states of one motion, shape (m, n), keep the margins.

        Bodies that do not move are checked only once.

        Args:
            standing: A configuration with the positions of joints that do not move [rad or m], shape (n,).
            moving: Indices of the joints that move, shape (k,).
            margins: Distances to the scene and of the robot to itself [m].
        """
        if not self.compiled:
            checker = fast_checker_for(self.pepper, self.scene, *margins)
            return lambda states: ~checker.in_collision(states)
        code = self._moving(standing, moving).at(*margins)

        def test(states: Array) -> NDArray[np.bool_]:
            """Return which whole configurations [rad or m], shape (m, n), are free, shape (m,)."""
            verdicts = code.verdicts(states)
            if (verdicts == TIE).any():
                self.answer(states, verdicts, margins)
            return np.asarray(verdicts == 0)

        return test

    def of_configurations(self) -> MotionCheck:
        """Return the compiled check of configurations in which any joint may differ.

        The configurations are checked like states of a path, see `StaticLimits.hold`.  The result is valid in
        this thread until this method or a check of a motion is called again.
        """
        blocks = NO_BLOCKS
        if self.compiled:
            if self._whole is None:
                everything = np.arange(self.pepper.n)
                effort, loads = self.statics.effort_limits, self.statics.loads
                self._whole = self._fast.of_motion(self.pepper.neutral(), everything, effort, loads)
            blocks = self._whole.blocks()
        thread = get_ident()
        found = self._of_configurations.get(thread)
        if found is None or found.moving is not blocks[1]:
            neutral = self.pepper.neutral() if self._whole is None else self._whole.frozen
            found = self._motion_check(*blocks, neutral, self.statics.loads)
            self._of_configurations = {thread: found}
        return found

    def holds(self, q: Array) -> NDArray[np.bool_]:
        """Whether configurations q, shape (m, n), can be held still, with a small reserve; shape (m,)."""
        return self.statics.hold(q)

    def too_near(self, q: Array, what: str, least: float) -> str:
        """Return a sentence that names what an end of a path is too near to; empty if the distance is kept.

        Args:
            q: The configuration [rad or m], shape (n,).
            what: Name of the configuration, such as "start".
            least: Distance that the whole curve must keep from the scene, examined at steps of `SHORTEST`
                [m].
        """
        if least == 0.0 or self.free(q, least + SHORTEST):
            return ""
        names = self.exact.with_margins(least + SHORTEST, 0.0).contacts(q)
        near = "".join(f": {' and '.join(pair)} are nearer" for pair in names[:1])
        return f"The {what} does not keep least_margin, {1000 * least:.1f} mm{near}."

    def validity(
        self, frozen: Array, free: NDArray[np.int64], margins: tuple[float, float]
    ) -> planners.StateValidityChecker:
        """Return the validity check for states of the free joints, with the other joints fixed.

        A state is valid if nothing touches, the margins are kept, and the posture can be held.

        Args:
            frozen: A whole configuration with the fixed joints' positions [rad or m], shape (n,).
            free: Indices of the joints that move, shape (k,).
            margins: Distances to the scene and of the robot to itself [m].
        """
        if not self.compiled:
            checker = fast_checker_for(self.pepper, self.scene, *margins)

            def valid(states: Array) -> NDArray[np.bool_]:
                """Return which states of the free joints [rad or m], shape (m, k), are valid, shape (m,)."""
                q = np.tile(frozen, (len(states), 1))
                q[:, free] = states
                ok = ~checker.in_collision(q)
                if ok.any():
                    ok[ok] = self.holds(q[ok])
                return ok

            return valid
        made = self._moving(frozen, free).at(*margins)
        # A search never calls another search of the same problem, so that a thread needs one block.
        return planners.CompiledMotionValidator(made.address, int(free.size), made.memory, keep_alive=made)

    def margins(
        self, start: Array, goals: Array, free: NDArray[np.int64], margin: float
    ) -> tuple[float, float]:
        """Return the margins to the scene and of the robot to itself [m] that start and goals allow.

        Args:
            start: Start configuration [rad or m], shape (n,).
            goals: Goals [rad or m], shape (m, n); it suffices that one keeps the margins.
            free: Indices of the joints that may differ, shape (k,).
            margin: The margin requested [m].
        """
        ends, kept = np.concatenate([start[None], goals]), np.empty(2)
        self.run(kept_margins, self.of_motion(start, free), ends, margin, LEAST_MARGIN, kept)
        return float(kept[0]), float(kept[1])

    def sound_ends(
        self, start: Array, goals: Array, free: NDArray[np.int64], margin: float
    ) -> tuple[float, float] | None:
        """Return the margins that start and goals allow if all of them are valid, else None.

        The check is one call of machine code; the result is None as well if that cannot decide.

        Args:
            start: Start configuration [rad or m], shape (n,).
            goals: Goals [rad or m], shape (m, n).
            free: Indices of the joints that may differ, shape (k,).
            margin: The margin requested [m].
        """
        if not self.compiled or self.statics.balance is not None or not free.size:
            return None
        ends, kept = np.concatenate([start[None], goals]), np.empty(2)
        if not self.run(sound_ends, self.of_motion(start, free), ends, margin, LEAST_MARGIN, kept):
            return None
        return float(kept[0]), float(kept[1])


def checks_for(pepper: PepperModel, scene: Scene | None, statics: StaticLimits) -> Checks:
    """Return the checks of a robot in a scene, cached with their arrays for the next call."""
    return _checks_for(pepper, as_on_disk(scene), statics)


@kept_for_robot(most=16, most_bytes=MOST_BYTES, size_of=checker_size)
def _checks_for(pepper: PepperModel, scene: Scene | None, statics: StaticLimits) -> Checks:
    return Checks(pepper, scene, statics)


@functools.cache
def _load_code() -> None:
    """Load or compile the code that planning needs, before any time budget starts."""
    load_code(check_many, sound_ends)
