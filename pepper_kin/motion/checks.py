"""Validity of the configurations of a motion: collision checks at any margin, and torques that hold."""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Callable
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision import CollisionChecker, Scene, checker_for
from pepper_kin.collision.checker import RANGE_RADIUS
from pepper_kin.collision.fast import CompiledValidity, StaticLoads, fast_checker_for
from pepper_kin.collision.fast.tables import tables_of
from pepper_kin.collision.kept_size import MOST_BYTES, checker_size
from pepper_kin.collision.mesh_changes import as_on_disk
from pepper_kin.core.collision.check import check_many, row_verdicts, valid_steps
from pepper_kin.core.collision.curve_check import SHORTEST, MotionCheck, kept_margins, sound_ends
from pepper_kin.core.collision.gjk import CONTACT, TIE
from pepper_kin.core.collision.layout import EDGE_NUMBERS, STATES_AT_ONCE
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.motion.static_limits import StaticLimits
from pepper_kin.planners.deadline import load_code

LEAST_MARGIN = 1e-4
"""A margin smaller than this counts as none [m]."""


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
        held: What hangs on the robot, see `motion_bounds`.
    """

    def __init__(self, pepper: PepperModel, scene: Scene | None, statics: StaticLimits | None = None) -> None:
        self.pepper, self.scene = pepper, scene
        self.statics = StaticLimits(pepper) if statics is None else statics
        _load_code()
        self.exact: CollisionChecker = checker_for(pepper, scene)
        self._fast, self.held = fast_checker_for(pepper, scene), held_by(self.exact.scene)
        self.compiled, self.quick = self._fast.supported, self._fast.alone
        self._made: dict[tuple[bytes, bytes], CompiledValidity] = {}
        self._checks: dict[int, tuple[object, MotionCheck]] = {}
        self._whole: CompiledValidity | None = None
        self._of_configurations: dict[int, MotionCheck] = {}

    def free(self, q: ArrayLike, margin: float = 0.0, self_margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether nothing is nearer than the margins, shape (...), at q, shape (..., n)."""
        if margin == 0.0 and self_margin == 0.0:
            return ~self._fast.in_collision(q)
        return ~fast_checker_for(self.pepper, self.scene, margin, self_margin).in_collision(q)

    @property
    def edges(self) -> int:
        """Address of the compiled check of edges, which takes a block of `of_motion`; 0 without."""
        return int(valid_steps.address) if self.compiled else 0

    def along(
        self, standing: Array, moving: NDArray[np.int64], margins: tuple[float, float]
    ) -> Callable[[Array], NDArray[np.bool_]]:
        """Return a function of states of one motion, shape (m, n), that answers as `free` does.

        What stands is looked at once.

        Args:
            standing: A configuration in which the joints stand that do not move, shape (n,).
            moving: Places of the joints that move, shape (k,).
            margins: To the scene and to the robot itself [m].
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

    def of_motion(self, standing: Array, moving: NDArray[np.int64]) -> MotionCheck:
        """Return what compiled functions take that check states of one motion, called by `run`.

        It is of use in this thread until a check of another motion is asked for.

        Args:
            standing: A configuration in which the joints stand that do not move, shape (n,).
            moving: Places of the joints that move, shape (k,).
        """
        made = self._moving(standing, moving) if self.compiled else None
        still, moves = _NO_BLOCKS if made is None else made.blocks()
        thread, of = get_ident(), made or (standing.tobytes(), moving.tobytes())
        known, found = self._checks.get(thread, (None, None))
        if found is not None and known == of and found.moving is moves:
            return found
        found = self._motion_check(still, moves, standing, self.statics.loads_along)
        self._checks = {thread: (of, found)}
        return found

    def of_configurations(self) -> MotionCheck:
        """Return what compiled functions take that check configurations of which any joint may differ.

        What holds for states of a path holds for them: see `StaticLimits.hold`.  It is of use in this thread
        until a check of a motion, or another of these, is asked for.
        """
        blocks = _NO_BLOCKS
        if self.compiled:
            if self._whole is None:
                everything = np.arange(self.pepper.n)
                effort, loads = self.statics.effort_limits, self.statics.loads
                self._whole = self._fast.of_motion(self.pepper.neutral(), everything, effort, loads)
            blocks = self._whole.blocks()
        thread = get_ident()
        found = self._of_configurations.get(thread)
        if found is None or found.moving is not blocks[1]:
            found = self._motion_check(*blocks, self.pepper.neutral(), self.statics.loads)
            self._of_configurations = {thread: found}
        return found

    def _motion_check(self, still: Array, moves: Array, standing: Array, loads: StaticLoads) -> MotionCheck:
        """Return what compiled functions take, with this thread's workspace.

        Args:
            still: The block that compares what stands, shape (s,).
            moves: The block that compares what moves, shape (t,).
            standing: Where the joints stand that do not move [rad or m], shape (n,).
            loads: What is carried, and edges that the robot must not tip over.
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
            effort=self.statics.effort_limits,
            masses=loads.masses,
            edges=loads.edges,
            heads=heads,
            tables=tables,
            held_step=self.statics.step,
            states=states,
            inputs=inputs,
            torques=torques,
            answers=np.empty(STATES_AT_ONCE, np.int64),
            margins=np.empty(2),
            work=work,
            words=np.empty(8, np.int64),
        )

    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a compiled function that takes an `of_motion`; coal decides what it cannot.

        Raises:
            BaseException: what coal, or an interrupt meanwhile, has raised.
        """
        outer = getattr(_asking, "checks", None)
        _asking.checks, _asking.error = self, None
        try:
            result = function(*arguments)
        finally:
            _asking.checks = outer
        if _asking.error is not None:
            raise _asking.error
        return result

    def answer(self, states: Array, verdicts: NDArray[Any], margins: tuple[float, float]) -> None:
        """Write coal's verdicts on those of some states, shape (m, n), that have a tie."""
        ties = np.flatnonzero(verdicts == TIE)
        exact = checker_for(self.pepper, self.scene, *margins)
        verdicts[ties] = exact.in_collision(states[ties])

    def rests_near(self, margin: float) -> bool:
        """Whether what never moves against the world is nearer to it than a margin [m]."""
        return self._fast.rests_near(margin)

    def holds(self, q: Array) -> NDArray[np.bool_]:
        """Whether q, shape (m, n), can be held still, with a little to spare; shape (m,)."""
        return self.statics.hold(q)

    def too_near(self, q: Array, what: str, least: float) -> str:
        """Return a sentence on what an end of a path, shape (n,), is too near to; empty where to nothing.

        Args:
            q: The configuration.
            what: Its name, such as "start".
            least: What a curve must keep from the scene all along, which is looked at `SHORTEST` apart [m].
        """
        if least == 0.0 or self.free(q, least + SHORTEST):
            return ""
        names = self.exact.with_margins(least + SHORTEST, 0.0).contacts(q)
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
                """Return which states of the free joints [rad or m], shape (m, k), are valid, shape (m,)."""
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
        """Return the validity without margins of what some joints move, made once for one motion.

        Args:
            frozen: A whole configuration [rad or m], shape (n,).
            free: Places of the joints that move, shape (k,).
        """
        key = frozen.tobytes(), free.tobytes()
        found = self._made.get(key)
        if found is None:
            effort, loads = self.statics.effort_limits, self.statics.loads
            found = self._fast.of_motion(frozen.copy(), free.copy(), effort, loads)
            self._made = {key: found}
        return found

    def margins(
        self, start: Array, goals: Array, free: NDArray[np.int64], margin: float
    ) -> tuple[float, float]:
        """Return the margins kept to the scene and to the robot itself [m], as far as the ends allow.

        Args:
            start: Start configuration, shape (n,).
            goals: Goals, shape (m, n); one that keeps the margins will do.
            free: Places of the joints in which they may differ, shape (k,).
            margin: The margin requested [m].
        """
        ends, kept = np.concatenate([start[None], goals]), np.empty(2)
        self.run(kept_margins, self.of_motion(start, free), ends, margin, LEAST_MARGIN, kept)
        return float(kept[0]), float(kept[1])

    def sound_ends(
        self, start: Array, goals: Array, free: NDArray[np.int64], margin: float
    ) -> tuple[float, float] | None:
        """Return what `margins` does where all ends touch nothing and can be held, and else None.

        It takes one call of machine code; None as well where that cannot answer.

        Args:
            start: Start configuration [rad or m], shape (n,).
            goals: Goals [rad or m], shape (m, n).
            free: Places of the joints in which they may differ, shape (k,).
            margin: The margin requested [m].
        """
        if not self.compiled or self.statics.balance is not None or not free.size:
            return None
        ends, kept = np.concatenate([start[None], goals]), np.empty(2)
        if not self.run(sound_ends, self.of_motion(start, free), ends, margin, LEAST_MARGIN, kept):
            return None
        return float(kept[0]), float(kept[1])


