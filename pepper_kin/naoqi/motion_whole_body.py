"""ALMotion: whole-body methods, which the documents advise against on Pepper."""

from __future__ import annotations

from typing import Any

from pepper_kin import ik
from pepper_kin.naoqi.effectors import as_pose, commanded_posture, find_angles, space_pose
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import LEG
from pepper_kin.naoqi.joint_tasks import SpeedTask
from pepper_kin.naoqi.module import Module

WHOLE_BODY = "the documents say that the whole-body methods must not be used on Pepper"


class WholeBodyMethods(Module):
    """Whole-body methods of ALMotion."""

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._balanced = False
        self._controlled: set[str] = set()

    def wbEnable(self, isEnabled: bool) -> None:
        """Set whether the whole body keeps its balance; without effect on the twin."""
        self.robot_refuses("wbEnable", WHOLE_BODY)
        self._balanced = bool(isEnabled)

    def wbFootState(self, stateName: str, supportLeg: str) -> None:
        """Accept "Fixed", "Plane" or "Free", without effect: the base stands on its wheels."""
        self.robot_refuses("wbFootState", WHOLE_BODY)
        if stateName not in ("Fixed", "Plane", "Free"):
            raise self.fail(
                "wbFootState", f"stateName: got {quoted(stateName)}, expected Fixed, Plane or Free"
            )

    def wbEnableBalanceConstraint(self, isEnable: bool, supportLeg: str) -> None:
        """Set whether the center of mass is kept over the wheels; without effect on the twin."""
        self.robot_refuses("wbEnableBalanceConstraint", WHOLE_BODY)
        self._balanced = bool(isEnable)

    def wbGoToBalance(self, supportLeg: str, duration: float) -> None:
        """Bring the center of mass over the middle of the wheels by hip and knee; return when done.

        `supportLeg` and `duration` are ignored.
        """
        method = "wbGoToBalance"
        self.robot_refuses(method, WHOLE_BODY)
        self.number(method, "duration", duration)
        pepper, q = commanded_posture(self.body)
        result = ik.solve(pepper, [ik.CenterOfMassOverWheels(0.05)], q, joints=list(LEG), collisions=False)
        if not result.success:
            raise self.fail(method, result.advice)
        targets = {joint: float(result.q[pepper.joint_index(joint)]) for joint in LEG}
        self.body.wait(self.body.do(SpeedTask(method, targets, 0.3, reactive=False)))

    def wbEnableEffectorControl(self, effectorName: str, isEnabled: bool) -> None:
        """Set whether `wbSetEffectorControl` may move "Head", "LArm" or "RArm"."""
        self.robot_refuses("wbEnableEffectorControl", WHOLE_BODY)
        self._whole_body_effector("wbEnableEffectorControl", effectorName)
        (self._controlled.add if isEnabled else self._controlled.discard)(effectorName)

    def wbSetEffectorControl(self, effectorName: str, targetCoordinate: Any) -> None:
        """Move the head to an orientation [rad], or a hand to a point [m], in FRAME_ROBOT; return at once."""
        method = "wbSetEffectorControl"
        self.robot_refuses(method, WHOLE_BODY)
        self._whole_body_effector(method, effectorName)
        if effectorName not in self._controlled:
            raise self.fail(method, f"{effectorName} is not enabled: call wbEnableEffectorControl first")
        numbers = self.numbers(method, "targetCoordinate", targetCoordinate, 3)
        is_head = effectorName == "Head"
        values = [0.0, 0.0, 0.0, *numbers] if is_head else [*numbers, 0.0, 0.0, 0.0]
        with self.body.time.lock:
            origin = space_pose(self.body, 2, False, self.name, method)
            goal = {effectorName: (origin @ as_pose(values), 56 if is_head else 7)}
            self.body.do(SpeedTask(method, find_angles(self.body, goal, {}).angles, 0.3))

    def wbEnableEffectorOptimization(self, effectorName: str, isActive: bool) -> None:
        """Accept the call, without effect."""
        self.robot_refuses("wbEnableEffectorOptimization", WHOLE_BODY)
        self._whole_body_effector("wbEnableEffectorOptimization", effectorName)

    def _whole_body_effector(self, method: str, name: Any) -> None:
        if name not in ("Head", "LArm", "RArm"):
            raise self.fail(method, f"effectorName: got {quoted(name)}, expected Head, LArm or RArm")

    def updateTrackerTarget(
        self,
        pTargetPositionWy: float,
        pTargetPositionWz: float,
        pTimeSinceDetectionMs: int,
        pUseOfWholeBody: bool,
    ) -> None:
        """Turn the head by angles [rad] towards a detected target; return at once."""
        method = "updateTrackerTarget"
        pitch = self.number(method, "pTargetPositionWy", pTargetPositionWy)
        yaw = self.number(method, "pTargetPositionWz", pTargetPositionWz)
        with self.body.time.lock:
            targets = {
                "HeadYaw": self.body.commanded("HeadYaw") + yaw,
                "HeadPitch": self.body.commanded("HeadPitch") + pitch,
            }
            self.body.do(SpeedTask(method, targets, 0.3))
