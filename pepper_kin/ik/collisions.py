"""Collision checks of inverse kinematics: free or not, and half-spaces that keep steps clear."""

from __future__ import annotations

import ctypes
import threading
from typing import TYPE_CHECKING, Any, cast
from weakref import WeakKeyDictionary

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import clearance_along
from pepper_kin.collision.checker import checker_for
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.collision.loads import load_torque, loads_of
from pepper_kin.collision.near_pairs import near_pairs
from pepper_kin.core.inverse_kinematics.local_solver import CollisionTests
from pepper_kin.core.inverse_kinematics.proximity import near_rows
from pepper_kin.core.inverse_kinematics.verdict import verdict
from pepper_kin.dynamics import gravity_torque
from pepper_kin.dynamics.load import Loads
from pepper_kin.ik.fast.proximity_table import proximity_memory
from pepper_kin.kernels.interrupts import STOPPED
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.collision import Clearance, Scene
    from pepper_kin.collision.fast import FastChecker

MARGIN = 0.005
"""Distance that steps keep where they can [m]."""
NOTICE = 0.10
"""Distance below which pairs of bodies constrain a step [m]."""

NO_TESTS = CollisionTests(0, 0, 0, 0, 0, 0)
"""Tests of searches without collision checks."""

_GRAVITY = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)


def holding_torque(pepper: PepperModel, q: Array, loads: Loads) -> Array:
    """Return the torques that hold a robot and its loads still [N m or N] at q [rad or m], shape (..., n)."""
    torque = gravity_torque(pepper, q)
    if not loads:
        return torque
    rest = np.zeros_like(q)
    return torque + load_torque(pepper, loads, q, rest, rest)


def torque_ratios(pepper: PepperModel, q: Array, loads: Loads = ()) -> Array:
    """Return |g_i(q)| / effort limit of every joint at q, shape (..., n) each; zero for joints without limit.

    The torques g include the loads'.
    """
    effort = pepper.effort_limits
    limited = np.isfinite(effort) & (effort > 0)
    return np.where(limited, np.abs(holding_torque(pepper, q, loads)) / np.where(limited, effort, 1.0), 0.0)


class Collisions:
    """Collision checks of one robot in one scene; without a scene every configuration is free.

    Args:
        pepper: The robot.
        scene: The world; an empty one checks the robot against itself, None checks nothing.
        margin: Minimum distance to the scene [m].
        loads: Carried objects; None for the objects with a mass attached in the scene.

    Attributes:
        loads: Carried objects.
    """

    def __init__(
        self, pepper: PepperModel, scene: Scene | None, margin: float = 0.0, loads: Loads | None = None
    ) -> None:
        self.pepper = pepper
        self.scene, self.margin = scene, margin
        self.loads = loads_of(pepper, scene) if loads is None else loads
        self._raised: BaseException | None = None
        self._kept: tuple[Any, ...] = ()

    def again(self) -> Collisions:
        """Return a copy of the checks for use on another thread."""
        return Collisions(self.pepper, self.scene, self.margin, self.loads)

    @property
    def considered(self) -> bool:
        """Whether collisions are checked."""
        return self.scene is not None

    def free(self, q: Array) -> bool:
        """Whether nothing touches at q, shape (n,) [rad or m]."""
        if self.scene is None:
            return True
        return not bool(checker_for(self.pepper, self.scene, self.margin).in_collision(q))

    def free_many(self, q: Array) -> np.ndarray:
        """Whether nothing touches at each of many configurations [rad or m], shape (m, n) -> (m,)."""
        if self.scene is None:
            return np.ones(len(q), dtype=bool)
        return ~fast_checker_for(self.pepper, self.scene, self.margin).in_collision(q)

    def clearance(self, q: Array) -> Clearance | None:
        """Return the minimum distances at q, shape (n,) [rad or m]; None without checks."""
        if self.scene is None:
            return None
        return clearance_along(self.pepper, q[None], self.scene)

    def half_spaces(self, q: Array, count: int) -> Array:
        """Return half-spaces of joint positions near q that keep a step clear, g . q' >= b.

        Each half-space linearizes the distance d of one of the nearest pairs of bodies; with g = dd/dq at q,

            d + g . (q' - q) >= MARGIN + margin.

        Args:
            q: Joint positions, shape (n,) [rad or m].
            count: Maximum number of pairs.

        Returns:
            g and b of each half-space, shape (m, n + 1), m <= count.
        """
        pairs = near_pairs(self.pepper, q, NOTICE + self.margin, self.scene)
        slopes, distances = pairs.gradients[:count], pairs.distances[:count]
        return np.column_stack([slopes, MARGIN + self.margin - distances + slopes @ q])

    def tests(self, signals: np.ndarray) -> CollisionTests:
        """Return the checks as addresses of functions, valid until the next call and on this thread.

        Args:
            signals: A table, shape (8,), see `pepper_kin.kernels.interrupts`, that is set to stop if a check
                fails; `check` then raises the error.
        """
        if self.scene is None:
            return NO_TESTS
        checker = fast_checker_for(self.pepper, self.scene, self.margin)
        known: WeakKeyDictionary[FastChecker, _Blocks] | None = getattr(_local, "known", None)
        if known is None:
            known = _local.known = WeakKeyDictionary()
        blocks = known.get(checker)
        if blocks is None:
            blocks = known[checker] = _Blocks(checker)
        if checker.alone:
            self._kept = (blocks,)
            return blocks.tests

        def is_free(q: int, *_: int) -> int:
            try:
                if self._raised is None:
                    return int(not checker.in_collision(floats_at(q, self.pepper.n).copy()))
            except BaseException as error:  # an exception cannot pass through machine code
                self._raised = error
            signals[STOPPED] = 1
            return 0

        function = _FUNCTION(is_free)
        self._kept = (blocks, function)
        return blocks.tests._replace(is_free=int(ctypes.cast(function, ctypes.c_void_p).value or 0))

    def holding(self, gravity: int, signals: np.ndarray) -> int:
        """Return the address of the function (q, result, work) that writes the torques that hold q still.

        The address is valid on this thread while this object lives.

        Args:
            gravity: Address of the robot's own function, returned without loads.
            signals: Table of signals, shape (8,), as in `tests`.
        """
        if not self.loads:
            return gravity
        n = self.pepper.n

        def hold(q: int, result: int, _: int) -> None:
            try:
                floats_at(result, n)[:] = holding_torque(self.pepper, floats_at(q, n).copy(), self.loads)
            except BaseException as error:  # an exception cannot pass through machine code
                self._raised, signals[STOPPED] = error, 1

        self._held = _GRAVITY(hold)
        return int(ctypes.cast(self._held, ctypes.c_void_p).value or 0)

    def check(self) -> None:
        """Raise the error that a check raised during a search."""
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised


_local = threading.local()


class _Blocks:
    """Memory of one thread for a checker.

    Attributes:
        tests: Addresses that compiled searches call.
    """

    def __init__(self, checker: FastChecker) -> None:
        validity, block, address = None, np.empty(0), 0
        if checker.supported:
            validity = checker.compiled(checker.pepper.neutral(), np.arange(checker.pepper.n))
            block, address = validity.new_memory(), cast("Any", verdict).address
        near = proximity_memory(checker.exact, MARGIN)
        self._kept = validity, block, near
        self.tests = CollisionTests(
            address, block.ctypes.data, block.size, 0, cast("Any", near_rows).address, near.address
        )
