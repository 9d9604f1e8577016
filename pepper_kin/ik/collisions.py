"""Collisions as the inverse kinematics sees them: a verdict, and half-spaces that keep steps clear."""

from __future__ import annotations

import ctypes
import threading
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from pepper_kin.core.inverse_kinematics.local_solver import CollisionTests
from pepper_kin.ik.tasks.task import Array
from pepper_kin.kernels.interrupts import STOPPED
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.collision.fast import CompiledValidity, FastChecker

MARGIN = 0.005
"""Steps keep this distance where they can [m]."""
NOTICE = 0.10
"""They take notice of bodies nearer than this [m]."""

NO_TESTS = CollisionTests(0, 0, 0, 0)
"""For searches that leave collisions out."""

_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)


class Collisions:
    """Answers for one robot in one scene, or in none (then nothing ever collides).

    Args:
        pepper: The robot.
        scene: The world; an empty one checks the robot against itself, None checks nothing.
    """

    def __init__(self, pepper: PepperModel, scene: Scene | None) -> None:
        self.pepper = pepper
        self.scene = scene
        self._raised: BaseException | None = None
        self._kept: tuple[Any, ...] = ()

    @property
    def considered(self) -> bool:
        """Whether anything is checked."""
        return self.scene is not None

    def free(self, q: Array) -> bool:
        """Whether nothing touches at q, shape (n,) [rad or m]."""
        if self.scene is None:
            return True
        from pepper_kin.collision import in_collision

        return not bool(in_collision(self.pepper, q, self.scene))

    def free_many(self, q: Array) -> np.ndarray:
        """Whether nothing touches at each of many configurations, shape (m, n) -> (m,)."""
        if self.scene is None:
            return np.ones(len(q), dtype=bool)
        from pepper_kin.collision import in_collision

        return ~np.asarray(in_collision(self.pepper, q, self.scene), dtype=bool)

    def clearance(self, q: Array) -> float | None:
        """Return the smallest distance [m]; None where nothing is checked."""
        if self.scene is None:
            return None
        from pepper_kin.collision import clearance

        return float(clearance(self.pepper, q, self.scene))

    def half_spaces(self, q: Array, count: int) -> Array:
        """Return half-spaces of joint positions near q that keep a step clear, g . q' >= b.

        Each is one of the nearest pairs of bodies, linearized.  With d its distance at q and g = dd/dq,

            d + g . (q' - q) >= MARGIN.

        Args:
            q: Joint positions, shape (n,) [rad or m].
            count: Largest number of pairs.

        Returns:
            g and b of each, shape (m, n + 1), m <= count.
        """
        from pepper_kin.collision.near_pairs import near_pairs

        pairs = near_pairs(self.pepper, q, NOTICE, self.scene)
        slopes, distances = pairs.gradients[:count], pairs.distances[:count]
        return np.column_stack([slopes, MARGIN - distances + slopes @ q])

    def tests(self, signals: np.ndarray) -> CollisionTests:
        """Return the same as functions at addresses, valid until the next call.

        Args:
            signals: A table, see `pepper_kin.kernels.interrupts`, that is told to stop where a verdict fails;
                `check` then raises why.
        """
        if self.scene is None:
            return NO_TESTS
        n = self.pepper.n

        def guarded(answer: Any) -> Any:
            def call(q: int, result: int, count: int, _: int) -> int:
                try:
                    if self._raised is None:
                        state = floats_at(q, n).copy()
                        return int(answer(state, result, count))
                except BaseException as error:  # an exception cannot pass through machine code
                    self._raised = error
                signals[STOPPED] = 1
                return 0

            return _FUNCTION(call)

        def near(q: Array, result: int, count: int) -> int:
            rows = self.half_spaces(q, count)
            ctypes.memmove(result, np.ascontiguousarray(rows).ctypes.data, 8 * rows.size)
            return len(rows)

        from pepper_kin.collision.fast import fast_checker_for

        checker = fast_checker_for(self.pepper, self.scene)
        functions = guarded(lambda q, *_: not checker.in_collision(q)), guarded(near)
        addresses = [int(ctypes.cast(f, ctypes.c_void_p).value or 0) for f in functions]
        code = _machine_code(checker) if checker.supported else None
        self._kept = (functions, code)
        if code is None:
            return CollisionTests(0, 0, *addresses)
        return CollisionTests(code[0].address, code[1].ctypes.data, *addresses)

    def check(self) -> None:
        """Raise what a verdict has raised during a search."""
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised


_local = threading.local()


def _machine_code(checker: FastChecker) -> tuple[CompiledValidity, Array]:
    """Return a checker's verdict on all joints in machine code, and its memory for this thread, kept."""
    known: WeakKeyDictionary[FastChecker, tuple[CompiledValidity, Array]] | None
    known = getattr(_local, "known", None)
    if known is None:
        known = _local.known = WeakKeyDictionary()
    found = known.get(checker)
    if found is None:
        n = checker.pepper.n
        validity = checker.compiled(checker.pepper.neutral(), np.arange(n))
        found = known[checker] = (validity, validity.new_memory())
    return found
