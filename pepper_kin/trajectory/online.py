"""Online motion from the current state to a target that may be replaced while the robot moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError, beside_limits
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_finite,
    as_joint_vector,
    check_positive,
    check_within_limits,
)
from pepper_kin.model.requirements import checked_share
from pepper_kin.trajectory.balance import wheel_limits
from pepper_kin.trajectory.limits import JerkLike, jerk_limits
from pepper_kin.trajectory.samples import State
from pepper_kin.trajectory.splice import load_ruckig, steer_with_jerk
from pepper_kin.trajectory.trajectory import Trajectory

_SAME_TIME = 1e-12  # [s]
_END = 1e-9  # [s]
_TINY = 1e-9
_TRIALS = 40  # maximum number of trials with smaller limits of a base on wheels
_MORE = 1.02
_WHEEL_STEP = 0.002  # time between states at which wheels are examined [s]


class OnlineMotion:
    """Jerk-limited motion to a target that may be replaced at any time; all joints arrive together.

    The motion is time-optimal from state to state within limits on velocity, acceleration and jerk: each
    joint is planned by itself and then slowed to the slowest (`pepper_kin.trajectory.splice`).  Obstacles,
    torques and balance are ignored.  Positions between start and target could leave their limits if the robot
    is already too fast to stop; `set_target` refuses such a target.  The wheels of a planar base keep their
    limits: if they would be exceeded, the motion is planned again with smaller limits of the base's joints.

    Attributes:
        pepper: The robot.
        time: Time since the motion was created [s].

    Args:
        pepper: The robot.
        q: Initial position [rad or m], shape (n,).
        v: Initial velocity [rad/s or m/s], shape (n,), or 0.
        a: Initial acceleration [rad/s^2 or m/s^2], shape (n,), or 0.
        jerk: Jerk limits: "gentle", "moderate" or "brisk", a factor on the acceleration limits [1/s], or
            limits [rad/s^3 or m/s^3], shape (n,).
        velocity_scale: Fraction of the velocity limits to use, in (0, 1].
        acceleration_scale: Fraction of the acceleration limits to use, in (0, 1].

    Raises:
        InvalidValueError: for a wrong shape, NaN, a scale out of range, or a joint without velocity or
            acceleration limit.
        LimitError: if q is outside the position limits, or v or a beyond the scaled limits.
        MissingDependencyError: if `ruckig` is not installed.
    """

    def __init__(
        self,
        pepper: PepperModel,
        q: ArrayLike,
        v: ArrayLike = 0.0,
        a: ArrayLike = 0.0,
        *,
        jerk: JerkLike = "moderate",
        velocity_scale: float = 1.0,
        acceleration_scale: float = 1.0,
    ) -> None:
        load_ruckig()
        self.pepper = pepper
        self._limits = tuple(
            _finite_limits(pepper, name, limit)
            for name, limit in (
                ("velocity", pepper.velocity_limits * checked_share("velocity_scale", velocity_scale)),
                (
                    "acceleration",
                    pepper.acceleration_limits * checked_share("acceleration_scale", acceleration_scale),
                ),
                ("jerk", jerk_limits(pepper, jerk)),
            )
        )
        position = _vector(pepper, q, "q")
        check_within_limits(pepper, position, "q", _TINY)
        state = State(position, _vector(pepper, v, "v"), _vector(pepper, a, "a"))
        for name, value, limit in zip(("v", "a"), state[1:], self._limits[:2], strict=True):
            _check_symmetric(pepper, name, value, limit)
        wheels = wheel_limits(pepper)
        self._wheels = None if wheels is None else wheels.scaled(velocity_scale, acceleration_scale)
        self._refuse_wheels(state)
        self.time = 0.0
        self._segments: list[tuple[float, Array]] = []  # start [s] and cubic, shape (4, n), of each piece
        self._plan = _standing(state)
        self._begun = 0.0
        self._target = state.position
        if np.any(state.velocity) or np.any(state.acceleration):
            self._set(state, _stopping_point(state, self._limits), np.zeros(pepper.n))

    def __repr__(self) -> str:
        return f"OnlineMotion({self.pepper.n} joints, at {self.time:.4g} s, {self.remaining:.4g} s to go)"

    @property
    def state(self) -> State:
        """Current position, velocity and acceleration, shape (n,) each, read-only."""
        return State(*(read_only(part) for part in _at(self._plan, self.time - self._begun)))

    @property
    def target(self) -> Array:
        """Position of the target [rad or m], shape (n,), read-only."""
        return read_only(self._target)

    @property
    def remaining(self) -> float:
        """Time until the target is reached [s]."""
        return max(0.0, self._begun + float(self._plan[0][-1]) - self.time)

    @property
    def arrived(self) -> bool:
        """Whether the target is reached."""
        return self.remaining <= _END

    def set_target(self, q_target: ArrayLike, v_target: ArrayLike = 0.0) -> float:
        """Move to another target from the current state, without jumps of position, velocity or acceleration.

        Args:
            q_target: Position of the target [rad or m], shape (n,).
            v_target: Velocity at the target [rad/s or m/s], shape (n,), or 0; the motion continues with it
                after arrival.

        Returns:
            The duration of the motion to the target [s].

        Raises:
            InvalidValueError: for a wrong shape or NaN.
            LimitError: for a target outside the limits of position or velocity.
            InfeasibleError: if joints cannot stay within their position limits, or wheels within theirs, on
                the way.
        """
        position = _vector(self.pepper, q_target, "q_target")
        velocity = _vector(self.pepper, v_target, "v_target")
        check_within_limits(self.pepper, position, "q_target", _TINY)
        _check_symmetric(self.pepper, "v_target", velocity, self._limits[0])
        now = State(*_at(self._plan, self.time - self._begun))
        return self._set(now, position, velocity)

    def step(self, dt: float) -> State:
        """Advance the time, and return position, velocity and acceleration, shape (n,) each, read-only.

        Args:
            dt: Time step [s], above zero.
        """
        self.time += check_positive("dt", dt, "s")
        return self.state

    def to_trajectory(self) -> Trajectory:
        """Return the past and the planned motion as one trajectory of exact cubics in time.

        Raises:
            InvalidValueError: if its duration is zero.
        """
        segments = [*self._segments, *self._cut(self._plan, self._begun, np.inf)]
        end = max(self.time, self._begun + float(self._plan[0][-1]))
        if end <= _SAME_TIME:
            raise InvalidValueError("motion", "a duration of zero", "a target to move to, or a step")
        breaks = np.array([start for start, _ in segments if start < end - _SAME_TIME] + [end])
        table = np.stack([cubic for _, cubic in segments[: breaks.size - 1]])
        return Trajectory(self.pepper.joint_names, breaks, table, self.pepper.joint_units)

    def _set(self, now: State, position: Array, velocity: Array) -> float:
        """Plan a motion to a position [rad or m] and velocity, shape (n,) each; return its duration [s]."""
        plan = self._within_wheels(now, position, velocity)
        self._refuse_outside(plan)
        self._segments += self._cut(self._plan, self._begun, self.time)
        self._plan, self._begun, self._target = plan, self.time, position
        return float(plan[0][-1])

    def _within_wheels(self, now: State, position: Array, velocity: Array) -> tuple[Array, Array]:
        """Return a plan to a target position and velocity, shape (n,) each, within the wheels' limits.

        Raises:
            InfeasibleError: if smaller limits of the base's joints do not help, naming the wheel.
        """
        plan = self._solve(now, position, velocity, self._limits)
        if self._wheels is None:
            return plan
        share = 1.0
        for _ in range(_TRIALS):
            use, words = self._wheel_use(plan)
            if use <= 1.0 + _TINY:
                return plan
            share /= min(use * _MORE, 2.0)
            limits = tuple(limit.copy() for limit in self._limits)
            for limit, speed in zip(limits, (velocity, None, None), strict=True):
                places = list(self._wheels.places)
                least = 0.0 if speed is None else np.abs(speed[places])
                limit[places] = np.maximum(share * limit[places], least)
            plan = self._solve(now, position, velocity, limits)
        raise InfeasibleError(
            "motion", f"the base would ask too much of {words}", "choose a slower target, or set it later"
        )

    def _wheel_use(self, plan: tuple[Array, Array]) -> tuple[float, str]:
        """Return the largest fraction of a limit that wheels and base use on the way, and the limit's name.

        Args:
            plan: Breaks [s], shape (m + 1,), and cubics, shape (m + 1, 4, n).
        """
        breaks, cubics = plan
        wheels = self._wheels
        assert wheels is not None
        if breaks.size < 2:
            return 0.0, ""
        step = np.diff(breaks)
        count = np.maximum(np.ceil(step / _WHEEL_STEP), 2).astype(int) + 1
        segment = np.repeat(np.arange(step.size), count)
        number = np.arange(segment.size) - np.repeat(np.cumsum(count) - count, count)
        x = (step[segment] * number / (count[segment] - 1))[:, None]
        c = cubics[segment]
        q = c[:, 0] + x * (c[:, 1] + x * (c[:, 2] + x * c[:, 3]))
        v, a = c[:, 1] + x * (2 * c[:, 2] + 3 * x * c[:, 3]), 2 * c[:, 2] + 6 * x * c[:, 3]
        speed = wheels.shares(q, v).max(axis=0)
        change = np.abs(wheels.accelerations(q, v, a)).max(axis=0) / wheels.acceleration
        names = [
            *(f"the speed of {name}" for name in wheels.names),
            "the base, whose speed is limited,",
            *(f"the acceleration of {name}" for name in wheels.names),
        ]
        uses = np.concatenate([speed, change])
        return float(uses.max()), names[int(np.argmax(uses))]

    def _refuse_wheels(self, state: State) -> None:
        """Refuse an initial state that is too fast for the wheels."""
        if self._wheels is None:
            return
        share = self._wheels.shares(state.position[None], state.velocity[None])[0]
        if share.max() > 1.0 + _TINY:
            names = (*self._wheels.names, "the base")
            raise InvalidValueError(
                "v",
                f"{share.max():.4g} times the speed of {names[int(np.argmax(share))]}",
                "at most its limit",
            )

    def _solve(
        self, now: State, position: Array, velocity: Array, limits: tuple[Array, ...]
    ) -> tuple[Array, Array]:
        """Return the plan to a target.

        Args:
            now: Initial state, shape (n,) each.
            position: Position of the target [rad or m], shape (n,).
            velocity: Velocity of the target [rad/s or m/s], shape (n,).
            limits: Limits of velocity, acceleration and jerk, shape (n,) each.

        Returns:
            Breaks [s], shape (m + 1,), and cubics, shape (m + 1, 4, n); the last one has no end.
        """
        still = np.zeros_like(position)
        breaks, cubics = steer_with_jerk(now, State(position, velocity, still), limits)
        on = np.stack([position, velocity, still, still])
        return breaks, np.concatenate([cubics, on[None]])

    def _refuse_outside(self, plan: tuple[Array, Array]) -> None:
        """Refuse a plan that leaves the position limits.

        Args:
            plan: Breaks [s], shape (m + 1,), and cubics, shape (m + 1, 4, n).
        """
        breaks, cubics = plan
        if breaks.size < 2:
            return
        lower, upper = self.pepper.lower_limits, self.pepper.upper_limits
        share = np.linspace(0.0, 1.0, 17)
        segment = np.repeat(np.arange(breaks.size - 1), share.size)
        x = (np.diff(breaks)[:, None] * share).ravel()[:, None]
        c = cubics[segment]
        q = c[:, 0] + x * (c[:, 1] + x * (c[:, 2] + x * c[:, 3]))
        violation = np.maximum(lower - q, q - upper)
        if violation.max() > 1e-6:
            at, joint = np.unravel_index(int(np.argmax(violation)), violation.shape)
            name, unit = self.pepper.joint_names[joint], self.pepper.joint_units[joint]
            value, *limits = beside_limits(q[at, joint], lower[joint], upper[joint], outside=True)
            raise InfeasibleError(
                "motion",
                f"{name} would pass {value} {unit} on the way, outside [{', '.join(limits)}]",
                "choose a target further inside, or set it earlier",
            )

    def _cut(self, plan: tuple[Array, Array], begun: float, until: float) -> list[tuple[float, Array]]:
        """Return starts [s] and cubics, shape (4, n), of a plan's pieces that begin before a time [s]."""
        breaks, cubics = plan
        return [
            (begun + float(start), cubic)
            for start, cubic in zip(breaks, cubics, strict=True)
            if begun + start < until - _SAME_TIME
        ]


