"""Splices: replacing the goal of a motion while the robot moves, if possible without a stop."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import collision
from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.curve_checks import curve_checks_for
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.core.timing.steering import bridge, steer
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, optional
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.trajectory.limits import JerkLike, jerk_limits, motion_limits
from pepper_kin.trajectory.path import CubicPath
from pepper_kin.trajectory.samples import (
    EXAMINED_EVERY,
    TIME_TOLERANCE,
    State,
    refuse_other_joints,
    sample_times,
)
from pepper_kin.trajectory.stop import (
    checked_instant,
    first_exceeded,
    joined_phases,
    like,
    limits_of,
    stop_within,
)

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory

_SAME_TIME = 1e-12  # [s]
_ROUNDING = 1e-12
_SAME = 1e-9  # difference up to which two positions are equal [rad or m]
_LEAVES = np.array([0.0, 0.4, 0.7, 0.9])  # fractions of a stop at which the robot may leave for a motion
_JOINS = 8  # number of instants at which the robot may join the other motion
_LONGEST = 2.0  # maximum duration of the bridge between two motions [s]
_SPARE = 0.97  # fraction of the acceleration with which a limit would just be kept
_LESS, _TRIALS = 0.7, 10  # factor on accelerations if no joint is to blame, and maximum number of trials
_LEAST = 0.04  # minimum fraction of acceleration limits for a bridge between two motions
_DOUBTFUL = 0.15  # fraction of acceleration limits below which stopping first may be faster
_SLOW = 0.25  # minimum fraction of all acceleration limits tried to avoid contact


def load_ruckig() -> Any:
    """Return the package `ruckig`.

    Raises:
        MissingDependencyError: if ruckig is not installed.
    """
    return optional("ruckig", command="pip install 'ruckig>=0.14'", need="online motion")


def steer_with_jerk(now: State, target: State, limits: tuple[Array, ...]) -> tuple[Array, Array]:
    """Return the motion from one state to another in which all joints arrive together.

    Each joint is planned as fast as possible by itself, and slowed to the slowest (Berscheid and Kroeger,
    Jerk-limited real-time trajectory generation with arbitrary target states, RSS 2021; by the package
    `ruckig`, in this process).  A joint that begins beyond a limit first returns within it.

    Args:
        now: Initial state, shape (n,) each.
        target: Final state, shape (n,) each.
        limits: Limits of velocity, acceleration and jerk, finite, shape (n,) each.

    Returns:
        Breaks [s], shape (m + 1,), and cubics, constant term first, shape (m, 4, n), between the instants at
        which any joint changes its jerk; m = 0 where the states are the same.

    Raises:
        InfeasibleError: for a target that cannot be reached within the limits.
    """
    ruckig, n = load_ruckig(), now.position.size
    asked = ruckig.InputParameter(n)
    asked.current_position, asked.current_velocity, asked.current_acceleration = map(np.ndarray.tolist, now)
    asked.target_position, asked.target_velocity, asked.target_acceleration = map(np.ndarray.tolist, target)
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = map(np.ndarray.tolist, limits)
    asked.synchronization = ruckig.Synchronization.Time
    found = ruckig.Trajectory(n)
    try:
        result = ruckig.Ruckig(n).calculate(asked, found)
    except Exception as error:  # the package's own exception class is not always raised
        raise InfeasibleError("motion", str(error), "choose another target") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise InfeasibleError("motion", f"ruckig says {result}", "choose another target")
    return _cubics(found, now, limits[2])


def _cubics(found: Any, now: State, most: Array) -> tuple[Array, Array]:
    """Return ruckig's motion as breaks and cubics: its accelerations, integrated from the start."""
    changes = [0.0, float(found.duration)]
    for profile in found.profiles[0]:
        brake = [0.0, *np.cumsum(profile.brake.t)] if hasattr(profile, "brake") else [0.0]
        changes += brake
        changes += list(brake[-1] + np.cumsum(profile.t))
    if found.duration <= _SAME_TIME:
        return np.zeros(1), np.empty((0, 4, now.position.size))
    # Keep both ends: a braking phase before the motion may last 1e-16 s.
    inside = np.unique(changes)
    inside = inside[(inside > _SAME_TIME) & (inside < found.duration - _SAME_TIME)]
    inside = inside[np.diff(inside, prepend=0.0) > _SAME_TIME]
    times = np.concatenate([[0.0], inside, [found.duration]])
    h = np.diff(times)[:, None]
    a = np.array([found.at_time(time)[2] for time in times[1:].tolist()])
    a = np.concatenate([now.acceleration[None], a])
    jerk, a = np.clip(np.diff(a, axis=0) / h, -most, most), a[:-1]  # above the limit only by rounding
    v = now.velocity + np.cumsum(h * (a + h * jerk / 2), axis=0)
    v = np.concatenate([now.velocity[None], v[:-1]])
    q = now.position + np.cumsum(h * (v + h * (a / 2 + h * jerk / 6)), axis=0)
    q = np.concatenate([now.position[None], q[:-1]])
    return times, np.stack([q, v, a / 2, jerk / 6], axis=1)


