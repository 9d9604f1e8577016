"""The loop that makes a robot follow a trajectory, with a beat for its watchdog."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.errors import NaoqiError, RobotConnectionError
from pepper_kin.naoqi.following import FollowOptions, RobotMotionResult, RobotMotionStatus
from pepper_kin.naoqi.guard import Guard, MotionEndedError
from pepper_kin.naoqi.link import Link
from pepper_kin.naoqi.robot_state import BASE, RobotState, StateReader, run_of_states
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import Run

Array = NDArray[np.float64]

CATCH_UP = 1.5
"""Cycles by which the motion goes on in one cycle at most: after a delay it waits rather than jumps."""

UNANSWERED = 25
"""Calls that may be unanswered at once."""

KEY_SPACING = 0.04
"""Time between the keys of a Bezier curve [s]."""

ARRIVED, BASE_ARRIVED = 0.02, 0.01
"""Where the end of a motion counts as reached [rad, m]."""


EARLY = 0.1
"""Time before its end at which the robot may say that it made a motion [s]."""

STANDS = 0.02
"""Velocity below which the base stands [m/s, rad/s]."""


class Follower:
    """One motion on a robot.

    Args:
        link: The connection.
        pepper: Robot of the trajectory's joints.
        trajectory: The motion.
        options: Tolerances and times.
        method: "stream" or "bezier".
        guarded: Whether the robot has a watchdog.
        stop: Set by others to end the motion.
    """

    def __init__(
        self,
        link: Link,
        pepper: PepperModel,
        trajectory: Trajectory,
        options: FollowOptions,
        method: str,
        guarded: bool,
        stop: threading.Event,
    ) -> None:
        self._link, self._pepper, self._trajectory = link, pepper, trajectory
        self._options, self._method, self._guarded, self._stop = options, method, guarded, stop
        self._reader = StateReader(link, pepper)
        self._base = [pepper.joint_index(name) for name in BASE if name in pepper.joint_names]
        self._columns = [k for k in range(pepper.n) if k not in self._base]
        self._joints = [pepper.joint_names[k] for k in self._columns]
        self._calls: deque[tuple[str, Any]] = deque()
        self._states: list[tuple[float, RobotState, Array]] = []
        self._reading: tuple[float, tuple[float, list[Any]]] | None = None
        self._origin: Array | None = None
        self._begun = 0.0

    def run(self) -> RobotMotionResult:
        """Follow the trajectory to its end, or until something ends it."""
        status, message, guard = RobotMotionStatus.COMPLETED, "", None
        try:
            self._note(self._reader.read(), 0.0)
            self._states.clear()
            keys = self._keys() if self._method == "bezier" else None
            guard = Guard(self._link, self._options.silence, self._joints, self._guarded)
            self._begun = time.monotonic()
            if keys is None:
                self._stream(guard)
            else:
                self._play(guard, keys)
            guard.end()
        except MotionEndedError as end:
            status, message = end.status, end.message
        except RobotConnectionError as error:
            status, message = RobotMotionStatus.CONNECTION_LOST, str(error)
        except NaoqiError as error:
            status, message = RobotMotionStatus.REFUSED, str(error)
        with contextlib.suppress(RobotConnectionError, NaoqiError):
            if guard is not None and status in (
                RobotMotionStatus.STOPPED,
                RobotMotionStatus.DEVIATED,
                RobotMotionStatus.REFUSED,
            ):
                on_robot.hold(self._link.proxy("ALMotion"), self._joints)
                guard.release()
            elif self._base and status is RobotMotionStatus.COMPLETED:
                self._link.call("ALMotion", "stopMove")
        stamps = np.array([stamp for stamp, _, _ in self._states])
        return RobotMotionResult(status, message, self._method, self._as_run(), stamps, self._guarded)

    def _stream(self, guard: Guard) -> None:
        """Send targets at 50 Hz; the base gets velocities that correct its deviation."""
        duration = self._trajectory.duration
        at, last = 0.0, time.monotonic()
        due, until = last, None
        while True:
            now = time.monotonic()
            at = min(at + min(now - last, CATCH_UP * CYCLE), duration)
            last = now
            self._look(guard)  # before targets are sent: after a silence the watchdog has the last word
            self._send(at)
            self._read(at)
            if at >= duration:
                until = now + self._options.hold_time if until is None else until
                if self._arrived() or now > until:
                    break
            due = max(due + CYCLE, time.monotonic() - CYCLE)
            time.sleep(max(due - time.monotonic(), 0.0))
        self._check_arrival()

    def _keys(self) -> tuple[list[list[float]], list[Any]]:
        """Return times and keys of all joints for `angleInterpolationBezier`: cubics that meet the motion."""
        duration = self._trajectory.duration
        count = max(math.ceil(duration / KEY_SPACING), 1)
        times = duration * np.arange(1, count + 1) / count
        state = self._trajectory(times)
        step = duration / count / 3.0
        keys = [
            [
                [float(p), [3, -step, -step * float(v)], [3, step, step * float(v)]]
                for p, v in zip(state.position[:, k], state.velocity[:, k], strict=True)
            ]
            for k in self._columns
        ]
        return [times.tolist() for _ in self._columns], keys

    def _play(self, guard: Guard, keys: tuple[list[list[float]], list[Any]]) -> None:
        """Hand the whole motion to the robot, and watch it."""
        duration = self._trajectory.duration
        future = self._link.start("ALMotion", "angleInterpolationBezier", self._joints, *keys)
        begun = time.monotonic()
        while not future.isFinished():
            self._read(min(time.monotonic() - begun, duration))
            self._look(guard)
            if time.monotonic() > begun + duration + self._options.hold_time + self._link.timeout:
                raise RobotConnectionError(self._link.url, "angleInterpolationBezier: no answer in time")
            time.sleep(CYCLE)
        self._look(guard)  # what ended it before its time
        self._link.value(future, "ALMotion.angleInterpolationBezier")
        took = time.monotonic() - begun
        if took < duration - EARLY:
            text = f"the robot ended it after {took:.2f} s of {duration:.2f} s"
            raise MotionEndedError(RobotMotionStatus.STOPPED, text)
        self._note(self._reader.read(), duration)
        self._check_arrival()

    def _send(self, at: float) -> None:
        """Send the targets of a time of the motion [s]."""
        ahead = self._trajectory(min(at + self._options.lead, self._trajectory.duration))
        if self._columns:
            limits = self._pepper.velocity_limits[self._columns]
            share = float(np.max(np.abs(ahead.velocity[self._columns]) / limits, initial=0.0))
            targets = [float(x) for x in ahead.position[self._columns]]
            self._begin("setAngles", self._joints, targets, float(np.clip(1.5 * share + 0.1, 0.1, 1.0)))
        if self._base:
            self._begin("move", *self._twist(ahead.velocity[self._base], at))

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

    def _begin(self, method: str, *arguments: Any) -> None:
        self._calls.append((method, self._link.start("ALMotion", method, *arguments)))
        while self._calls and self._calls[0][1].isFinished():
            done, future = self._calls.popleft()
            self._link.value(future, f"ALMotion.{done}")
        if len(self._calls) > UNANSWERED:
            raise RobotConnectionError(self._link.url, f"{len(self._calls)} calls are unanswered")

    def _read(self, at: float) -> None:
        """Take the state that was asked for, if it is there, and ask for the next."""
        if self._reading is not None:
            stamp, (asked, futures) = self._reading
            if not all(future.isFinished() for future in futures):
                if time.monotonic() > asked + self._link.timeout:
                    raise RobotConnectionError(self._link.url, "no state was read in time")
                return
            self._note(self._reader.finish((asked, futures)), stamp)
        self._reading = (at, self._reader.begin())

    def _note(self, state: RobotState, at: float) -> None:
        """Keep a state beside what was commanded at its time; base poses are taken from the start."""
        wanted = np.array(self._trajectory(at).position)
        if self._base:
            if self._origin is None:
                self._origin = state.base_pose.copy()
            wanted[self._base] = placed(self._origin, self._trajectory.start[self._base], wanted[self._base])
        self._states.append((state.time - self._begun, state, wanted))

    def _look(self, guard: Guard) -> None:
        """End the motion where somebody stopped it, the watchdog did, or the deviation is too large."""
        guard.beat()
        if self._stop.is_set():
            raise MotionEndedError(RobotMotionStatus.STOPPED, "")
        if not self._link.alive:
            raise RobotConnectionError(self._link.url, "the connection was lost in mid-motion")
        if self._states:
            self._check_deviation()

    def _check_deviation(self) -> None:
        off = self._deviation()
        joint, base = self._options.joint_tolerance, self._options.base_tolerance
        worst = max(self._columns, key=lambda k: off[k], default=None)
        if worst is not None and off[worst] > joint:
            name = self._pepper.joint_names[worst]
            text = f"{name} is {off[worst]:.3f} from the motion, tolerance {joint:g}"
            raise MotionEndedError(RobotMotionStatus.DEVIATED, text)
        away = math.hypot(*off[self._base[:2]])
        if away > base:
            text = f"the base is {away:.3f} m from the motion, tolerance {base:g} m"
            raise MotionEndedError(RobotMotionStatus.DEVIATED, text)

    def _deviation(self) -> Array:
        """Return by how much each joint was off in the last state [rad, m or share], shape (n,)."""
        _, state, wanted = self._states[-1]
        off = np.abs(state.q - wanted)
        for k in self._base[2:]:
            off[k] = abs(math.remainder(off[k], 2.0 * math.pi))
        return np.asarray(off)

    def _arrived(self) -> bool:
        if not self._states:
            return False
        off, end = self._deviation(), self._trajectory(self._trajectory.duration).position
        last = bool(np.allclose(self._states[-1][2][self._columns], end[self._columns]))
        turning = self._columns + self._base[2:]
        near = (off[turning] < ARRIVED).all() and (off[self._base[:2]] < BASE_ARRIVED).all()
        stands = (np.abs(self._states[-1][1].velocity[self._base]) < STANDS).all()
        return last and bool(near and stands)

    def _check_arrival(self) -> None:
        if not self._arrived():
            off = self._deviation()
            name = self._pepper.joint_names[int(np.argmax(off))]
            text = f"{name} is {off.max():.3f} from the end after {self._options.hold_time:g} s"
            raise MotionEndedError(RobotMotionStatus.DEVIATED, text)

    def _as_run(self) -> Run | None:
        """Return the states as a run in steps of 20 ms."""
        if len(self._states) < 2:
            return None
        stamps = np.array([stamp for stamp, _, _ in self._states])
        stamps, kept = np.unique(stamps - stamps[0], return_index=True)
        states, wanted = [self._states[k][1] for k in kept], [self._states[k][2] for k in kept]
        return run_of_states(self._pepper, stamps, states, wanted)


def _turned(twist: Array, angle: float) -> Array:
    """Return v_x, v_y, omega with the velocity turned by an angle [rad], shape (3,)."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1], twist[2]])


def placed(origin: Array, start: Array, pose: Array) -> Array:
    """Return where a pose lies if the pose `start` is put on `origin`: x, y [m], yaw [rad], shape (3,)."""
    turn = float(origin[2] - start[2])
    return np.array([*(origin[:2] + _turned(pose - start, turn)[:2]), pose[2] + turn])
