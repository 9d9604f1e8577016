"""ALRobotPosture: postures of the whole body."""

from __future__ import annotations

import numpy as np

from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import HANDS
from pepper_kin.naoqi.module import Module

POSTURES = ("Stand", "StandInit", "StandZero", "Crouch", "Rest")
"""Postures of NAOqi, which the model has under the same names."""

OF_NAO = ("LyingBack", "LyingBelly", "Sit", "SitRelax")
"""Postures that NAO takes and Pepper cannot."""

NEAR = 0.12
"""The largest difference of a joint from the posture that the body counts as being in [rad]."""

ARRIVAL = 1.0
"""Joints come after their commands by at most this [s]."""


class ALRobotPosture(Module):
    """Postures: where the body is, and how it gets into another."""

    name = "ALRobotPosture"

    def goToPosture(self, postureName: str, maxSpeedFraction: float) -> bool:
        """Go to a posture with a share of the fastest speed; blocks; return whether it was reached."""
        share = self.share("goToPosture", "maxSpeedFraction", maxSpeedFraction)
        posture = self._posture("goToPosture", postureName)
        if posture is None:
            return False
        motion = self.broker.motion
        motion.killTasksUsingResources("JointActuators")
        motion.go_to_posture(posture, share, "goToPosture")
        return self.body.time.wait_until(lambda: self._difference(posture) < NEAR, ARRIVAL)

    applyPosture = goToPosture

    def stopMove(self) -> None:
        """End the motion to a posture."""
        with self.body.time.lock:
            tasks = [task for task in self.body.tasks if task.name == "goToPosture"]
            self.body.tasks.kill(tasks, self.body)

    def getPosture(self) -> str:
        """Return the name of the posture that the body is in, or "Unknown"."""
        with self.body.time.lock:
            nearest = min(POSTURES, key=self._difference)
            return nearest if self._difference(nearest) < NEAR else "Unknown"

    def _posture(self, method: str, name: object) -> str | None:
        known = {posture.lower(): posture for posture in POSTURES}
        found = known.get(str(name).lower())
        if found is None and name not in OF_NAO:
            raise self.fail(method, f"postureName: got {quoted(name)}, expected one of {', '.join(POSTURES)}")
        return found

    def _difference(self, posture: str) -> float:
        """Return the largest difference of a joint from a posture [rad]."""
        q, k = self.body.pepper.posture(posture), self.body.index
        places = [k[name] for name in k if name not in HANDS]
        return float(np.abs(self.body.state.position[places] - q[places]).max())
