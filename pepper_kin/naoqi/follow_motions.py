"""Trajectories on a robot with NAOqi, for a supervisor: streamed, or handed over in one call."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.files.naoqi_file import NaoqiArguments
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.channel import Moved
from pepper_kin.naoqi.following import FollowOptions
from pepper_kin.naoqi.link import RobotLink
from pepper_kin.naoqi.robot_motion import CommandedMotion
from pepper_kin.naoqi.robot_state import BASE, RobotState
from pepper_kin.supervision import CYCLE, Clock, MotionEndedError, RobotMotionStatus
from pepper_kin.trajectory import Trajectory

CATCH_UP = 1.5
"""Maximum progress of the motion in one cycle [cycles]: after a delay it waits rather than jumps."""

ARRIVED, BASE_ARRIVED = 0.02, 0.01
"""Deviation below which the end of a motion counts as reached, of joints and yaw [rad], of the base [m]."""

STANDS = 0.02
"""Velocity below which the base counts as at rest [m/s, rad/s]."""

EARLY = 0.1
"""Time before the end from which a finished call counts as a complete motion [s]."""

LAST_SPEED = 0.1
"""Fraction of the maximum speed for the last targets, which the robot has reached already."""

AHEAD = 0.5
"""Time after the expected one up to which the progress of a motion is searched [s]."""

ALIKE = 2e-3
"""Difference below which commands count as equal [rad or fraction]: a motion may pause, and turn."""


class FollowMotion(CommandedMotion):
    """A trajectory on a robot: desired positions, deviation and arrival.

    Args:
        link: The connection.
        pepper: Model with the trajectory's joints.
        trajectory: The motion.
        options: Tolerances and times.
        guarded: Whether the robot has a watchdog.
        clock: Clock of the client.
        check: Returns the state of the robot; raises if the motion must not start.
    """

    def __init__(
        self,
        link: RobotLink,
        pepper: PepperModel,
        trajectory: Trajectory,
        options: FollowOptions,
        guarded: bool,
        clock: Clock,
        check: Callable[[], RobotState],
    ) -> None:
        base = [name for name in pepper.joint_names if name in BASE]
        self._joints = [name for name in pepper.joint_names if name not in BASE]
        super().__init__(link, pepper, Moved(self._joints, bool(base)), options, guarded, clock, check)
        self._start_state = check
        self._columns = [pepper.joint_index(name) for name in self._joints]
        self._trajectory = trajectory
        self._origin: Array | None = None
        self._at = 0.0
        self._moved_at = math.inf
        self._ended: float | None = None

    def check(self) -> None:
        """Raise if the motion must not start; else record the pose of the base."""
        state = self._start_state()
        self._origin = state.base_pose.copy() if self._base else None

    def _wanted(self, state: RobotState) -> Array:
        return self._wanted_at(self._at)

    def _wanted_at(self, at: float) -> Array:
        """Return the desired positions at a time of the motion [s] [rad, m or fraction], shape (n,)."""
        wanted = np.array(self._trajectory(at).position)
        if self._origin is not None:
            wanted[self._base] = placed(self._origin, self._trajectory.start[self._base], wanted[self._base])
        return wanted

    def _deviation(self, wanted: Array) -> Array:
        """Return the deviation of each joint in the last state [rad, m or fraction], shape (n,)."""
        off = np.abs(self._states[-1][1].q - wanted)
        for k in self._base[2:]:
            off[k] = abs(math.remainder(off[k], 2.0 * math.pi))
        return np.asarray(off)

    def _check_deviation(self) -> None:
        """Raise MotionEndedError if a joint or the base is beyond its tolerance in the last state."""
        if not self._states:
            return
        off = self._deviation(self._states[-1][2])
        joint, base = self._options.joint_tolerance, self._options.base_tolerance
        worst = max(self._columns, key=lambda k: off[k], default=None)
        if worst is not None and not off[worst] <= joint:
            name = self._pepper.joint_names[worst]
            text = f"{name} is {off[worst]:.3f} from the motion, tolerance {joint:g}"
            raise MotionEndedError(RobotMotionStatus.DEVIATED, text)
        away = math.hypot(*off[self._base[:2]])
        if not away <= base:
            text = f"the base is {away:.3f} m from the motion, tolerance {base:g} m"
            raise MotionEndedError(RobotMotionStatus.DEVIATED, text)

    def _near_end(self) -> bool:
        """Return whether the last measured state is at the end of the motion, with the base at rest."""
        if not self._states or self._at < self._trajectory.duration:
            return False
        off = self._deviation(self._wanted_at(self._trajectory.duration))
        turning = self._columns + self._base[2:]
        stands = (np.abs(self._states[-1][1].velocity[self._base]) < STANDS).all()
        near = (off[turning] < ARRIVED).all() and (off[self._base[:2]] < BASE_ARRIVED).all()
        return bool(near and stands)

    def _arrived(self) -> bool:
        return self._near_end()

    def _why_late(self, moving: str) -> str:
        if not self._states or self._near_end():
            return super()._why_late(moving)
        off = self._deviation(self._wanted_at(self._trajectory.duration))
        name = self._pepper.joint_names[int(np.argmax(off))]
        return f"{name} is {off.max():.3f} from the end after {self._options.hold_time:g} s"


class StreamMotion(FollowMotion):
    """Targets at 50 Hz; the base gets velocities that correct its deviation."""

    method = "stream"

    def _begin(self) -> Iterator[None]:
        self._last = self._clock.now()
        self._corrected = False
        return iter(())

    def _advance(self) -> bool:
        self._check_deviation()
        if self._finishing:
            return self._closed()
        now, duration = self._clock.now(), self._trajectory.duration
        self._at = min(self._at + min(now - self._last, CATCH_UP * CYCLE), duration)
        self._last = now
        self._send(self._at)
        if self._at >= duration:
            near = self._near_end()
            self._finishing = near or self._is_late()
            if near and not self._corrected:
                self._until = None  # coming to rest has a timeout of its own
        return False

    def _correct(self) -> None:
        """Correct the base again, which was near the end and overshot while braking."""
        if self._base and not self._is_late():
            self._finishing = self._worded = False
            self._answered_at, self._corrected = None, True

    def _last_calls(self) -> list[tuple[str, list[Any]]]:
        end = [float(x) for x in self._trajectory.end[self._columns]]
        joints = [("setAngles", [self._joints, end, LAST_SPEED])] if self._columns else []
        return [*super()._last_calls(), *joints]

    def _send(self, at: float) -> None:
        """Send the targets of a time of the motion [s]."""
        ahead = self._trajectory(min(at + self._options.lead, self._trajectory.duration))
        calls: list[tuple[str, list[Any]]] = []
        if self._columns:
            limits = self._pepper.velocity_limits[self._columns]
            share = float(np.max(np.abs(ahead.velocity[self._columns]) / limits, initial=0.0))
            targets = [float(x) for x in ahead.position[self._columns]]
            calls.append(("setAngles", [self._joints, targets, float(np.clip(1.5 * share + 0.1, 0.1, 1.0))]))
        if self._base:
            calls.append(("move", self._twist(ahead.velocity[self._base], at)))
        self._channel.send(calls)

    def _twist(self, rate: Array, at: float) -> list[float]:
        """Return the velocity of the base in its own axes, with a correction of its deviation.

        Args:
            rate: Velocity of the trajectory's base coordinates [m/s, m/s, rad/s], shape (3,).
            at: Time of the motion [s].
        """
        assert self._origin is not None
        pose, error = self._origin, np.zeros(3)
        if self._states:
            _, state, wanted = self._states[-1]
            pose = state.base_pose
            error = wanted[self._base] - pose
            error[2] = math.remainder(error[2], 2.0 * math.pi)
        error = self._options.base_gain * error
        turn = float(self._origin[2] - self._trajectory.start[self._base[2]])
        go = rate if at < self._trajectory.duration else np.zeros(3)
        ahead, across = _turned(go, turn - float(pose[2])), _turned(error, -float(pose[2]))
        return [float(x) for x in ahead + across]


class BezierMotion(FollowMotion):
    """The whole motion in one call of `angleInterpolationBezier`, which moves joints only.

    The robot starts when it has received the motion, on its own clock.  Its progress is found from the
    commands that it reports: the time of the motion, near the expected one, at which the motion has them.

    Attributes:
        curves: Times and keys, certified with ALMotion's interpolation; set by `check`.
    """

    method = "bezier"
    curves: NaoqiArguments | None = None

    def _begin(self) -> Iterator[None]:
        assert self.curves is not None
        yield from self._channel.start_curves(self.curves.times, self.curves.keys)
        while self._channel.state == "armed":
            yield
        self._moved_at = self._clock.now()

    def _advance(self) -> bool:
        if self._finishing:
            return self._closed()
        self._check_deviation()
        now, duration = self._clock.now(), self._trajectory.duration
        if self._channel.state.startswith("finished"):
            self._ended = now if self._ended is None else self._ended
            if not self._states or self._states[-1][1].time < self._ended:
                return False  # no state has been read since the end
            if self._at < duration - EARLY and not self._has_commands_of_end():
                text = f"the robot ended it after {self._at:.2f} s of {duration:.2f} s"
                raise MotionEndedError(RobotMotionStatus.STOPPED, text)
            self._at, self._finishing = duration, True
        elif now > self._moved_at + self._options.hold_time + self._options.silence:
            text = f"the robot does not go on after {self._at:.2f} s of {duration:.2f} s"
            raise MotionEndedError(RobotMotionStatus.DEVIATED, text)
        return False

    def _has_commands_of_end(self) -> bool:
        """Return whether the last reported commands are the end of the motion."""
        if not self._states:
            return False
        off = self._commands(self._states[-1][1]) - self._trajectory.end[self._columns]
        return bool(np.abs(off).max(initial=0.0) < ARRIVED)

    def _commands(self, state: RobotState) -> Array:
        """Return the joints' commands, or their positions where there is no command [rad or fraction]."""
        return np.where(np.isfinite(state.command), state.command, state.q)[self._columns]

    def _wanted(self, state: RobotState) -> Array:
        if self._moved_at < math.inf and not self._finishing:
            passed = state.time - (self._states[-1][1].time if self._states else state.time)
            expected = min(self._at + max(passed, 0.0), self._trajectory.duration)
            grid = np.arange(self._at, min(expected + AHEAD, self._trajectory.duration) + CYCLE, CYCLE / 2.0)
            grid = np.minimum(grid, self._trajectory.duration)
            off = np.abs(self._trajectory(grid).position[:, self._columns] - self._commands(state)).max(
                axis=1
            )
            alike = np.flatnonzero(off <= off.min() + ALIKE)
            at = float(grid[alike[np.argmin(np.abs(grid[alike] - expected))]])
            if at > self._at:
                self._at, self._moved_at = at, self._clock.now()
        return super()._wanted(state)


def _turned(twist: Array, angle: float) -> Array:
    """Return v_x, v_y, omega with (v_x, v_y) rotated by an angle [rad], shape (3,)."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1], twist[2]])


def placed(origin: Array, start: Array, pose: Array) -> Array:
    """Move a pose by the planar motion that brings `start` to `origin`: x, y [m], yaw [rad], shape (3,)."""
    turn = float(origin[2] - start[2])
    return np.array([*(origin[:2] + _turned(pose - start, turn)[:2]), pose[2] + turn])
