"""Collision-free curve of joint positions that meets tasks along a whole path, and its motion."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.ik.fast.task_rows import TaskRows
from pepper_kin.ik.problem import moved_aside
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels.working_time import working_time
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.motion.checks import checks_for
from pepper_kin.motion.follow_result import Followed, FollowStatus, NotFollowedError, words_for_aside
from pepper_kin.motion.goals import fault_of
from pepper_kin.motion.least_acceleration import NodeProblem, PathNodes
from pepper_kin.motion.path_barriers import PathBarriers
from pepper_kin.motion.static_limits import StaticLimits
from pepper_kin.motion.task_path import TaskPath
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.trajectory.limits import MotionLimits, quantities_of, share_of
from pepper_kin.trajectory.path import CubicPath, turning_points
from pepper_kin.trajectory.retiming import grid_parameters
from pepper_kin.trajectory.stop import limits_of

interpolate = lazy_module("scipy.interpolate")

_Begin: TypeAlias = tuple[Array, Array]  # nodes, and joint positions there

_MOST_NODES = 250
_REFINED = 7  # maximum number of times that nodes are added
_STEPS, _NEAR_STEPS = 20, 8  # steps for one set of nodes: at first, and after nodes were added
_MET, _BETWEEN = 0.03, 0.3  # maximum errors over tolerances, at nodes and between; else nodes are added
_RIPPLE = 2e-3  # maximum relative change of a hand's speed along a route between nodes
_STILL = 5e-3  # step size below which the iteration may end [rad or m]
_WITHIN, _MOST_WITHIN = 1e-3, 8e-3  # distance of nodes inside the position limits [rad or m]
_FAR = 5e-3  # maximum excess over a limit at nodes [rad or m]
_NEARNESS = 0.1
_IDLE = (1.0, 10.0, 0.1)  # weights of joints that no task moves to stay at rest, tried in turn
_INSTANTS = 200  # number of instants at which their speed is evaluated
_GENTLE = 0.3  # speed of such joints above which the next weight is tried [rad/s or m/s]
_DRAWN = (30.0, 1e3, 1e5)  # weights of nearness to postures without contact, tried in turn
_PREFERRED, _RELAXED = (
    3.0,
    100.0,
)  # factors on preferences, and on relaxed tasks and inequalities
_STAY, _JUMP = 0.02, 0.35  # weight of the previous posture, and largest step to the next [rad or m]
_FINEST = 1e-3  # minimum step to the next posture, relative to the length
_SPLIT = 4  # maximum number of times that nodes are added at contacts
_POINTS = 8  # number of checked points of each piece
_CRUISING, _EVEN = 0.999, 0.99  # minimum fractions of the requested speed, and of the speed before on a ramp
_RETRIED = 8  # maximum number of retries with a joint that is too fast held more
_SLOWER, _WIDTH, _EMPHASIS = (
    0.5,
    0.06,
    3.0,
)  # factor on that joint's scale; width relative to the length, and factor, of more bending weight


class WholePath:
    """Computation of the curve along a path of tasks, and of its motion.

    Args:
        path: The tasks along the path.
        margin: Distance to keep to the scene [m].
        speed: Rate of the parameter [1/s]; None: as fast as limits allow.
        allowed: Limits that the motion may use.
        options: Options of `retime`.
    """

    def __init__(
        self,
        path: TaskPath,
        margin: float,
        speed: float | None,
        allowed: MotionLimits,
        options: dict[str, Any],
    ) -> None:
        self.path, self.pepper, self.margin = path, path.pepper, margin
        self.speed, self.options = speed, options
        self.limits = limits_of(self.pepper, allowed)
        self.statics = StaticLimits(
            self.pepper, allowed.balance, allowed.loads, 1.0 if allowed.torque is None else allowed.torque
        )
        self.checks = checks_for(self.pepper, path.scene, self.statics)
        self._barriers: PathBarriers | None = None
        self._relaxed, self._fast = set[int](), list[float]()
        self._scale, self._idle = np.ones(self.pepper.n), np.zeros(self.pepper.n, bool)
        self._start, self._rest = self.pepper.neutral(), _IDLE[0]

    def followed(
        self, start: Array, weights: Array, *, ramps: bool, laps: int, deadline: float = np.inf
    ) -> Followed:
        """Return the motion from a start.

        Args:
            start: Joint positions [rad or m], shape (n,).
            weights: Relative accelerations that the joints may have, shape (n,).
            ramps: Whether the motion begins and ends at rest.
            laps: Number of rounds on a closed path.
            deadline: Time on the clock of `working_time` after which no other curve is tried [s].

        Raises:
            NotFollowedError: if there is no motion, with the reason.
        """
        tasks = self.path.at_one(0.0)
        fault = fault_of(self.checks.exact, start, "start", self.statics)
        off = [t.shortfall(self.pepper, start) for t in tasks if t.error(self.pepper, start) > t.tolerance]
        if fault is not None or off:
            message = fault[1] if fault is not None else f"The start does not meet the tasks: {off[0]}."
            raise NotFollowedError(FollowStatus.START_INVALID, message)
        self._start, self._rest, top = start, _IDLE[0], self.pepper.acceleration_limits
        self._scale, self._fast = weights * np.where(np.isfinite(top) & (top > 0), top, 1.0), []
        curve = self._prioritized(start, tasks)
        first: NotFollowedError | None = None
        gentlest: tuple[float, Followed] | None = None
        others = iter(_IDLE[1:])
        for _ in range(_RETRIED):
            try:
                curve = curve if self._is_clear(curve) else self._around(start, curve)
                whole = _repeated(curve, laps)
                motion = self._motion(whole, ramps)
                slowest = self._slowest(whole, motion) if ramps and self.speed is not None else 1.0
            except NotFollowedError as error:
                if gentlest is not None:
                    break
                first = first or error
                if error.joint is None or working_time() > deadline:
                    raise first from None
                self._scale[error.joint] *= _SLOWER
                self._fast.append(error.reached * laps % 1.0)
            else:
                pace = self._idle_pace(motion)
                if gentlest is None or pace < gentlest[0]:
                    gentlest = pace, self._done(curve, whole, motion, slowest)
                rest = next(others, None)
                if pace <= _GENTLE or rest is None or working_time() > deadline:
                    break
                self._rest = rest
            nodes = curve.breaks[: len(curve.breaks) - self.path.closed]
            try:
                curve = self._curve(start, (nodes, _at(curve, nodes)))
            except NotFollowedError:
                break
        if gentlest is not None:
            return gentlest[1]
        assert first is not None
        raise first

    def _done(self, curve: CubicPath, whole: CubicPath, motion: Trajectory, slowest: float) -> Followed:
        """Return the result of a motion along a whole curve with all laps."""
        tasks = self.path.at_one(0.0)
        relaxed = tuple(tasks[k].name for k in sorted(self._relaxed))
        said = f" {' and '.join(relaxed)} only as well as can be." if relaxed else ""
        aside = self._moved_aside(curve)
        return Followed(
            FollowStatus.DONE, f"The whole path in {motion.duration:.2f} s.{said}{words_for_aside(aside)}",
            motion, whole, tuple(task.name for task in tasks), self._errors(curve), relaxed, slowest, 1.0,
            aside=aside,
        )  # fmt: skip

    def _idle_pace(self, motion: Trajectory) -> float:
        """Return the maximum speed of joints that no task moves [rad/s or m/s]; 0 without a set speed."""
        if self.speed is None or not self._idle.any():
            return 0.0
        times = np.linspace(0.0, motion.duration, _INSTANTS)
        return float(np.abs(motion(times).velocity[:, self._idle]).max())

    def _moved_aside(self, curve: CubicPath) -> tuple[str, ...]:
        """Return the joints that move aside, in words; see `Followed.aside`."""
        way = np.ptp(_points(curve, np.arange(_POINTS) / _POINTS)[1], axis=0)
        return moved_aside(self.pepper, self._idle, way)

    def _prioritized(self, start: Array, tasks: list[Task]) -> CubicPath:
        """Return the curve, with as many of the last tasks relaxed as necessary."""
        equations = [k for k, task in enumerate(tasks) if _is_equation(task)]
        soft = [k for k in equations if not tasks[k].hard]
        if not equations:
            raise InvalidValueError("tasks", "with infinite tolerances only", "one with a finite tolerance")
        self._relaxed = set()
        while True:
            try:
                return self._first_curve(start)
            except NotFollowedError:
                if not soft or len(self._relaxed) + 1 == len(equations):
                    raise
            self._relaxed.add(soft.pop())

    def _first_curve(self, start: Array) -> CubicPath:
        self._barriers = self._kept_apart(start, False)
        try:
            return self._curve(start)
        except NotFollowedError as error:
            if error.status in (FollowStatus.OUT_OF_REACH, FollowStatus.NOT_HELD):
                raise
        self._barriers = None
        return self._curve(start)

    def _curve(
        self,
        start: Array,
        begin: _Begin | None = None,
        near: Callable[[Array], Array] | None = None,
        nearness: float = _NEARNESS,
    ) -> CubicPath:
        """Return the minimum-acceleration curve.

        Args:
            start: Joint positions at the start [rad or m], shape (n,).
            begin: Initial nodes and joint positions; None for postures from node to node, or `near`.
            near: Function from parameters to postures to stay near; None for the start.
            nearness: Weight of the distance from these postures.

        Raises:
            NotFollowedError: if tasks or position limits are not met.
        """
        path, pepper, stuck = self.path, self.pepper, None
        within, steps = np.full(pepper.n, _WITHIN), _STEPS
        if begin is not None:
            s, q = begin
        else:
            s = path.nodes()
            q, stuck = (near(s), None) if near is not None else self._led(start, s)
        for _ in range(_REFINED):
            q[0] = start
            close = np.tile(start, (len(s), 1)) if near is None else near(s)
            limits = np.stack([pepper.lower_limits + within, pepper.upper_limits - within])
            q, missed = self._solved(s, q, (close, nearness), limits, steps)
            if missed is not None:
                raise stuck or self._unmet(s, q, missed)
            self._refuse_far(s, q)
            curve = self._spline(s, q)
            excess = _excess(curve, pepper)
            middles = (curve.breaks[:-1] + curve.breaks[1:]) / 2
            coarse = self._is_coarse(curve) | (excess > 0.0).any(axis=1)
            if not coarse.any() or len(s) > _MOST_NODES:
                break
            within = np.minimum(within + np.where((excess > 0.0).any(axis=0), _WITHIN, 0.0), _MOST_WITHIN)
            s, steps = np.union1d(s, middles[coarse]), _NEAR_STEPS
            q = _at(curve, s)
        if excess.max() > 0.0:
            piece, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
            raise self._outside(middles[piece], int(joint), excess.max())
        self._errors(curve)
        return curve

    def _led(self, start: Array, s: Array) -> tuple[Array, NotFollowedError | None]:
        """Return postures at nodes from one to the next, shape (K, n), and the reason if that ended early."""
        every = np.union1d(s[::2], s[-1:])
        clear = None if self._barriers is None else self.path.scene.padded(self.margin)
        stuck: NotFollowedError | None = None
        try:
            postures = self._chained(start, every, clear)
        except NotFollowedError as error:
            stuck, postures = error, start[None] if error.postures is None else error.postures
        return _linear(s, every[: len(postures)], postures), stuck

    def _solved(
        self, s: Array, q: Array, close: tuple[Array, float], limits: Array, steps: int
    ) -> tuple[Array, int | None]:
        """Return joint positions at nodes, shape (K, n), and the first node that misses its tasks, or None.

        Args:
            s: Parameters of the nodes, shape (K,).
            q: Initial joint positions [rad or m], shape (K, n).
            close: Postures to stay near [rad or m], shape (K, n), and the weight of that.
            limits: Position bounds [rad or m], shape (2, n).
            steps: Maximum number of steps.
        """
        path, tasks = self.path, self.path.at(s)
        equations = self._equations(tasks)
        tolerances = [task.tolerance for task in equations]
        rows = self._rows(s, [1.0 / tolerance for tolerance in tolerances])
        others, preferences = [task for task in tasks if task not in equations], None
        if others:
            factors = [t.weight * (_RELAXED if np.isfinite(t.tolerance) else _PREFERRED) for t in others]
            preferences = TaskRows(self.pepper, others, len(s), factors)
        nodes = PathNodes.of(s, path.corners, path.closed, path.length, self._emphasis(s))
        near, nearness = close
        self._idle = ~rows(q)[1].any(axis=(0, 1)) & path.moving
        if preferences is not None:
            self._idle &= ~preferences(q)[1].any(axis=(0, 1))
        held = np.where(self._idle, max(nearness, self._rest), nearness)
        problem = NodeProblem(
            nodes, rows, preferences, self._barriers, self._scale, limits, near, np.tile(held, (len(s), 1)),
            path.moving,
        )  # fmt: skip
        q = problem.solved(q, steps, _STILL, _MET)
        missed = (rows.errors(q) > tolerances).any(axis=1)
        return q, int(np.argmax(missed)) if missed.any() else None

    def _rows(self, s: Array, factors: list[float]) -> TaskRows:
        """Return the equations at parameters, shape (K,), with a factor for each equation.

        The start meets tasks only to their tolerances: its errors decay along the first half of the path.
        """
        path, pepper = self.path, self.pepper
        begin = self._equations(path.at(np.zeros(1)))
        off = TaskRows(pepper, begin, 1, [1.0] * len(begin))(self._start[None])[0]
        away = 2.0 * (np.minimum(s, path.length - s) if path.closed else s) / path.length
        left = np.clip(1.0 - away, 0.0, 1.0)
        share = left**3 * (10.0 - 15.0 * left + 6.0 * left**2)
        return TaskRows(pepper, self._equations(path.at(s)), len(s), factors, share[:, None] * off)

    def _equations(self, tasks: list[Task]) -> list[Task]:
        """Return the tasks that have to be met."""
        return [t for k, t in enumerate(tasks) if _is_equation(t) and k not in self._relaxed]

    def _emphasis(self, s: Array) -> Array:
        """Return factors on the bending weight at nodes, (K,), above 1 where the motion was too fast."""
        away = (s[:, None] / self.path.length - np.array(self._fast)) / _WIDTH
        return np.asarray(np.prod(1.0 + (_EMPHASIS - 1.0) * np.exp(-(away**2)), axis=1))

    def _chained(self, start: Array, s: Array, scene: Scene | None) -> Array:
        """Return postures from node to node, each near the previous one, shape (K, n).

        Raises:
            NotFollowedError: if there is none at a node, with the postures before.
        """
        path, done, kept, before = self.path, 0.0, [start], start
        ahead = list(s[:0:-1])
        while ahead:
            tasks = self._equations(path.at_one(ahead[-1]))
            stay = ik.JointPosture(before, weight=_STAY, tolerance=np.inf)
            found = ik.solve(
                self.pepper, [*tasks, stay], start=before, joints=path.joints, restarts=0, scene=scene,
                collisions=scene is not None, balance=self.statics.balance,
            )  # fmt: skip
            if found.success and np.abs(found.q - before).max() <= _JUMP:
                before, done = found.q, ahead.pop()
                if done in s:
                    kept.append(before)
            elif ahead[-1] - done >= _FINEST * path.length:
                ahead.append((done + ahead[-1]) / 2)
            else:
                status, reason = path.unreachable(before, tasks)
                if scene is not None and status is FollowStatus.JUMP:
                    status, reason = FollowStatus.IN_COLLISION, "no posture near the one before is clear."
                message = f"{path.words(ahead[-1])} {reason}"
                raise NotFollowedError(status, message, done / path.length, postures=np.array(kept))
        return np.array(kept)

    def _unmet(self, s: Array, q: Array, node: int) -> NotFollowedError:
        """Return the error for unmet tasks at a node of s, shape (K,), with joint positions q, (K, n)."""
        status, reason = self.path.unreachable(
            q[max(node - 1, 0)], self._equations(self.path.at_one(s[node]))
        )
        message = f"{self.path.words(s[node])} {reason}"
        return NotFollowedError(status, message, s[max(node - 1, 0)] / self.path.length)

    def _refuse_far(self, s: Array, q: Array) -> None:
        """Refuse positions at nodes, shape (K, n), far outside the limits, where more nodes would not help.

        Raises:
            NotFollowedError: for such positions, naming the joint, or a joint that could not hold still.
        """
        outside = np.maximum(self.pepper.lower_limits - q, q - self.pepper.upper_limits)
        k, j = np.unravel_index(int(np.argmax(outside)), outside.shape)
        if outside[k, j] <= _FAR:
            return
        if self._barriers is not None:
            node, name, share = self._barriers.overloaded(q)
            if share > 1.0:
                message = (
                    f"{self.path.words(s[node])} {name} would need {share:.2f} of its effort to hold still."
                )
                raise NotFollowedError(FollowStatus.NOT_HELD, message, s[node] / self.path.length)
        raise self._outside(s[k], int(j), outside[k, j])

    def _outside(self, s: float, joint: int, excess: float) -> NotFollowedError:
        name, unit = self.pepper.joint_names[joint], self.pepper.joint_units[joint]
        message = f"{self.path.words(s)} {name} would leave its limits by {excess:.2g} {unit}."
        return NotFollowedError(FollowStatus.BLOCKED_BY_LIMITS, message, s / self.path.length)

    def _spline(self, s: Array, q: Array) -> CubicPath:
        """Return the cubic spline through nodes, with a kink at each corner."""
        path = self.path
        if path.closed:
            s, q = np.append(s, path.length), np.concatenate([q, q[:1]])
            if not path.corners.size:
                return _as_path(interpolate.CubicSpline(s, q, bc_type="periodic"))
        ends = np.union1d([0, len(s) - 1], np.flatnonzero(np.isin(s, path.corners)))
        parts = [_as_path(interpolate.CubicSpline(s[a : b + 1], q[a : b + 1])) for a, b in pairwise(ends)]
        breaks = [parts[0].breaks[:1], *(part.breaks[1:] for part in parts)]
        return CubicPath(np.concatenate(breaks), np.concatenate([part.coefficients for part in parts]))

    def _is_coarse(self, curve: CubicPath) -> NDArray[np.bool_]:
        """Return which pieces, (m,), violate equations between nodes, or have an uneven speed of the hand."""
        s, q = _points(curve, np.array([0.25, 0.5, 0.75]))
        firm = self._equations(self.path.at(s))
        rows = self._rows(s, [1.0] * len(firm))
        missed = (rows.errors(q) > _BETWEEN * np.array([t.tolerance for t in firm])).any(axis=1)
        coarse = np.asarray(np.reshape(missed, (-1, 3)).any(axis=1))
        if self.path.is_route:
            off = rows(q)[0][:, rows.lengths].reshape(len(coarse), 3, -1)
            change = np.abs(np.diff(off, axis=1)).max(axis=(1, 2), initial=0.0)
            coarse |= change > _RIPPLE * np.diff(curve.breaks) / 4
        return coarse

    def _errors(self, curve: CubicPath) -> Array:
        """Return the largest error of each task along a curve, shape (tasks,).

        Raises:
            NotFollowedError: if a task that is not relaxed is missed.
        """
        s, q = _points(curve, (np.arange(_POINTS) + 0.5) / _POINTS)
        tasks = self.path.at(s)
        errors = TaskRows(self.pepper, tasks, len(s), [1.0] * len(tasks)).errors(q)
        for k, task in enumerate(tasks):
            worst = int(np.argmax(errors[:, k]))
            if errors[worst, k] > task.tolerance and k not in self._relaxed:
                missed = self.path.at_one(s[worst])[k].shortfall(self.pepper, q[worst])
                message = f"{self.path.words(s[worst])} {missed}."
                raise NotFollowedError(FollowStatus.OUT_OF_REACH, message, s[worst] / self.path.length)
        return np.asarray(errors.max(axis=0))

    def _is_clear(self, curve: CubicPath) -> bool:
        return is_clear_along(self.checks, curve, (self.margin, 0.0), held=False)

    def _kept_apart(self, start: Array, bodies: bool) -> PathBarriers:
        """Return penalties that keep a path from contact, with or without distances between bodies."""
        efforts = np.full(self.pepper.n, np.inf) if self.limits.torque is None else self.limits.torque
        efforts = np.where(efforts > 0, efforts, np.inf)
        checker = self.checks.exact if bodies else None
        return PathBarriers(self.pepper, efforts, self.limits.loads, checker, self.margin, start)

    def _around(self, start: Array, curve: CubicPath) -> CubicPath:
        """Return a curve that touches nothing, in place of one that does.

        First penalties keep near bodies apart, with more nodes at contacts; then the curve is pulled with
        increasing weights to a sequence of clear postures.

        Raises:
            NotFollowedError: if no clear curve is found, naming the contact of the first curve.
        """
        path, shares = self.path, np.arange(_POINTS) / _POINTS
        s, q = _points(curve, shares)
        hit = ~self.checks.free(q, self.margin)
        first = int(np.argmax(hit))
        fault = fault_of(self.checks.exact, q[first], "robot there", self.statics)
        said = fault[1] if fault is not None else "the margin would not be kept."
        message = f"{path.words(s[first])}: {said}"
        failed = NotFollowedError(FollowStatus.IN_COLLISION, message, s[first] / path.length)
        self._barriers = self._kept_apart(start, True)
        for _ in range(_SPLIT):
            pieces = np.unique(np.flatnonzero(hit) // _POINTS) if hit.any() else np.arange(len(s) // _POINTS)
            middles = (curve.breaks[pieces] + curve.breaks[pieces + 1]) / 2
            nodes = np.union1d(curve.breaks[: len(curve.breaks) - path.closed], middles)
            try:
                curve = self._curve(start, (nodes, _at(curve, nodes)))
            except NotFollowedError:
                break
            if self._is_clear(curve):
                return curve
            s, q = _points(curve, shares)
            hit = ~self.checks.free(q, self.margin)
        nodes = np.union1d(path.nodes(), s[:: _POINTS // 2])
        try:
            chain = self._chained(start, nodes, path.scene.padded(self.margin + 0.002))
        except NotFollowedError:
            raise failed from None
        for nearness in _DRAWN:
            try:
                found = self._curve(start, None, lambda at: _linear(at, nodes, chain), nearness)
            except NotFollowedError:
                continue
            if self._is_clear(found):
                return found
        raise failed

    def _motion(self, curve: CubicPath, ramps: bool) -> Trajectory:
        """Return the motion along a curve.

        Raises:
            NotFollowedError: if limits forbid it.
        """
        pepper, speed = self.pepper, self.speed
        if ramps:
            try:
                return retime(pepper, curve, scene=self.path.scene, path_speed=speed, **self.options)
            except InfeasibleError as error:
                message = f"No motion along the path keeps the limits: {error.reason}."
                raise NotFollowedError(FollowStatus.NOT_HELD, message) from None
        assert speed is not None
        self._refuse_fast(curve, _points(curve, np.arange(_POINTS + 1) / _POINTS)[0])
        powers = speed ** np.arange(4.0)[:, None]
        motion = Trajectory(
            pepper.joint_names,
            curve.breaks / speed,
            curve.coefficients * powers,
            joint_units=pepper.joint_units,
        )
        shares = {k: v for k, v in self.options.items() if k != "gridpoints"}
        certificate = motion.check(pepper, self.path.scene, **{"balance": None, **shares})
        if not certificate.success:
            broken = ", ".join(certificate.failures)
            message = f"With its own timing the motion does not keep the limits of {broken}."
            raise NotFollowedError(FollowStatus.NOT_HELD, message)
        return motion

    def _slowest(self, curve: CubicPath, motion: Trajectory) -> float:
        """Return the minimum speed, relative to the requested one; see `Followed.slowest`.

        Raises:
            NotFollowedError: if the speed cannot be kept.
        """
        assert self.speed is not None
        s = grid_parameters(curve, self.options.get("gridpoints", 200))
        rate = np.diff(s) / np.diff(motion.knots) / self.speed
        laps = np.arange(0.0, curve.breaks[-1] + self.path.length / 2, self.path.length)[:, None]
        rests = np.isin(s, [0.0, *(laps + self.path.corners).ravel(), curve.breaks[-1]])
        least, ends = 1.0, np.flatnonzero(rests)
        for a, b in pairwise(ends):
            own, places = rate[a:b], s[a:b]
            fast = np.flatnonzero(own >= _CRUISING)
            # If the speed is never reached, limits may forbid it anywhere; on ramps, where the speed falls.
            slow = np.full(len(own), True)
            if fast.size:
                first, last = fast[0], fast[-1]
                least = min(least, float(own[first : last + 1].min()))
                slow[first : last + 1] = own[first : last + 1] < _CRUISING
                for ramp in (slice(first), slice(len(own) - 1, last, -1)):
                    slow[ramp] = own[ramp] < _EVEN * np.maximum.accumulate(own[ramp])
            if slow.any():
                self._refuse_fast(curve, places[slow])
        return least

    def _refuse_fast(self, curve: CubicPath, s: Array) -> None:
        """Refuse a speed that limits forbid at parameters, shape (k,), where the speed is constant.

        Raises:
            NotFollowedError: with the worst place of the path, its joint and limit, and the speed that it
                allows.
        """
        assert self.speed is not None
        if max(share.max() for share in self._shares(curve, s).values()) <= 1.0 + 1e-6:
            return
        places = _points(curve, np.arange(_POINTS + 1) / _POINTS)[0]
        shares = self._shares(curve, places)
        what = max(shares, key=lambda name: float(shares[name].max()))
        k, j = np.unravel_index(int(np.argmax(shares[what])), shares[what].shape)
        most, name = self.speed / shares[what][k, j], self.pepper.joint_names[j]
        message = f"{self.path.words(places[k])} the {what} limit of {name} allows a speed of {most:.3g}."
        reached = places[k] / curve.breaks[-1]
        raise NotFollowedError(FollowStatus.TOO_FAST, message, reached, joint=int(j))

    def _shares(self, curve: CubicPath, s: Array) -> dict[str, Array]:
        """Return the factor by which each joint has to be slower at parameters, (k,), by kind of limit."""
        assert self.speed is not None
        piece = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
        q, first, second = (curve.at(piece, s - curve.breaks[piece], d) for d in range(3))
        velocity, acceleration = first * self.speed, second * self.speed**2
        shares = {
            "velocity": share_of(np.abs(velocity), self.limits.velocity),
            "acceleration": np.sqrt(share_of(np.abs(acceleration), self.limits.acceleration)),
        }
        if self.limits.torque is not None:
            quantities, count = quantities_of(self.pepper, self.limits), self.pepper.n
            still = quantities.torque(q, 0.0 * velocity, 0.0 * velocity)[:, :count]
            more = quantities.torque(q, velocity, acceleration)[:, :count] - still
            room = np.where(more > 0, self.limits.torque - still, self.limits.torque + still)
            shares["torque"] = np.sqrt(np.abs(more) / np.maximum(room, 1e-9))
        return shares


def _is_equation(task: Task) -> bool:
    return bool(np.isfinite(task.tolerance)) and not task.largest


def _as_path(spline: Any) -> CubicPath:
    coefficients = np.zeros((len(spline.x) - 1, 4, spline.c.shape[2]))
    coefficients[:, : len(spline.c)] = spline.c[::-1].swapaxes(0, 1)
    return CubicPath(spline.x, coefficients)


def _repeated(curve: CubicPath, laps: int) -> CubicPath:
    """Return a closed curve several times."""
    if laps == 1:
        return curve
    breaks = [curve.breaks[:1], *(curve.breaks[1:] + lap * curve.breaks[-1] for lap in range(laps))]
    return CubicPath(np.concatenate(breaks), np.tile(curve.coefficients, (laps, 1, 1)))


def _points(curve: CubicPath, shares: Array) -> tuple[Array, Array]:
    """Return parameters, shape (k,), and joint positions, shape (k, n), at fractions of all pieces."""
    steps = np.diff(curve.breaks)
    local, piece = (steps[:, None] * shares).ravel(), np.repeat(np.arange(len(steps)), len(shares))
    return curve.breaks[piece] + local, curve.at(piece, local)


def _at(curve: CubicPath, s: Array) -> Array:
    """Return joint positions at parameters, shape (k, n)."""
    piece = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
    return curve.at(piece, s - curve.breaks[piece])


def _linear(s: Array, nodes: Array, postures: Array) -> Array:
    """Return postures, shape (K, n), interpolated linearly between nodes, and the last one beyond them."""
    return np.stack([np.interp(s, nodes, column) for column in postures.T], axis=1)


def _excess(curve: CubicPath, pepper: PepperModel) -> Array:
    """Return the excess of each joint over its limits on each piece of a curve [rad or m], shape (m, n)."""
    steps = np.diff(curve.breaks)
    piece, joint, local = turning_points(steps, curve.coefficients)
    ends = curve.at(np.arange(len(steps)), steps)
    found = np.maximum(pepper.lower_limits - ends, ends - pepper.upper_limits)
    turns = curve.at(piece, local)[np.arange(len(piece)), joint]
    outside = np.maximum(pepper.lower_limits[joint] - turns, turns - pepper.upper_limits[joint])
    np.maximum.at(found, (piece, joint), outside)
    return found