@dataclass(frozen=True)
class Splice(BriefRepr):
    """A motion with a new goal from an instant on.

    Attributes:
        trajectory: The original motion until the instant, and from there the motion to the goal.
        how: "straight"; "joined" to another motion in motion; or "after a stop".
        time: Time of the instant [s].
        share: Minimum over the joints of the fraction of the acceleration limit allowed on the way to the
            goal or to the other motion; joints that need more to stop within their position limits do not
            count.
    """

    trajectory: Trajectory
    how: str
    time: float
    share: float


def replaced(
    pepper: PepperModel,
    trajectory: Trajectory,
    at: float,
    goal: ArrayLike | Trajectory,
    *,
    scene: Scene | None = None,
    torque: bool = True,
    torque_scale: TorqueScale = "robot",
    balance: Balance = "robot",
    jerk: JerkLike | None = None,
) -> Splice:
    """Return a motion with a new goal from an instant on; see `Trajectory.replaced`."""
    moving = MovingStart(
        pepper, trajectory, at, scene, torque, torque_scale=torque_scale, balance=balance, jerk=jerk
    )
    if isinstance(goal, type(trajectory)):
        refuse_other_joints(pepper, goal.joint_names)
        joined = moving.onto(goal)
        if joined is None:
            reason = "neither in motion nor after a stop does the robot get onto the other one"
            raise InfeasibleError("splice", reason, "a motion that begins where `stop` ends")
        return joined
    end = np.array(as_joint_vector(pepper, cast("ArrayLike", goal), "goal"))
    check_within_limits(pepper, end, "goal", 1e-9)
    exceeded: list[str] = []
    found = moving.straight(end, exceeded)
    if found is None or found.share < _DOUBTFUL:
        try:
            ways = [way for way in (found, moving.after_stop(end)) if way is not None]
        except InfeasibleError:  # it cannot stop
            if found is None:
                raise
            ways = [found]
        found = min(ways, key=lambda way: way.trajectory.duration, default=None)
    if found is None:
        reason = f"straight to the goal it would exceed {', '.join(exceeded)}, and after a stop too"
        raise InfeasibleError("splice", reason, "`pepper_kin.motion.replan`")
    return found


