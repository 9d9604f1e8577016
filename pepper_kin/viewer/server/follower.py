"""The servo of the targets: the robot follows while targets are dragged."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.ik import LookAt
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel
from pepper_kin.servo import Servo, ServoState, ServoStatus

RATE = 100.0
MOST_TICKS = 4
"""Maximum number of late ticks that are made up for; further ones are skipped."""
_STILL = 5e-3
"""Joint speed below which joints count as at rest [rad/s or m/s]."""
_REST_TICKS = 40
_GAIN = 1e-3
"""Minimum decrease of the error in `_STALL_TICKS` ticks [m or rad], or the servo counts as stalled."""
_STALL_TICKS = 60
_ARRIVED_TICKS = 25


def compile_servo(pepper: PepperModel) -> None:
    """Load the servo's machine code, or compile it on a machine's first use."""
    servo = Servo(pepper, pepper.neutral(), RATE, Scene(), command_timeout=math.inf)
    if "CameraTop_frame" in pepper.frame_names:
        servo.set_target(LookAt((1.0, 0.1, 1.0)))
    servo.step()


class Follower:
    """Servo that follows tasks from the robot's present posture.

    Args:
        pepper: Model of the robot.
        q: Joint positions at rest [rad or m], shape (n,).
        scene: Obstacles to avoid, besides the robot itself.
    """

    def __init__(self, pepper: PepperModel, q: Array, scene: Scene) -> None:
        inside = np.clip(q, pepper.lower_limits, pepper.upper_limits)
        self._servo = Servo(pepper, inside, RATE, scene, command_timeout=math.inf)
        self._owed, self._eager = 0.0, False
        self._rested = 0
        self._least, self._lost, self._met = math.inf, 0, 0

    def aim(self, tasks: list[Task]) -> None:
        """Set the tasks; an empty list stops the robot."""
        self._expect()
        if tasks:
            self._servo.set_target(tasks)
        else:
            self._servo.stop()
        self._eager = True

    def set_scene(self, scene: Scene) -> None:
        """Set the scene."""
        self._expect()
        self._servo.set_scene(scene)

    def _expect(self) -> None:
        self._rested, self._least, self._lost, self._met = 0, math.inf, 0, 0

    @property
    def arrived(self) -> bool:
        """Whether the targets have been met for a while, not only in passing."""
        return self._met >= _ARRIVED_TICKS

    @property
    def stalled(self) -> bool:
        """Whether the error no longer decreases before the targets are met; joints may still drift."""
        return self._lost >= _STALL_TICKS

    @property
    def resting(self) -> bool:
        """Whether all joints have been at rest for a while, so that ticks may pause."""
        return self._rested >= _REST_TICKS

    @property
    def wait(self) -> float:
        """Time until the next tick is due [s]."""
        return 0.0 if self._hasty else max(0.0, 1.0 - self._owed) / RATE

    @property
    def _hasty(self) -> bool:
        return self._eager and self._owed >= 0.0

    def advance(self, seconds: float) -> tuple[ServoState, Array] | None:
        """Let time pass, and do the ticks that are due.

        After new tasks the first tick comes early, and the next one later by the same time.

        Args:
            seconds: Time to pass [s].

        Returns:
            The servo's state and the accelerations of the last tick, shape (n,); None if none was due.
        """
        self._owed = min(self._owed + seconds * RATE, float(MOST_TICKS))
        done = None
        while (self._owed >= 1.0 or self._hasty) and not self.resting:
            self._owed, self._eager = self._owed - 1.0, False
            done = self._tick()
        return done

    def _tick(self) -> tuple[ServoState, Array]:
        """Do one tick of the servo; return its state and the accelerations, shape (n,)."""
        before = self._servo.v
        state = self._servo.step()
        self._rested = self._rested + 1 if float(np.abs(state.v).max()) < _STILL else 0
        error = sum(state.errors)
        met = state.status is ServoStatus.ARRIVED
        self._met = self._met + 1 if met else 0
        if met or error < self._least - _GAIN:
            self._least, self._lost = error, 0
        else:
            self._lost += 1
        return state, (state.v - before) * RATE
