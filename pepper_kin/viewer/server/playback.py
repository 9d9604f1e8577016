"""Playback of a motion at any time and speed."""

from __future__ import annotations

from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.viewer.joint_motion import JointMotion
from pepper_kin.viewer.server.readings import rates

SLOWEST, FASTEST = 0.05, 8.0


class Playback:
    """A motion and its present time.

    Args:
        motion: Joint positions over time.
    """

    def __init__(self, motion: JointMotion) -> None:
        self.motion = motion
        self._velocity, self._acceleration = rates(motion)
        self.start, self.end = float(motion.times[0]), float(motion.times[-1])
        self.time = self.start
        self.speed = 1.0
        self.playing = False
        self.loop = False

    def play(self) -> None:
        """Play on, from the start if the end was reached."""
        if self.time >= self.end:
            self.time = self.start
        self.playing = self.end > self.start

    def seek(self, time: float) -> None:
        """Go to a time [s], clipped to the motion's interval."""
        self.time = min(max(time, self.start), self.end)

    def set_speed(self, speed: float) -> None:
        """Set the speed of the playback, 1 for real time.

        Raises:
            InvalidValueError: for a speed outside `SLOWEST` to `FASTEST`.
        """
        if not SLOWEST <= speed <= FASTEST:
            raise InvalidValueError("speed", speed, f"a factor in {SLOWEST:g} ... {FASTEST:g}")
        self.speed = float(speed)

    def advance(self, seconds: float) -> None:
        """Advance by wall time [s]; stop at the end, or start again in a loop."""
        if not self.playing:
            return
        self.time += seconds * self.speed
        if self.time >= self.end:
            over = (self.time - self.start) % (self.end - self.start)
            self.time = self.start + over if self.loop else self.end
            self.playing = self.loop

    def state(self) -> tuple[Array, Array, Array]:
        """Return the present joint positions, velocities and accelerations, shape (n,) each."""
        times = self.motion.times
        after = int(np.clip(np.searchsorted(times, self.time), 1, max(times.size - 1, 1)))
        before = after - 1
        if times.size == 1:
            return self.motion.positions[0], self._velocity[0], self._acceleration[0]
        share = (self.time - times[before]) / (times[after] - times[before])
        q, v, a = (
            (1 - share) * values[before] + share * values[after]
            for values in (self.motion.positions, self._velocity, self._acceleration)
        )
        return q, v, a

    def as_dict(self) -> dict[str, Any]:
        """Return the state of the playback as values for JSON."""
        return {
            "time": round(self.time, 4), "playing": self.playing, "speed": self.speed, "loop": self.loop,
        }  # fmt: skip