def _finite_limits(pepper: PepperModel, name: str, limit: Array) -> Array:
    """Return a copy of limits, shape (n,); refuse infinite ones."""
    if not np.isfinite(limit).all():
        joint = pepper.joint_names[int(np.argmin(np.isfinite(limit)))]
        raise InvalidValueError(f"{name} limit of {joint}", "none", "a finite limit for online motion")
    return np.array(limit)


def _vector(pepper: PepperModel, value: ArrayLike, quantity: str) -> Array:
    """Return a joint vector, shape (n,), from a joint vector or one number for all joints."""
    if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and not value.ndim):
        value = np.full(pepper.n, as_finite(value, quantity, ()))
    return np.array(as_joint_vector(pepper, value, quantity))


def _check_symmetric(pepper: PepperModel, quantity: str, value: Array, limit: Array) -> None:
    """Refuse a value whose absolute value exceeds limits in the same unit, shape (n,) each."""
    over = np.abs(value) - limit
    if over.max() > _TINY:
        j = int(np.argmax(over))
        unit = pepper.joint_units[j] + ("/s^2" if quantity == "a" else "/s")
        raise LimitError(quantity, pepper.joint_names[j], float(value[j]), -limit[j], limit[j], unit)


def _standing(state: State) -> tuple[Array, Array]:
    """Return the plan of staying where the robot is."""
    still = np.zeros_like(state.position)
    return np.zeros(1), np.stack([state.position, still, still, still])[None]


def _stopping_point(state: State, limits: tuple[Array, ...]) -> Array:
    """Return the approximate position where the robot stops if it brakes at half its acceleration limit.

    Args:
        state: Initial state, shape (n,) each.
        limits: Limits of velocity, acceleration and jerk, shape (n,) each.

    Returns:
        Position [rad or m], shape (n,).
    """
    v, a = state.velocity, state.acceleration
    after = v + a * np.abs(a) / (2 * limits[2])
    return state.position + after * np.abs(after) / limits[1] + after * limits[1] / (2 * limits[2])


def _at(plan: tuple[Array, Array], time: float) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration, shape (n,) each, at a time since the plan began [s]."""
    breaks, cubics = plan
    i = max(0, int(np.searchsorted(breaks, time, side="right")) - 1)
    x, c = time - float(breaks[i]), cubics[i]
    q = c[0] + x * (c[1] + x * (c[2] + x * c[3]))
    return q, c[1] + x * (2 * c[2] + 3 * x * c[3]), 2 * c[2] + 6 * x * c[3]
