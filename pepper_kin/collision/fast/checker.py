"""Python interface of the compiled collision check."""

from __future__ import annotations

import math
import threading
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import RANGE_RADIUS, checker_for
from pepper_kin.collision.fast.certificate import certified
from pepper_kin.collision.fast.compiled import (
    CompiledValidity,
    StaticLoads,
    compile_validity,
    trusted_validity,
)
from pepper_kin.collision.fast.prepared import prepare
from pepper_kin.collision.fast.resting import resting_contact, resting_distance, resting_margin
from pepper_kin.collision.kept_size import MOST_BYTES, checker_size
from pepper_kin.collision.mesh_changes import as_on_disk
from pepper_kin.collision.scene import Scene
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import check_many, check_rows, set_margins
from pepper_kin.core.collision.layout import WIDEST
from pepper_kin.core.collision.lower_bounds import part_bounds
from pepper_kin.core.collision.narrow_phase import near_robot
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.threads import LARGEST_PIECE, run_in_pieces
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_joint_vectors, check_positive

TIE = 2


class FastChecker:
    """Collision of a robot with itself and a scene in machine code, with the verdicts of coal.

    The check has three stages: tabulated joint ranges; spheres that cover the robot (no sphere near: free)
    and spheres inside it (one touches: contact), several configurations at a time; and the exact shapes for
    pairs that spheres leave in doubt.  Coal decides distances within 3e-6 m of the threshold, and nonconvex
    meshes.

    Args:
        pepper: The robot.
        scene: The world around it; None for none.
        margin: Distance to the scene below which `in_collision` is true [m].
        self_margin: Distance between two parts of the robot below which `in_collision` is true [m].

    Raises:
        InvalidValueError: for a margin that is not a finite number of 0 or more.
    """

    def __init__(
        self,
        pepper: PepperModel,
        scene: Scene | None = None,
        margin: float = 0.0,
        self_margin: float = 0.0,
    ) -> None:
        for name, value in (("margin", margin), ("self_margin", self_margin)):
            if not (math.isfinite(value) and value >= 0):
                raise InvalidValueError(name, value, "a finite distance of 0 or more [m]")
        self.pepper = pepper
        self.exact = checker_for(pepper, scene, float(margin), float(self_margin))
        self._prepared = prepare(self.exact)
        self._supported = self._prepared.structure.moving.supported and pepper.solvers == "fast"
        self._decided = self._supported and self._prepared.structure.decided
        self._resting = self._supported and resting_contact(self._prepared, float(margin))
        self._one = (pepper.n,) if self._supported and not self._resting else None
        self._local = threading.local()
        self._lock = threading.Lock()
        self._still: float | None = None

    @property
    def supported(self) -> bool:
        """Whether the compiled check covers the robot's shapes and is enabled; otherwise coal decides all."""
        return self._supported

    @property
    def alone(self) -> bool:
        """Whether only ties are left to coal: all shapes are convex solids."""
        return self._decided

    @cached_property
    def resting_margin(self) -> float:
        """Lower bound of the distance of bodies that never move to the world [m]; inf if there are none."""
        return resting_margin(self._prepared.structure)

    def rests_near(self, margin: float) -> bool:
        """Return whether a body that never moves is nearer to the world than a margin [m]."""
        return resting_contact(self._prepared, margin)

    def in_collision(self, q: ArrayLike, *, threads: int = 1) -> NDArray[np.bool_]:
        """Return whether anything collides, shape (...,), at joint positions q, shape (..., n) [rad or m].

        Args:
            q: Joint positions [rad or m], shape (..., n).
            threads: Number of threads that share the configurations; the result does not depend on it.

        Raises:
            InvalidValueError: for a q of wrong length, or with NaN or infinity.
        """
        if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
            raise InvalidValueError("threads", repr(threads), "an integer of at least 1")
        if type(q) is np.ndarray and q.shape == self._one and q.dtype == np.float64:
            verdict = self._verdict(q)
            if verdict != TIE:
                return np.array(verdict != 0)
        q_all = as_joint_vectors(self.pepper, q, "q")
        if not self._supported:
            return self.exact.in_collision(q_all)
        flat = _rows(q_all.reshape(-1, self.pepper.n))
        verdicts, _ = self._verdicts(flat, threads)
        touching = verdicts != 0
        if touching.any():
            ties = np.flatnonzero(verdicts == TIE)
            if ties.size:
                touching[ties] = self.exact.in_collision(flat[ties])
        return touching.reshape(q_all.shape[:-1])

    def nearer(self, q: Array, margins: Array) -> NDArray[np.bool_]:
        """Return whether each state is nearer to the scene, or to itself, than its margins, shape (m,).

        The margin to the scene is the checker's own.

        Args:
            q: Joint positions [rad or m], shape (m, n).
            margins: Margins between parts of the robot, best sorted in runs of equal values [m], shape (m,).
        """
        flat, found = _rows(as_joint_vectors(self.pepper, q, "q")), np.full(len(q), TIE, np.uint8)
        if self._resting:
            return found != 0
        if self._supported:
            starts = np.flatnonzero(np.diff(margins, prepend=np.nan))
            memory = self._prepared.memory()
            for start, stop in pairwise([*starts.tolist(), len(q)]):
                set_margins(memory, self.exact.margin, float(margins[start]), RANGE_RADIUS)
                check_many(memory, flat, found, start, stop)
            self._prepared.named(memory, self._prepared.margins)
        ties = found == TIE
        for margin in np.unique(margins[ties]).tolist():
            rows = ties & (margins == margin)
            found[rows] = self.exact.with_margins(self.exact.margin, margin).in_collision(flat[rows])
        return found != 0

    def doubts(self, q: ArrayLike) -> tuple[int, int]:
        """Return how many of the configurations q, shape (..., n), spheres leave in doubt, and all stages."""
        flat = _rows(as_joint_vectors(self.pepper, q, "q").reshape(-1, self.pepper.n))
        if not self.supported:
            return len(flat), len(flat)
        verdicts, doubts = self._verdicts(flat, 1)
        return doubts, int(np.count_nonzero(verdicts == TIE))

    def lower_bound(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return a distance that the robot certainly keeps, from itself and the scene.

        It is never above `CollisionChecker.clearance`, and some millimeters to centimeters below; pairs that
        are decided by joint ranges do not count.

        Args:
            q: Joint positions, shape (..., n) [rad or m].

        Returns:
            Lower bounds [m], shape (...,); a value that is not positive proves nothing.  inf if nothing can
            collide.

        Raises:
            InvalidValueError: for a q of wrong length, or with NaN or infinity.
        """
        q_all = as_joint_vectors(self.pepper, q, "q")
        bounds = self._part_bounds(_rows(q_all.reshape(-1, self.pepper.n)))
        least = bounds.min(axis=1, initial=self._resting_distance())
        return np.asarray(least.reshape(q_all.shape[:-1]))

    def near(self, q: ArrayLike, points: Array, margin: float) -> NDArray[np.bool_]:
        """Return whether points are nearer to the robot, with attached objects, than a distance, shape (k,).

        Args:
            q: Joint positions, shape (n,) [rad or m].
            points: Points in the world, shape (k, 3), contiguous [m].
            margin: The distance [m].  Within 3e-6 m of it the result is True.

        Raises:
            InvalidValueError: for a q of wrong shape, or with NaN, or a robot whose shapes the compiled check
                does not support.
        """
        state = as_joint_vectors(self.pepper, q, "q")
        if state.ndim != 1:
            raise InvalidValueError(
                "q", f"shape {state.shape}", f"one configuration, shape ({self.pepper.n},)"
            )
        self._refuse_unknown()
        found = np.empty(len(points), np.uint8)
        near_robot(self._prepared.memory(), _rows(state), _rows(points), margin, found)
        return found.view(np.bool_)

    def edge_free(self, a: ArrayLike, b: ArrayLike, resolution: float = 0.01) -> bool:
        """Return whether the states on the straight line from a to b are free, both ends included.

        Args:
            a: Joint positions at the start, shape (n,) [rad or m].
            b: Joint positions at the end, shape (n,) [rad or m].
            resolution: Maximum change of any joint from one state to the next [rad or m].

        Raises:
            InvalidValueError: for vectors of wrong length or with NaN or infinity, or a resolution that is
                not above 0.
        """
        check_positive("resolution", resolution)
        start, stop = self._ends(a, b)
        steps = max(1, math.ceil(float(np.abs(stop - start).max()) / resolution))
        ways = np.arange(steps + 1)[:, None] / steps
        states = start + (stop - start) * ways
        states[-1] = stop
        return not bool(self.in_collision(states).any())

    def edge_certified(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return whether the whole straight line from a to b is proven free, not only samples of it.

        See `certificate.certified`.  False means that no proof was found: an edge that passes something
        within some millimeters may still be free.

        Args:
            a: Joint positions at the start, shape (n,) [rad or m].
            b: Joint positions at the end, shape (n,) [rad or m].

        Raises:
            InvalidValueError: for vectors of wrong length or with NaN or infinity.
        """
        start, stop = self._ends(a, b)
        if not self.supported or self._resting:
            return False
        motion_bounds, classes = self._prepared.motion_bounds, len(self._prepared.structure.classes)
        margins = np.full(len(motion_bounds), self.exact.margin)
        margins[:classes] = self.exact.self_margin
        angle = self.exact.self_margin / RANGE_RADIUS
        return certified(self._part_bounds, self.exact._ranges, angle, motion_bounds, margins, start, stop)

    def compiled(
        self,
        frozen: ArrayLike,
        free: ArrayLike,
        effort_limits: ArrayLike | None = None,
        loads: StaticLoads | None = None,
    ) -> CompiledValidity:
        """Return a function in machine code that checks the validity of edges; see `CompiledValidity`.

        Args:
            frozen: Complete configuration, shape (n,) [rad or m]; joints that are not free stay there.
            free: Indices of the k joints that move, shape (k,).
            effort_limits: If given, states are valid only if holding still needs no more than these efforts,
                shape (n,) [N m or N].
            loads: With effort limits, the payload, and edges that the robot must not tip over; None for the
                robot's own weight.

        Raises:
            InvalidValueError: for vectors of wrong length or with NaN, indices that do not exist or repeat,
                or a robot whose shapes the compiled check does not support.
        """
        self._refuse_unknown()
        return compile_validity(self.pepper, self._prepared, frozen, free, effort_limits, loads, self.exact)

    def of_motion(
        self, frozen: Array, free: NDArray[np.int64], effort_limits: Array, loads: StaticLoads
    ) -> CompiledValidity:
        """Return the result of `compiled` without checking or copying the arguments, which must not change.

        Args:
            frozen: Complete configuration [rad or m], shape (n,).
            free: Indices of the joints that move, shape (k,).
            effort_limits: Maximum effort of each joint while holding still [N m or N], shape (n,).
            loads: Payload, and edges that the robot must not tip over.
        """
        return trusted_validity(self.pepper, self._prepared, frozen, free, effort_limits, loads, self.exact)

    def _refuse_unknown(self) -> None:
        """Raise an error if the compiled check does not support the robot's shapes."""
        if not self.supported:
            raise InvalidValueError("robot", self.pepper, "collision shapes that are not unbounded")

    def _ends(self, a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
        """Return two configurations [rad or m], a and b, as checked arrays of shape (n,)."""
        n = self.pepper.n
        return as_joint_vectors(self.pepper, a, "a").reshape(n), as_joint_vectors(
            self.pepper, b, "b"
        ).reshape(n)

    def _verdict(self, q: Array) -> int:
        """Return the verdict on one configuration, shape (n,); TIE also if numbers are not finite."""
        memory = self._prepared.memory()
        try:
            row, status = self._local.one
        except AttributeError:
            row, status = at.section(memory, at.ROWS)[: q.size], at.section_bits(memory, at.STATUS)
            self._local.one = row, status
        row[:] = q
        check_rows(memory, row, 1)
        return int(status[0])

    def _verdicts(self, flat: Array, threads: int) -> tuple[NDArray[np.uint8], int]:
        """Return verdicts, shape (m,), on states, shape (m, n), and how many spheres leave in doubt."""
        verdicts = np.empty(len(flat), np.uint8)
        if self._resting:
            verdicts[:] = 1
            return verdicts, 0
        if threads == 1 and len(flat) <= LARGEST_PIECE:
            return verdicts, check_many(self._prepared.memory(), flat, verdicts, 0, len(flat))
        doubts: list[int] = []

        def run(start: int, stop: int) -> None:
            doubts.append(check_many(self._prepared.memory(), flat, verdicts, start, stop))

        run_in_pieces(len(flat), threads, 1, run)
        return verdicts, sum(doubts)

    def _resting_distance(self) -> float:
        """Return the minimum distance of pairs that never move [m], computed once."""
        if self._still is None:
            self._still = resting_distance(self._prepared.structure)
        return self._still

    def _part_bounds(self, flat: Array) -> Array:
        """Return lower bounds of distances [m] for configurations [rad or m], shape (m, n).

        They have shape (m, parts): one for each class of pairs, and for each group to the scene.
        """
        bounds = np.full((len(flat), len(self._prepared.motion_bounds)), np.inf)
        if not self.supported:
            bounds[:] = -np.inf
            return bounds
        part_bounds(self._prepared.memory(), flat, bounds)
        bounds[np.abs(flat).max(axis=1, initial=0.0) > WIDEST] = -np.inf
        return bounds


def fast_checker_for(
    pepper: PepperModel, scene: Scene | None = None, margin: float = 0.0, self_margin: float = 0.0
) -> FastChecker:
    """Return the fast checker of a robot in a scene, cached for the next call."""
    return _fast_checker_for(pepper, as_on_disk(scene), margin, self_margin)


@kept_for_robot(most=64, most_bytes=MOST_BYTES, size_of=lambda checker: checker_size(checker.exact))
def _fast_checker_for(
    pepper: PepperModel, scene: Scene | None, margin: float, self_margin: float
) -> FastChecker:
    """Return one cached checker for all spellings of the arguments."""
    return FastChecker(pepper, scene, margin, self_margin)


def _rows(q: Array) -> Array:
    """Return joint positions, of any shape, as compiled code needs them: contiguous and writable."""
    return np.require(q, np.float64, ["C", "W"])
