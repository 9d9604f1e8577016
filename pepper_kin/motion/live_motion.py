"""Motion in a changing world: the command of each cycle ends in a stop that is free of collision."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision import Scene, in_collision
from pepper_kin.collision.checked_world import ROBOT_ALONE, checked_world
from pepper_kin.collision.checker import RANGE_RADIUS
from pepper_kin.collision.fast import FastChecker, fast_checker_for
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.collision.movers import Movers, movers_of
from pepper_kin.collision.solids import not_negative
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, PepperKinError
from pepper_kin.ik.problem import moved_aside
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, as_real, check_positive, check_within_limits
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.checks import LEAST_MARGIN
from pepper_kin.motion.follow_result import words_for_aside
from pepper_kin.motion.margins import own_margin
from pepper_kin.motion.sliced_search import SlicedSearch
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Stop, Trajectory
from pepper_kin.trajectory.active_limits import stretch_at_extremes
from pepper_kin.trajectory.limits import motion_limits
from pepper_kin.trajectory.samples import TIME_TOLERANCE, State, refuse_other_joints
from pepper_kin.trajectory.stop import limits_of, stop_within

COMMITTED = 2
"""Number of cycles for which the robot continues its motion before the stop that it was sent begins."""

_STEP = 0.0025  # time between states that are checked [s]
_STILL = 0.003  # margin to static obstacles and own parts at states 2.5 ms apart [m]
_BRANCH = 0.15  # time until a motion leaves its way for a way still to be planned [s]
_LOOKS_AHEAD = (0.5, 1.0, 0.2, 2.0)  # times for which moving obstacles are predicted, in successive plans [s]
_LAG = 0.3  # maximum lag of the measured state behind the command [s]
_SLOWEST = 20.0  # maximum slow-down of a given way
_SAME = 1e-6  # [rad or m]
_AT_GOAL = 1e-9  # [rad or m]
_INSTANT = 1e-3  # [s]
_ASIDE = "which does not step aside: set a goal out of the way, or stop what comes"
_LOOKED_AT = 60  # number of states of a way at which joints that move aside are determined
_HIGHEST = 12  # maximum number of polynomial coefficients of a way along which further stops are computed


class LiveStatus(ResultStatus):
    """Status of a live motion."""

    REACHED = "reached", "The robot stands at the goal: set another one."
    MOVING = "moving", "The robot goes to the goal: call `step` again in time."
    STOPPING = "stopping", "The robot brakes, for the reason given: go on calling `step`."
    WAITING = "waiting", "The robot stands until its way is free: go on calling `step`, or set another goal."
    HALTED = "halted", "The robot stays where it stops: mend the reason given, and begin a new motion there."


@dataclass(frozen=True)
class LiveState(BriefRepr):
    """Command of one cycle.

    Attributes:
        trajectory: Motion from `begin` on: committed for two cycles, then the stop.  Without a newer command,
            the robot comes to rest along it.
        begin: Start time of the trajectory on the caller's clock [s].
        status: Status of the motion.
        reason: Why the robot does not go to the goal, or what approaches it at rest; else empty.
        near: Names of the two bodies that come too near, if that is a reason; else empty.
        stop: The stop in the trajectory; None at rest.
        clear: Whether the whole trajectory is clear of the newest scene.
        spent: Processor time of the cycle [s].
        searching: Whether a search was paused, to continue in the next cycle.
        aside: Joints that the goal does not move but that move to avoid collisions, such as "HeadYaw by 0.12
            rad".
    """

    trajectory: Trajectory
    begin: float
    status: LiveStatus
    reason: str
    near: tuple[str, ...]
    stop: Stop | None
    clear: bool
    spent: float
    searching: bool = False
    aside: tuple[str, ...] = ()

    def report(self) -> str:
        """Return the state in plain words."""
        why = f": {self.reason}" if self.reason else ""
        return f"{self.status.value}{why}.{words_for_aside(self.aside)} {self.status.advice}"

    def at(self, now: float) -> State:
        """Return position, velocity and acceleration at a time on the caller's clock [s], shape (n,) each."""
        local = min(max(now - self.begin, 0.0), self.trajectory.duration)
        found = self.trajectory(local)
        if now - self.begin > self.trajectory.duration:
            still = np.zeros_like(found.position)
            return State(found.position, still, still)
        return State(*found)