def held_by(scene: Scene | None) -> tuple[tuple[str, float], ...]:
    """Return what hangs on the robot in a scene, see `motion_bounds`."""
    return () if scene is None else tuple((item.frame, item.extent) for item in scene.attached.values())


def checks_for(pepper: PepperModel, scene: Scene | None, statics: StaticLimits) -> Checks:
    """Return the checks of a robot in a scene, made once and kept, with their arrays, for the next call."""
    return _checks_for(pepper, as_on_disk(scene), statics)


@kept_for_robot(most=16, most_bytes=MOST_BYTES, size_of=checker_size)
def _checks_for(pepper: PepperModel, scene: Scene | None, statics: StaticLimits) -> Checks:
    return Checks(pepper, scene, statics)


_NO_BLOCKS = np.empty(0), np.empty(0)


class _Workspaces(threading.local):
    """Arrays of each thread that its checks of curves share, by their sizes."""

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
"""The checks, of each thread, that a compiled function runs for, and what was raised meanwhile."""


@ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)
def _ask(states: int, count: int, verdicts: int, margins: int) -> int:
    """Answer the queries of compiled checks; see `MotionCheck`."""
    checks: Checks = _asking.checks
    found = words_at(verdicts, max(count, 1))
    try:
        margin, self_margin = floats_at(margins, 2).tolist()
        if count == 0:
            return int(checks.rests_near(margin))
        n = checks.pepper.n
        checks.answer(floats_at(states, n * count).reshape(count, n), found, (margin, self_margin))
    except BaseException as error:  # also an interrupt from the keyboard
        _asking.error = error
        found[:] = CONTACT
        return 1
    return 0


_ASK_ADDRESS = int(ctypes.cast(_ask, ctypes.c_void_p).value or 0)


@functools.cache
def _load_code() -> None:
    """Load, or compile, what planning needs, before any clock starts."""
    load_code(check_many, sound_ends)
