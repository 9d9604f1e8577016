"""ALRobotPosture: postures of the whole body."""

from __future__ import annotations

import numpy as np

from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import HANDS
from pepper_kin.naoqi.module import Module

POSTURES = ("Stand", "StandInit", "StandZero", "Crouch", "Rest")
"""Postures of NAOqi, which have the same names in the model."""

OF_NAO = ("LyingBack", "LyingBelly", "Sit", "SitRelax")
"""Postures that only NAO can take."""

NEAR = 0.12
"""Largest deviation of a joint at which a posture counts as reached [rad]."""

ARRIVAL = 1.0
"""Maximum time for the joints to arrive after their commands [s]."""


class ALRobotPosture(Module):
    """Postures: the present one, and motions to others."""

    name = "ALRobotPosture"

    def goToPosture(self, postureName: str, maxSpeedFraction: float) -> bool:
        """Go to a posture at a fraction of the maximum speed; return whether it was reached."""
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
        """Return the largest deviation of a joint from a posture [rad]; hands do not count."""
        q, k = self.body.pepper.posture(posture), self.body.index
        places = [k[name] for name in k if name not in HANDS]
        return float(np.abs(self.body.state.position[places] - q[places]).max())