class _World:
    """A scene, and its collision checkers, created at their first use."""

    def __init__(self, pepper: PepperModel, scene: Scene) -> None:
        self.pepper, self.scene = pepper, scene

    @cached_property
    def standing(self) -> FastChecker:
        """Checker of the robot with itself and static obstacles."""
        return fast_checker_for(self.pepper, self.scene.standing, _STILL, 0.0)

    @cached_property
    def moving(self) -> tuple[tuple[Movers, FastChecker], ...]:
        """Groups of moving obstacles, each with a checker of the robot with the group."""
        groups = movers_of(self.pepper, self.scene)
        return tuple((movers, fast_checker_for(movers.robot, movers.scene)) for movers in groups)


class LiveMotion:
    """A robot's motion to changing goals among moving obstacles.

        live = LiveMotion(pepper, start, scene)
        live.set_goal(goal)
        while True:
            live.set_scene(seen, seen_at)
            state = live.step(now())
            command(state.at(now()).position)

    In every cycle the motion is checked against the newest scene: the two committed cycles and the stop after
    them, with a margin that grows by the obstacles' uncertainty; and the rest of the way, up to the horizon,
    with the obstacles' predicted positions.  If the committed part is not clear, the robot follows the stop
    of the previous cycle, which was clear.  The way goes straight to the goal from the current motion
    (`Trajectory.replaced`), or is planned from where the robot can stop: a search pauses when the cycle's
    budget is used up, and continues in the next cycle.  A robot at rest does not step aside.  States every
    2.5 ms keep 3 mm from static obstacles and between the robot's own parts; between own parts, half the
    distance at start and goal if that is less, and still less if only a planned way leads to the goal.

    Args:
        pepper: The robot, whose limits are kept; `PepperModel.with_limits` returns a more careful one.
        start: Joint positions at rest [rad or m], shape (n,).
        scene: The world, which does not expire if given here; None for the robot alone.
        rate: Rate of cycles [1/s].
        horizon: Time ahead for which the way is checked, and maximum age of a scene [s].
        margin: Distance kept from moving obstacles, in addition to their uncertainty [m].
        delay: Maximum delay of the robot behind the command [s]; obstacles may move in that time.
        tolerance: Maximum deviation of a measured joint position from the motion [rad or m].
        torque: Whether torques are kept within their limits.
        torque_scale: Fraction of the effort limits to use, in (0, 1]; "robot" for the robot's requirement.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement; None to leave balance out.
        budget: Search time of a cycle [s]; None for a tenth of a cycle.

    Attributes:
        pepper: The robot.

    Raises:
        InvalidValueError: for an argument out of range, or a start in contact.
        LimitError: for a start outside the limits.
    """

    def __init__(
        self,
        pepper: PepperModel,
        start: ArrayLike,
        scene: Scene | None = None,
        *,
        rate: float = 30.0,
        horizon: float = 1.0,
        margin: float = 0.01,
        delay: float = 0.0,
        tolerance: float = 0.2,
        torque: bool = True,
        torque_scale: TorqueScale = "robot",
        balance: Balance = "robot",
        budget: float | None = None,
    ) -> None:
        self.pepper = pepper
        rest = np.array(as_joint_vector(pepper, start, "start"))
        check_within_limits(pepper, rest, "start", 1e-9)
        self._cycle = 1.0 / check_positive("rate", rate, "Hz")
        self._horizon, self._margin = (
            check_positive("horizon", horizon, "s"),
            check_positive("margin", margin, "m"),
        )
        self._delay = not_negative("delay", delay)
        self._tolerance = check_positive("tolerance", tolerance, "rad or m")
        budget = self._cycle / 10.0 if budget is None else check_positive("budget", budget, "s")
        self._reserve: dict[str, Any] = {"torque_scale": torque_scale, "balance": balance}
        self._limits: dict[str, Any] = {"torque": torque, **self._reserve}
        self._world, self._seen, self._ages = self._checked(scene), math.nan, False
        self._reach = motion_bounds(pepper)
        self._bounds = limits_of(pepper, motion_limits(pepper, **self._limits))
        self._goal: Array | None = None
        self._own, self._idle = _STILL, np.zeros(pepper.n, dtype=bool)
        self._aside: tuple[str, ...] = ()
        self._way, self._begin = _standing(pepper, rest), math.nan
        self._sent: tuple[Trajectory, Stop | None] = (self._way, None)
        self._committed, self._fault, self._blocked, self._braking = 0.0, "", "", False
        self._near: tuple[str, ...] = ()
        self._past: list[tuple[float, Trajectory]] = []
        self._unlimited = () if torque else ("torque",)
        self._given: Trajectory | None = None
        self._search = SlicedSearch(pepper, self._margin, budget, self._limits)
        self._branch: tuple[Trajectory, float] | None = None  # way to the searched motion's start; its time
        self._attempts = 0
        if bool(in_collision(pepper, rest, self._world.scene)):
            raise InvalidValueError("start", "a configuration in contact", "one that touches nothing")

    @property
    def goal(self) -> Array | None:
        """Goal configuration [rad or m], shape (n,); None if there is no goal."""
        return self._goal

    @property
    def trajectory(self) -> Trajectory:
        """Trajectory of the last cycle; an instant of rest before the first cycle."""
        return self._sent[0]

    def set_goal(self, goal: ArrayLike | None, way: Trajectory | None = None) -> None:
        """Set the goal, or None to stop.

        Args:
            goal: Goal configuration [rad or m], shape (n,).
            way: A motion that ends at the goal, preferably one that begins where the robot is.  The robot
                follows it, slowed down to velocity and acceleration limits, if it is clear in the next cycle
                and keeps the other limits; a robot in motion joins it.  Otherwise, and after a stop, the live
                motion finds its own way.

        Raises:
            InvalidValueError: for a wrong shape, NaN, or a way of other joints or that ends elsewhere.
            LimitError: for a goal outside the limits.
        """
        if goal is not None:
            goal = np.array(as_joint_vector(self.pepper, goal, "goal"))
            check_within_limits(self.pepper, goal, "goal", 1e-9)
        self._given = None if way is None or goal is None else self._within_limits(way, goal)
        self._goal, self._attempts, self._branch = goal, 0, None
        rest, ends = self.trajectory.end, [] if goal is None else [goal]
        self._aside, self._idle = (), np.abs((rest if goal is None else goal) - rest) <= _SAME
        if _stands(self._way):
            self._own, ends = _STILL, [rest, *ends]
        self._own = own_margin(self._world.standing.exact, ends, self._own)

    def _within_limits(self, way: Trajectory, goal: Array) -> Trajectory | None:
        """Return a way to a goal, shape (n,), slowed down to keep all limits; None if that is impossible."""
        refuse_other_joints(self.pepper, way.joint_names)
        if not _is_at(way.end, goal):
            raise InvalidValueError("way", "one that ends elsewhere", "one that ends at the goal")
        stretch = stretch_at_extremes(way, self._bounds)
        if not stretch < _SLOWEST:
            return None
        slow = way.scaled(stretch)
        found = slow.check(self.pepper, collisions=False, **self._reserve)
        return None if set(found.failures) - set(self._unlimited) else slow

    def set_scene(self, scene: Scene | None, time: float) -> None:
        """Set the world as observed at a time on the caller's clock [s], which is the scene's time 0.

        Raises:
            InvalidValueError: for another type, attached objects with mass, or a time that is not finite.
        """
        seen = as_real(time)
        if not math.isfinite(seen):
            raise InvalidValueError("time", time, "a finite time [s]")
        self._world, self._seen, self._ages = self._checked(scene), seen, True

    def _checked(self, scene: Scene | None) -> _World:
        """Return a scene for checks; refuse attached masses, which torques do not count."""
        world = checked_world(scene) or ROBOT_ALONE
        heavy = [name for name, held in world.attached.items() if held.mass] if self._limits["torque"] else []
        if heavy:
            expected = "attached objects without mass, which torques are not computed for; or torque=False"
            raise InvalidValueError("scene", f"{', '.join(heavy)} with mass", expected)
        return _World(self.pepper, world)

    def set_state(self, q: ArrayLike, time: float) -> None:
        """Report measured positions [rad or m], shape (n,), at a time on the caller's clock [s].

        The robot is stopped and stays halted if the positions are not finite, or deviate by more than the
        tolerance from the motion at all times up to 0.3 s before.
        """
        measured = np.asarray(q, dtype=float)
        if measured.shape != (self.pepper.n,) or not np.isfinite(measured).all():
            self._fault = "the measured state is not finite numbers of all joints"
            return
        least, worst = math.inf, 0
        for begin, sent in self._past:
            times = np.linspace(time - _LAG, time, 13) - begin
            off = np.abs(sent(np.clip(times, 0.0, sent.duration)).position - measured)
            nearest = int(off.max(axis=1).argmin())
            if off[nearest].max() < least:
                least, worst = float(off[nearest].max()), int(off[nearest].argmax())
        if self._past and least > self._tolerance:
            name = self.pepper.joint_names[worst]
            self._fault = f"{name} is {least:.3f} off the motion, tolerance {self._tolerance:g}"

    def step(self, now: float) -> LiveState:
        """Run one cycle at a time on the caller's clock [s], and return the robot's command."""
        began = time.thread_time()
        instant = as_real(now)
        if not math.isfinite(instant) or instant < self._begin:
            self._fault = self._fault or f"the clock says {now} s after {self._begin:.3f} s"
            instant = self._begin if math.isfinite(self._begin) else 0.0
        if not self._ages and math.isnan(self._seen):
            self._seen = instant
        self._come_to(instant)
        status, reason, clear = self._choose(instant)
        self._past = [*self._past[-40:], (instant, self._sent[0])]
        near = self._near if reason and reason == self._blocked else ()
        if _stands(self._sent[0]) and (comes := self._comes_near(instant)) is not None:
            when, near, words = comes
            reason, clear = "; ".join(filter(None, (words, reason))), clear and when > 0.0
        return LiveState(
            self._sent[0], instant, status, reason, near, self._sent[1], clear, time.thread_time() - began,
            self._branch is not None, self._aside,
        )  # fmt: skip

    def _comes_near(self, now: float) -> tuple[float, tuple[str, ...], str] | None:
        """Return the time until something comes too near to a robot at rest [s], names and words; or None."""
        self._blocked, self._near, q, when = "", (), self._sent[0].end, 0.0
        exact = self._world.standing.exact
        if self._world.standing.nearer(q[None], np.array([self._own])).any():
            pair = exact.closest_pair(q, "obstacles")
            if pair is not None and pair.distance <= _STILL:
                self._note(pair.names)
        if not self._near:
            times = np.linspace(0.0, self._horizon, math.ceil(self._horizon / _STEP) + 1)
            still = np.zeros((times.size, q.size))
            first = self._meets_movers(times, State(q + still, still, still), now, growing=False)
            when = 0.0 if first is None else float(times[first])
        if not self._near:
            return None
        soon = f" in {when:.2f} s" if when > 0.0 else ""
        return when, self._near, f"{self._blocked}{soon} while the robot stands, {_ASIDE}"

    def _come_to(self, now: float) -> None:
        """Cut off the past part of the way; the way is the stop if no cycle came in time."""
        here = max(now - self._begin, 0.0) if math.isfinite(self._begin) else 0.0
        if here > self._committed:
            self._way, self._braking = self._sent[0], True
        self._way, self._begin = self._rest_of(self._way, here), now

    def _rest_of(self, way: Trajectory, here: float) -> Trajectory:
        if way.duration - here <= 2.0 * TIME_TOLERANCE:
            return _standing(self.pepper, way.end)
        return way.between(here, way.duration) if here > 0.0 else way

    def _choose(self, now: float) -> tuple[LiveStatus, str, bool]:
        """Choose the trajectory to send; return the status, its reason and whether it is clear."""
        old, self._blocked = now - self._seen if self._ages else 0.0, ""
        reason = self._fault
        if not reason and old > self._horizon:
            reason = f"the scene is {old:.2f} s old, {self._horizon:g} s are allowed"
        for way, why in () if reason else self._ways(now):
            if self._send(way, now):
                self._braking = way is self._sent[0]
                if way is not self._way:
                    self._way, times = way, np.linspace(0.0, way.duration, _LOOKED_AT)
                    self._aside = moved_aside(self.pepper, self._idle, np.ptp(way(times).position, axis=0))
                if why:
                    return LiveStatus.WAITING if _stands(way) else LiveStatus.STOPPING, why, True
                self._attempts, self._branch = 0, None
                return LiveStatus.REACHED if _stands(way) else LiveStatus.MOVING, "", True
        clear = self._brake(now)
        if self._fault:
            return LiveStatus.HALTED, reason, clear
        status = LiveStatus.WAITING if _stands(self._way) else LiveStatus.STOPPING
        return status, reason or self._blocked, clear

    def _ways(self, now: float) -> Iterator[tuple[Trajectory, str]]:
        """Yield possible ways, the best first, and why they do not lead to the goal; empty if they do."""
        if self._goal is None:
            if not self._braking:
                sent = self._stop_of(self._way)
                self._way, self._braking = (self._way if sent is None else sent[0]), True
            yield self._way, "there is no goal"
            return
        leads = self._given is None and _is_at(self._way.end, self._goal)
        if leads and (_stands(self._way) or self._ahead_is_clear(self._way, now)):
            yield self._way, ""
        for candidates in (self._along_given, self._straight, self._planned):
            for found in candidates(now):
                less = candidates == self._planned and _stands(self._way)
                free = self._is_free(found) or (less and self._is_nearly_free(found))
                if free and self._ahead_is_clear(found, now):
                    yield found, ""
        self._ask(now)
        yield self._way, self._blocked or "no way to the goal was found yet"

    def _ahead_is_clear(self, way: Trajectory, now: float) -> bool:
        return not self._touches(way, min(way.duration, self._horizon), now, growing=False)

    def _is_free(self, way: Trajectory) -> bool:
        """Whether a whole way is free of static obstacles."""
        times = np.linspace(0.0, way.duration, math.ceil(way.duration / _STEP) + 1)
        return not self._meets_standing(way(times).position)

    def _is_nearly_free(self, way: Trajectory) -> bool:
        """Whether a way is free with a smaller margin of own parts, which is then kept from now on."""
        kept, self._own = self._own, 0.0
        if not self._is_free(way):
            self._own = kept
            return False
        while kept > LEAST_MARGIN:
            kept /= 2.0
            self._own = kept
            if self._is_free(way):
                return True
        self._own = 0.0
        return True

    def _along_given(self, now: float) -> Iterator[Trajectory]:
        """Yield the way that was given with the goal, one time."""
        given, self._given = self._given, None
        if given is not None and not _stands(self._way):
            yield from self._replaced(given)
        elif given is not None and np.abs(given.start - self._way.end).max() <= _SAME:
            yield given

    def _straight(self, now: float) -> Iterator[Trajectory]:
        assert self._goal is not None
        yield from self._replaced(self._goal)

    def _replaced(self, by: Array | Trajectory) -> Iterator[Trajectory]:
        """Yield the way to a goal, or onto another motion, from the end of the committed part."""
        at = 0.0 if _stands(self._way) else min(COMMITTED * self._cycle, self._way.duration)
        try:
            found = self._way.replaced(self.pepper, at, by, **self._limits)
        except PepperKinError:
            return
        yield found.trajectory

    def _planned(self, now: float) -> Iterator[Trajectory]:
        """Yield ways along the planned motion, if it is ready and can still be reached.

        First it is joined in motion, then after the stop at whose end it begins.
        """
        if self._branch is None:
            self._ask(now)
        if self._branch is None:
            return
        (before, begin), answer = self._branch, self._search.go_on()
        if self._search.running:
            return
        self._branch = None
        if answer is None:
            return
        before = self._rest_of(before, now - begin)
        if not _stands(self._way) and _is_plain(self._way):
            yield from self._replaced(answer)
        if _meet(before, self._way, COMMITTED * self._cycle):
            yield answer if _stands(before) else before.then(answer)

    def _ask(self, now: float) -> None:
        """Begin a search from where the robot will stop, or could stop."""
        if self._goal is None or self._branch is not None or not _is_plain(self._way):
            return
        before = self._way
        if _is_at(before.end, self._goal) and before.duration > _BRANCH:  # otherwise it stops anyway
            try:
                stop = before.stop(self.pepper, _BRANCH, **self._limits)
            except InfeasibleError:
                return
            before = before.between(0.0, _BRANCH).then(stop.trajectory)
        ahead = max(now - self._seen, 0.0) + _LOOKS_AHEAD[self._attempts % len(_LOOKS_AHEAD)]
        self._search.begin(before.end, self._goal, self._world.scene.at(ahead), self._attempts)
        self._attempts, self._branch = self._attempts + 1, (before, now)

    def _send(self, way: Trajectory, now: float) -> bool:
        """Send the committed part of a way and a stop, if both are clear; return whether they are."""
        sent = self._stop_of(way)
        if sent is None or (not _stands(way) and self._touches(sent[0], sent[0].duration, now)):
            return False
        self._sent = sent
        self._committed = way.duration if sent[0] is way else COMMITTED * self._cycle
        return True

    def _stop_of(self, way: Trajectory) -> tuple[Trajectory, Stop | None] | None:
        """Return the committed part of a way joined with its stop, and the stop; None if it cannot stop."""
        at = COMMITTED * self._cycle
        if _stands(way) or way.duration <= at + _INSTANT or (self._braking and way is self._way):
            return way, None
        try:
            stop = stop_within(self.pepper, way.between(at, way.duration), 0.0, self._bounds)
        except InfeasibleError:
            return None
        return way.between(0.0, at).then(stop.trajectory), stop

    def _brake(self, now: float) -> bool:
        """Continue the stop that was sent last; return whether it is still clear."""
        sent, stop = self._sent
        here = max(now - self._past[-1][0], 0.0) if self._past else 0.0
        self._way = self._rest_of(sent, here)
        self._sent, self._committed, self._braking = (self._way, stop), self._way.duration, True
        return _stands(self._way) or not self._touches(self._way, self._way.duration, now)

    def _touches(self, way: Trajectory, end: float, now: float, growing: bool = True) -> bool:
        """Whether something comes too near on a way that begins now; its name is stored in `_blocked`.

        Args:
            way: The way.
            end: Time of the way up to which it is checked [s].
            now: Current time [s].
            growing: Whether the obstacles' uncertainty counts.
        """
        times = np.linspace(0.0, end, math.ceil(end / _STEP) + 1)
        states = way(times)
        if self._meets_standing(states.position):
            return True
        return self._meets_movers(times, states, now, growing) is not None

    def _meets_standing(self, q: Array) -> bool:
        found = self._world.standing.nearer(q, np.full(len(q), self._own))
        if found.any() and not self._blocked:
            self._note(self._nearest(q[int(found.argmax())]))
        return bool(found.any())

    def _nearest(self, q: Array) -> tuple[str, ...]:
        """Return the names of the bodies that come too near at q [rad or m], shape (n,)."""
        exact = self._world.standing.exact
        for table in exact.dependent_ranges:
            if table.violated(q, self._own / RANGE_RADIUS):
                return table.links
        pair = exact.closest_pair(q, "obstacles")
        if pair is None or pair.distance > _STILL:
            pair = exact.closest_pair(q, "self")
        return () if pair is None else pair.names

    def _meets_movers(self, times: Array, states: State, now: float, growing: bool) -> int | None:
        """Return the index of the first state at which a moving obstacle comes too near, or None."""
        if not self._world.moving:
            return None
        since = np.maximum(times + (now - self._seen), 0.0)
        own_speed = float((np.abs(states.velocity) @ self._reach).max())
        for movers, checker in self._world.moving:
            within = 0.5 * times[1] * (own_speed + movers.speed) + self._delay * movers.speed
            kept = np.full(times.size, self._margin + within)
            if growing:
                kept += movers.uncertainty * (since + self._delay)
            both = movers.states(states.position, since)
            found = checker.nearer(both, kept)
            if found.any():
                first = int(found.argmax())
                if not self._blocked:
                    pair = checker.exact.closest_pair(both[first])
                    self._note(() if pair is None else pair.names)
                return first
        return None

    def _note(self, names: tuple[str, ...]) -> None:
        """Store the names of two bodies that come too near."""
        if names:
            self._near, self._blocked = names, f"{' and '.join(names)} come too near"


def _standing(pepper: PepperModel, q: Array) -> Trajectory:
    """Return a trajectory of an instant of rest at q [rad or m], shape (n,)."""
    return Trajectory(pepper.joint_names, np.array([0.0, _INSTANT]), q[None, None], pepper.joint_units)


def _stands(way: Trajectory) -> bool:
    return way.coefficients.shape[:2] == (1, 1)


def _is_plain(way: Trajectory) -> bool:
    """Whether a way has a low degree: the degree of a stop along it is twice as high."""
    return way.coefficients.shape[1] <= _HIGHEST


def _is_at(q: Array, goal: Array) -> bool:
    return bool(np.abs(q - goal).max() <= _AT_GOAL)


def _meet(first: Trajectory, second: Trajectory, committed: float) -> bool:
    """Whether two ways agree during the committed time [s]."""
    for at in (0.0, committed):
        a, b = (way(min(at, way.duration)) for way in (first, second))
        if np.abs(a.position - b.position).max() > 1e-7 or np.abs(a.velocity - b.velocity).max() > 1e-6:
            return False
    return True
