"""A live motion on a robot with NAOqi, for a supervisor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.motion import LiveMotion, LiveState, LiveStatus
from pepper_kin.naoqi.channel import Moved
from pepper_kin.naoqi.link import RobotLink
from pepper_kin.naoqi.robot_motion import BaseOptions, CommandedMotion
from pepper_kin.naoqi.robot_state import RobotState
from pepper_kin.supervision import MotionEndedError, RobotMotionStatus

EachCycle = Callable[[float, LiveState | None], bool]

LAST_SPEED = 0.1
"""Fraction of the maximum speed for the last targets, which the robot has reached already."""


class LiveStream(CommandedMotion):
    """Targets of a live motion at 50 Hz, with the measured states fed back to the motion.

    Args:
        link: The connection.
        pepper: Model of the robot's states.
        base: Options, watchdog and clock.
        live: The live motion, of joints without a base.
        each_cycle: Called before each cycle with the time [s] and the last state; returns whether to go
            on.  It is not called again after it returned False.
        check: Raises if the motion must not start.
    """

    method = "live"

    def __init__(
        self,
        link: RobotLink,
        pepper: PepperModel,
        base: BaseOptions,
        live: LiveMotion,
        each_cycle: EachCycle,
        check: Callable[[], object],
    ) -> None:
        self._joints = list(live.pepper.joint_names)
        super().__init__(link, pepper, Moved(self._joints, False), *base, check)
        self._columns = [pepper.joint_index(name) for name in self._joints]
        self._live, self._each_cycle, self._goes_on = live, each_cycle, True
        self._state: LiveState | None = None

    def _begin(self) -> Iterator[None]:
        return iter(())

    def _wanted(self, state: RobotState) -> Array:
        wanted = np.array(state.q)
        if self._state is not None:
            wanted[self._columns] = self._state.at(state.time).position
        return wanted

    def _advance(self) -> bool:
        if self._finishing:
            return self._closed()
        now, live = self._clock.now(), self._live
        self._goes_on = self._goes_on and self._each_cycle(now, self._state)
        if not self._goes_on:
            live.set_goal(None)
        if self._states:
            _, measured, _ = self._states[-1]
            live.set_state(measured.q[self._columns], measured.time)
        self._state = state = live.step(now)
        if state.status is LiveStatus.HALTED:
            raise MotionEndedError(RobotMotionStatus.DEVIATED, state.reason)
        ahead = state.at(now + self._options.lead)
        share = float(np.max(np.abs(ahead.velocity) / self._pepper.velocity_limits[self._columns]))
        targets = [float(x) for x in ahead.position]
        calls: list[tuple[str, list[Any]]] = [
            ("setAngles", [self._joints, targets, float(np.clip(1.5 * share + 0.1, 0.1, 1.0))])
        ]
        self._channel.send(calls)
        self._finishing = live.goal is None and state.status is not LiveStatus.STOPPING
        return False

    def _last_calls(self) -> list[tuple[str, list[Any]]]:
        end = [float(x) for x in self._live.trajectory.end]
        return [("setAngles", [self._joints, end, LAST_SPEED])]
