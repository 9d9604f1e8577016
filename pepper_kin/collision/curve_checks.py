"""Checks of the states of one motion by machine code, with coal for undecided states."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.collision.checker import RANGE_RADIUS, CollisionChecker, checker_for
from pepper_kin.collision.fast import CompiledValidity, StaticLoads, fast_checker_for
from pepper_kin.collision.fast.tables import tables_of
from pepper_kin.collision.kept_size import MOST_BYTES, checker_size
from pepper_kin.collision.mesh_changes import as_on_disk
from pepper_kin.collision.scene import Scene
from pepper_kin.core.collision.check import row_verdicts
from pepper_kin.core.collision.curve_check import LONGEST, MotionCheck
from pepper_kin.core.collision.gjk import CONTACT, TIE
from pepper_kin.core.collision.layout import EDGE_NUMBERS, STATES_AT_ONCE
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.model import PepperModel, kept_for_robot


class HoldingLimits(NamedTuple):
    """Limits of holding still for the joints and the floor; see `MotionCheck`.

    Attributes:
        effort_limits: Effort limits of the joints, shape (n,) [N m or N].
        loads: Payload, for checks of edges.
        loads_along: Payload, for checks of curves.
        step: Maximum distance that a point of the body moves between states that are to be held [m].
    """

    effort_limits: Array
    loads: StaticLoads
    loads_along: StaticLoads
    step: float


class CurveChecks:
    """Checks of the states of motions of one robot in one scene.

    Machine code decides, and coal does for shapes of the robot without bounds.

    Args:
        pepper: The robot.
        scene: The world; None for the robot alone.
        holding: Limits of holding still; None if it is not checked.

    Attributes:
        exact: Coal's checker without margins.
        compiled: Whether machine code decides.
        quick: Whether coal decides only ties, so that many checks cost little.
        held: Attached objects, see `motion_bounds`.
    """

    def __init__(
        self, pepper: PepperModel, scene: Scene | None, holding: HoldingLimits | None = None
    ) -> None:
        self.pepper, self.scene = pepper, scene
        if holding is None:
            loads = StaticLoads(kernel(pepper, "gravity_torque"))
            holding = HoldingLimits(pepper.effort_limits, loads, loads, LONGEST)
        self.holding = holding
        self.exact: CollisionChecker = checker_for(pepper, scene)
        self._fast, self.held = fast_checker_for(pepper, scene), held_by(self.exact.scene)
        self.compiled, self.quick = self._fast.supported, self._fast.alone
        self._made: dict[tuple[bytes, bytes], CompiledValidity] = {}
        self._checks: dict[int, tuple[object, MotionCheck]] = {}

    def of_motion(self, standing: Array, moving: NDArray[np.int64]) -> MotionCheck:
        """Return the argument of compiled functions that check states of one motion, called by `run`.

        It is valid in this thread until the check of another motion is requested.

        Args:
            standing: Configuration that has the positions of the joints that do not move, shape (n,).
            moving: Indices of the joints that move, shape (k,).
        """
        made = self._moving(standing, moving) if self.compiled else None
        still, moves = NO_BLOCKS if made is None else made.blocks()
        thread, of = get_ident(), made or (standing.tobytes(), moving.tobytes())
        known, found = self._checks.get(thread, (None, None))
        if found is not None and known == of and found.moving is moves:
            return found
        if found is not None and found.still is still and found.moving is moves:
            found = found._replace(standing=standing)
        else:
            found = self._motion_check(still, moves, standing, self.holding.loads_along)
        self._checks = {thread: (of, found)}
        return found

    def _motion_check(self, still: Array, moves: Array, standing: Array, loads: StaticLoads) -> MotionCheck:
        """Return the argument of compiled functions, with this thread's workspace.

        Args:
            still: Block that compares bodies that stand still, shape (s,).
            moves: Block that compares bodies that move, shape (t,).
            standing: Positions of the joints that do not move [rad or m], shape (n,).
            loads: Payload, and edges that the robot must not tip over.
        """
        heads, tables, _ = tables_of(self.pepper)
        states, inputs, torques, work = _workspace_of(standing.size, loads)
        return MotionCheck(
            verdicts=int(row_verdicts.address) if self.compiled else 0,
            ask=_ASK_ADDRESS,
            load=loads.kernel.address_of(
                "batch", inputs=inputs.shape[1], outputs=torques.shape[1], work=work.size
            ),
            quick=self.quick,
            least=self._fast.resting_margin if self.compiled else np.inf,
            radius=RANGE_RADIUS,
            still=still,
            moving=moves,
            standing=standing,
            effort=self.holding.effort_limits,
            masses=loads.masses,
            edges=loads.edges,
            heads=heads,
            tables=tables,
            held_step=self.holding.step,
            states=states,
            inputs=inputs,
            torques=torques,
            answers=np.empty(STATES_AT_ONCE, np.int64),
            margins=np.empty(2),
            work=work,
            words=np.empty(8, np.int64),
        )

    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a compiled function with a result of `of_motion`; coal decides undecided states.

        Raises:
            BaseException: the exception of coal, or an interrupt during the call.
        """
        outer = getattr(_asking, "checks", None)
        _asking.checks, _asking.error = self, None
        try:
            result = function(*arguments)
        finally:
            _asking.checks = outer
        error, _asking.error = _asking.error, None
        try:
            if error is not None:
                raise error
        finally:
            del error  # which refers to this frame
        return result

    def answer(self, states: Array, verdicts: NDArray[Any], margins: tuple[float, float]) -> None:
        """Write coal's verdicts on the states, shape (m, n), whose verdict is a tie."""
        ties = np.flatnonzero(verdicts == TIE)
        exact = checker_for(self.pepper, self.scene, *margins)
        verdicts[ties] = exact.in_collision(states[ties])

    def rests_near(self, margin: float) -> bool:
        """Return whether a body that never moves is nearer to the world than a margin [m]."""
        return self._fast.rests_near(margin)

    def _moving(self, frozen: Array, free: NDArray[np.int64]) -> CompiledValidity:
        """Return the validity, without margins, of bodies that some joints move, cached for one motion.

        Args:
            frozen: Complete configuration [rad or m], shape (n,).
            free: Indices of the joints that move, shape (k,).
        """
        key = frozen.tobytes(), free.tobytes()
        found = self._made.get(key)
        if found is None:
            effort, loads = self.holding.effort_limits, self.holding.loads
            found = self._fast.of_motion(frozen.copy(), free.copy(), effort, loads)
            self._made = {key: found}
        return found