class MovingStart:
    """A robot in motion at an instant, and the motions that can follow.

    Args:
        pepper: The robot.
        trajectory: The robot's motion.
        at: Time of the instant [s].
        scene: The world; None to leave collisions out.
        torque: Whether torque is limited.
        torque_scale: Fraction of the effort limits to use, in (0, 1], or "robot".
        balance: Distance that the zero-moment point keeps from the triangle's edges [m], "robot", or None.
        payload: Point masses held at "left", "right" or a frame by name [kg].
        margins: Distances to the scene and of the robot to itself that all motions but the stop keep [m].
        jerk: Jerk limits as `retime` takes them; with them, new motions start with the current acceleration.
    """

    def __init__(
        self,
        pepper: PepperModel,
        trajectory: Trajectory,
        at: float,
        scene: Scene | None,
        torque: bool = True,
        *,
        torque_scale: TorqueScale = "robot",
        balance: Balance = "robot",
        payload: Mapping[str, float] | None = None,
        margins: tuple[float, float] = (0.0, 0.0),
        jerk: JerkLike | None = None,
    ) -> None:
        refuse_other_joints(pepper, trajectory.joint_names)
        self.pepper, self.trajectory, self.scene = pepper, trajectory, scene
        if scene is not None and scene.movers:
            still = "obstacles that stand, as of scene.at(time); or `motion.LiveMotion`"
            raise InvalidValueError("scene", f"{scene.movers[0].name!r} moving", still)
        self.at, self._margins = checked_instant(trajectory, at), margins
        allowed = motion_limits(
            pepper, torque=torque, torque_scale=torque_scale, balance=balance, payload=payload, scene=scene
        )
        self.limits = limits_of(pepper, allowed)
        needed, words = [self.limits.velocity, self.limits.acceleration], "velocity and acceleration"
        if jerk is not None:
            rates = jerk_limits(pepper, jerk)
            self.limits = replace(self.limits, jerk=rates)
            needed, words = [*needed, rates], "velocity, acceleration and jerk"
        if not np.isfinite(needed).all():
            raise InvalidValueError("limits", "none for some joint", f"finite limits of {words}")
        self.state: Array = self._at(trajectory, np.array([self.at]))[0]

    @cached_property
    def stopped(self) -> Trajectory | None:
        """The stop along the motion; None if it touches something, examined every millisecond.

        If no stop along the motion keeps the limits, each joint brakes by itself; None if that exceeds limits
        other than position.  If the stop ends beyond position limits, the robot is steered to the nearest
        position within them.

        Raises:
            InfeasibleError: if the motion cannot be stopped along its path.
        """
        pepper, motion = self.pepper, self.trajectory
        stop = stop_within(pepper, motion, self.at, self.limits)
        if stop.exceeded:
            stop = stop_within(pepper, motion, self.at, self.limits, "joints")
        if stop.exceeded and set(stop.exceeded) != {"position"}:
            return None
        found = stop.trajectory
        end = np.clip(found.end, pepper.lower_limits, pepper.upper_limits)
        if np.abs(end - found.end).max() > _SAME:
            steered = self._steered(self.state, end, [])
            return None if steered is None else steered[0]
        if self.scene is None:
            return found
        states = found(sample_times(found.duration, EXAMINED_EVERY)).position
        touches = collision.in_collision(self.pepper, states, checked_world(self.scene))
        return None if touches.any() else found

    def straight(self, goal: Array, exceeded: list[str], least: float = _SLOW) -> Splice | None:
        """Return the motion of each joint by itself to rest at a goal; None adds the exceeded limits' names.

        A motion that touches something is tried slower, down to a fraction `least` of the acceleration
        limits.
        """
        found = self._steered(self.state, goal, exceeded, least)
        return None if found is None else self._spliced("straight", found[1], found[0])

    def after_stop(self, goal: Array) -> Splice | None:
        """Return the stop, and from its end the motion of each joint by itself to rest at a goal."""
        if self.stopped is None:
            return None
        if np.abs(self.stopped.end - goal).max() <= _SAME:
            return self._spliced("after a stop", 1.0, self.stopped)
        rest = np.stack([self.stopped.end, *np.zeros((len(self.state) - 1, goal.size))])
        found = self._steered(rest, goal, [])
        return None if found is None else self._spliced("after a stop", found[1], self.stopped, found[0])

    def onto(self, other: Trajectory) -> Splice | None:
        """Return the bridge onto another motion and the rest of that motion, the soonest to end of all tried.

        The robot leaves now or during a stop, and arrives with the other motion's velocity.  If no bridge was
        found, and the other motion begins where the stop ends, the robot stops first.
        """
        stopped = self.stopped
        leaves = np.zeros(1) if stopped is None else _LEAVES * stopped.duration
        joins = np.linspace(0.0, other.duration, _JOINS + 1)[1:]
        targets = self._at(other, joins)
        starts = self.state[None] if stopped is None else self._at(stopped, leaves)
        meets = stopped is not None and np.abs(stopped.end - other.start).max() <= _SAME
        most = stopped.duration if meets and stopped is not None else _LONGEST
        full = np.ones(self.pepper.n)
        ways: list[tuple[float, int, int, Array]] = []

        def bridged(i: int, k: int, share: Array) -> tuple[float, Callable[[], Trajectory]]:
            longest = min(most + joins[k] - leaves[i], _LONGEST)
            try:
                return self._bridged(starts[i], targets[k], share, longest)
            except InfeasibleError:  # raised for jerk limits
                return 0.0, lambda: other

        for i, k in itertools.product(range(leaves.size), range(_JOINS)):
            if time := bridged(i, k, full)[0]:
                ways.append((leaves[i] + time - joins[k], i, k, full))
        heapify(ways)
        while ways:
            _, i, k, share = heappop(ways)
            between = bridged(i, k, share)[1]()
            exceeded, used = self._exceeded(between)
            if not exceeded:
                first = () if i == 0 or stopped is None else (stopped.between(0.0, leaves[i]),)
                last = () if k == _JOINS - 1 else (other.between(joins[k], other.duration),)
                return self._spliced("joined", float(share.min()), *first, between, *last)
            before, share = share, self._slower(share, used)
            if (
                {"clearance", "position", "velocity"} & set(exceeded)
                or share.min() < _LEAST
                or not (share < before).any()
            ):
                continue
            if time := bridged(i, k, share)[0]:
                heappush(ways, (leaves[i] + time - joins[k], i, k, share))
        return self._spliced("after a stop", 1.0, stopped, other) if meets and stopped is not None else None

    def _spliced(self, how: str, share: float, *parts: Trajectory) -> Splice:
        """Return the original motion until the instant, followed by parts."""
        whole = (
            parts[0] if self.at <= TIME_TOLERANCE else self.trajectory.between(0.0, self.at).then(parts[0])
        )
        for part in parts[1:]:
            whole = whole.then(part)
        return Splice(whole, how, self.at, share)

    def _steered(
        self, state: Array, goal: Array, exceeded: list[str], least: float = _SLOW
    ) -> tuple[Trajectory, float] | None:
        """Return the motion from a state to rest at a goal, and its fraction of acceleration limits."""
        pepper, limits, (position, velocity) = self.pepper, self.limits, state[:2]
        # A joint stays between its start, its goal and the position where it first stops.
        room = np.where(velocity > 0.0, pepper.upper_limits - position, position - pepper.lower_limits)
        needed = velocity**2 / (2 * limits.acceleration * np.maximum(room, 0.0) + _ROUNDING)
        if needed.max() > 1.0:
            exceeded.append("position")
            return None
        share = np.ones(goal.size)
        for _ in range(_TRIALS):
            try:
                motion = self._to_rest(state, goal, np.maximum(share, needed))
            except InfeasibleError:  # raised for jerk limits
                exceeded.append("jerk")
                return None
            names, used = self._exceeded(motion)
            if not names:
                return motion, float(share.min())
            exceeded += [name for name in names if name not in exceeded]
            share = self._slower(share, used)
            if {"position", "velocity"} & set(names) or ("clearance" in names and share.max() < least):
                break
        return None

    def _to_rest(self, state: Array, goal: Array, share: Array) -> Trajectory:
        """Return the motion from a state to rest with fractions of the acceleration limits, shape (n,)."""
        limits, phases = self.limits, np.empty((goal.size, 3, 4))
        if limits.jerk is not None:
            rest = np.stack([goal, *np.zeros((2, goal.size))])
            time, made = self._bridged(state, rest, share, np.inf)
        else:
            allowed = np.stack([limits.velocity, share * limits.acceleration])
            time = steer(state, goal, allowed, phases)
            made = partial(joined_phases, self.trajectory, state[0], phases)
        if time <= _ROUNDING:
            raise InvalidValueError("goal", "the position where the robot rests", "another one")
        return made()

    def _bridged(
        self, start: Array, target: Array, share: Array, longest: float
    ) -> tuple[float, Callable[[], Trajectory]]:
        """Return the duration of the bridge between two states, 0 for none, and a function that returns it.

        Args:
            start: Initial state, as `_at` returns it, shape (2 or 3, n).
            target: Final state, shape (2 or 3, n).
            share: Fractions of the acceleration limits to use, shape (n,).
            longest: Maximum duration [s].
        """
        pepper, most = self.pepper, share * self.limits.acceleration
        if self.limits.jerk is not None:
            each = (self.limits.velocity, most, self.limits.jerk)
            breaks, pieces = steer_with_jerk(State(*start), State(*target), each)
            time = float(breaks[-1])
            return time * (time <= longest), lambda: like(self.trajectory, breaks, pieces)
        phases = np.empty((pepper.n, 3, 4))
        limits = np.stack([self.limits.velocity, most, pepper.lower_limits, pepper.upper_limits])
        time = bridge(start, target, limits, longest, phases)
        return time, partial(joined_phases, self.trajectory, start[0], phases)

    def _at(self, motion: Trajectory, times: Array) -> Array:
        """Return position, velocity and, with jerk limits, acceleration at times [s], (T, 2 or 3, n)."""
        return np.stack(motion(times)[: 2 if self.limits.jerk is None else 3], axis=1)

    def _exceeded(self, motion: Trajectory) -> tuple[tuple[str, ...], Array]:
        """Return names of limits that a cubic motion exceeds, and accelerations that would keep them."""
        names: tuple[str, ...] = ()
        used = np.full(self.pepper.n, np.inf)
        if self.limits.jerk is not None:  # steering ignores position limits, and may begin too fast to brake
            rates = np.zeros_like(motion.coefficients)
            rates[:, :3] = motion.coefficients[:, 1:] * np.arange(1.0, 4.0)[:, None]
            speed = np.abs(CubicPath(motion.breaks, rates).extremes())
            points = CubicPath(motion.breaks, motion.coefficients).extremes()
            outside = np.maximum(points - self.pepper.upper_limits, self.pepper.lower_limits - points)
            names = ("position",) * bool(outside.max() > _SAME)
            names += ("velocity",) * bool((speed > self.limits.velocity * (1.0 + _SAME) + _SAME).any())
        if not names:
            names, used = first_exceeded(self.pepper, motion, self.limits)
        if not names and self.scene is not None:
            checks = curve_checks_for(self.pepper, checked_world(self.scene))
            strictly = max(self._margins) > 0.0
            clear = is_clear_along(checks, motion, self._margins, held=False, strictly=strictly)
            names = () if clear else ("clearance",)
        return names, used

    def _slower(self, share: Array, used: Array) -> Array:
        """Return smaller fractions of acceleration limits, shape (n,), for joints to blame, or for all."""
        if np.isinf(used).all():
            return _LESS * share
        return np.where(np.isfinite(used), np.minimum(share, _SPARE * used / self.limits.acceleration), share)