def held_by(scene: Scene | None) -> tuple[tuple[str, float], ...]:
    """Return frame and extent [m] of the objects attached to the robot in a scene, see `motion_bounds`."""
    return () if scene is None else tuple((item.frame, item.extent) for item in scene.attached.values())


@kept_for_robot(most=16, most_bytes=MOST_BYTES, size_of=checker_size)
def _curve_checks_for(pepper: PepperModel, scene: Scene | None) -> CurveChecks:
    return CurveChecks(pepper, scene)


def curve_checks_for(pepper: PepperModel, scene: Scene | None) -> CurveChecks:
    """Return checks without limits of holding still, cached with their arrays."""
    return _curve_checks_for(pepper, as_on_disk(scene))


NO_BLOCKS = np.empty(0), np.empty(0)


class _Workspaces(threading.local):
    """Arrays of each thread that its checks of curves share, by size."""

    def __init__(self) -> None:
        self.kept: dict[tuple[int, ...], tuple[Array, Array, Array, Array]] = {}


_workspaces = _Workspaces()


def _workspace_of(n: int, loads: StaticLoads) -> tuple[Array, Array, Array, Array]:
    """Return this thread's arrays for states, and for inputs, torques and work of a kernel of loads."""
    size = n, loads.masses.size, len(loads.edges), loads.kernel.work_size
    found = _workspaces.kept.get(size)
    if found is None:
        outputs = n + (EDGE_NUMBERS if len(loads.edges) else 0)
        sizes = n, n + loads.masses.size, outputs
        states, inputs, torques = (np.empty((STATES_AT_ONCE, size)) for size in sizes)
        found = _workspaces.kept[size] = states, inputs, torques, np.empty(loads.kernel.work_size + 8)
    return found


_asking = threading.local()
"""Checks of each thread for which a compiled function runs, and the exception raised meanwhile."""


@ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)
def _ask(states: int, count: int, verdicts: int, margins: int) -> int:
    """Answer the call-backs of compiled checks; see `MotionCheck`."""
    checks: CurveChecks = _asking.checks
    found = words_at(verdicts, max(count, 1))
    try:
        margin, self_margin = floats_at(margins, 2).tolist()
        if count == 0:
            return int(checks.rests_near(margin))
        n = checks.pepper.n
        checks.answer(floats_at(states, n * count).reshape(count, n), found, (margin, self_margin))
    except BaseException as error:  # also a keyboard interrupt
        _asking.error = error
        found[:] = CONTACT
        return 1
    return 0


_ASK_ADDRESS = int(ctypes.cast(_ask, ctypes.c_void_p).value or 0)
