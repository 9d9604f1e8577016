"""ALMotion: stiffness, joints and hands."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.files.choregraphe import naoqi_timeline
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import ACTUATED, BODY, HANDS, LEG, WHEELS, names_of
from pepper_kin.naoqi.joint_tasks import CurveTask, SpeedTask, StiffnessTask
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.trajectory.key_curve import Key

PEAK = 1.5
"""Ratio of the maximum to the mean speed of a cubic from rest to rest."""


class JointMethods(Module):
    """Methods of ALMotion for stiffness, joints and hands."""

    def wakeUp(self) -> None:
        """Switch the motors on and go to the posture StandInit."""
        self.body.set_stiffness(dict.fromkeys(BODY, 1.0))
        self.body.awake = True
        self.broker.memory.insert("robotIsWakeUp", True)
        self.go_to_posture("StandInit", 0.5, "wakeUp")

    def rest(self, chain: str | None = None) -> None:
        """Go to the posture Rest and switch the motors off; with a chain, only switch its motors off."""
        if chain is not None:
            names = names_of(chain, self.name, "rest", wheels=False)
            self.body.set_stiffness(dict.fromkeys([n for n in names if n not in LEG], 0.0))
            return
        self.killAll()
        self.go_to_posture("Rest", 0.5, "rest")
        # The brakes of the leg hold it when its motors are off.
        self.body.set_stiffness({name: 0.0 for name in ACTUATED if name not in LEG})
        self.body.awake = False
        self.broker.memory.insert("robotIsWakeUp", False)

    def robotIsWakeUp(self) -> bool:
        """Return whether the motors are on."""
        return self.body.awake

    def stiffnessInterpolation(self, names: Any, stiffnessLists: Any, timeLists: Any) -> None:
        """Change the stiffness of joints along lines in time; return when done."""
        method = "stiffnessInterpolation"
        joints = names_of(names, self.name, method)
        self._check_lower_body(method, joints)
        values = self._lists(method, "stiffnessLists", stiffnessLists, len(joints))
        times = self._lists(method, "timeLists", timeLists, len(joints))
        keys = {}
        for joint, at, stiffness in zip(joints, times, values, strict=True):
            self._check_times(method, joint, at, stiffness)
            keys[joint] = (at, [min(max(x, 0.0), 1.0) for x in stiffness])
        self.body.wait(self.body.do(StiffnessTask(keys)))

    def setStiffnesses(self, names: Any, stiffnesses: Any) -> None:
        """Set the stiffness of joints, 0 (off) to 1, within the next cycle."""
        method = "setStiffnesses"
        joints = names_of(names, self.name, method)
        self._check_lower_body(method, joints)
        values = self.numbers(method, "stiffnesses", stiffnesses)
        if len(values) == 1:
            values *= len(joints)
        if len(values) != len(joints):
            raise self.fail(method, f"stiffnesses: got {len(values)} numbers for {len(joints)} joints")
        with self.body.time.lock:
            self.body.set_stiffness(
                {joint: min(max(value, 0.0), 1.0) for joint, value in zip(joints, values, strict=True)}
            )

    def getStiffnesses(self, jointName: Any) -> list[float]:
        """Return the stiffness of joints."""
        return [self.body.stiffness[name] for name in names_of(jointName, self.name, "getStiffnesses")]

    def angleInterpolation(self, names: Any, angleLists: Any, timeLists: Any, isAbsolute: bool) -> None:
        """Move joints through angles [rad] at times [s]; return when done.

        The motion starts and ends at rest, has zero velocity where an angle is an extremum, and does not
        overshoot.
        """
        method = "angleInterpolation"
        joints = names_of(names, self.name, method, wheels=False)
        angles = self._lists(method, "angleLists", angleLists, len(joints))
        times = self._lists(method, "timeLists", timeLists, len(joints))
        keys = {}
        for joint, at, values in zip(joints, times, angles, strict=True):
            self._check_times(method, joint, at, values)
            keys[joint] = tuple(Key(t, value) for t, value in zip(at, values, strict=True))
        self.body.wait(self.body.do(CurveTask(method, keys, relative=not isAbsolute)))

    def angleInterpolationWithSpeed(self, names: Any, targetAngles: Any, maxSpeedFraction: float) -> None:
        """Move joints to angles [rad], arriving together, at a fraction of the maximum speed; wait for it."""
        method = "angleInterpolationWithSpeed"
        joints = names_of(names, self.name, method, wheels=False)
        angles = self._targets(method, "targetAngles", targetAngles, joints)
        share = self.share(method, "maxSpeedFraction", maxSpeedFraction)
        self.move_together(method, dict(zip(joints, angles, strict=True)), share)

    def angleInterpolationBezier(self, jointNames: Any, times: Any, controlPoints: Any) -> None:
        """Move joints along Bezier curves through keys with handles (Choregraphe's export); wait for it."""
        method = "angleInterpolationBezier"
        joints = names_of(jointNames, self.name, method, wheels=False)
        try:
            timeline = naoqi_timeline(joints, times, controlPoints)
        except (InvalidValueError, TypeError) as error:
            raise self.fail(method, str(error)) from error
        keys = {curve.joint: curve.keys for curve in timeline.curves}
        self.body.wait(self.body.do(CurveTask(method, keys)))

    def setAngles(self, names: Any, angles: Any, fractionMaxSpeed: float) -> None:
        """Move joints towards angles [rad] at a fraction of the maximum speed; return at once."""
        method = "setAngles"
        joints = names_of(names, self.name, method, wheels=False)
        values = self._targets(method, "angles", angles, joints)
        share = self.share(method, "fractionMaxSpeed", fractionMaxSpeed)
        self.body.do(SpeedTask(method, dict(zip(joints, values, strict=True)), share))

    def changeAngles(self, names: Any, changes: Any, fractionMaxSpeed: float) -> None:
        """Move joints by changes [rad] from their commanded angles; return at once."""
        method = "changeAngles"
        joints = names_of(names, self.name, method, wheels=False)
        values = self._targets(method, "changes", changes, joints)
        share = self.share(method, "fractionMaxSpeed", fractionMaxSpeed)
        with self.body.time.lock:
            targets = {
                joint: self.body.commanded(joint) + change
                for joint, change in zip(joints, values, strict=True)
            }
            self.body.do(SpeedTask(method, targets, share))

    def getAngles(self, names: Any, useSensors: bool) -> list[float]:
        """Return the angles of joints [rad], measured or commanded."""
        joints = names_of(names, self.name, "getAngles")
        with self.body.time.lock:
            read = self.body.measured if useSensors else self.body.commanded
            return [read(joint) for joint in joints]

    def _move_hand(self, method: str, hand: Any, value: float) -> None:
        if hand not in HANDS:
            raise self.fail(method, f"handName: got {quoted(hand)}, expected one of {', '.join(HANDS)}")
        self.move_together(method, {hand: self.body.clipped(hand, value)}, 0.25)

    def move_together(
        self, method: str, targets: dict[str, float], share: float, *, protected: bool = True
    ) -> None:
        """Move joints to angles at a fraction of the maximum speed, arriving together; return when done.

        Args:
            method: Name of the called method.
            targets: Joint -> angle [rad or fraction].
            share: Fraction of the maximum speed, above 0 and at most 1.
            protected: Whether the arms are protected from collisions.
        """
        body = self.body
        with body.time.lock:
            longest = max(
                abs(body.clipped(joint, angle) - body.commanded(joint))
                / (share * body.velocity_limits[joint])
                for joint, angle in targets.items()
            )
            duration = max(PEAK * longest, CYCLE)
            keys = {joint: (Key(duration, body.clipped(joint, angle)),) for joint, angle in targets.items()}
            task = CurveTask(method, keys)
            task.protected = protected
            body.do(task)
        body.wait(task)

    def go_to_posture(self, posture: str, share: float, method: str) -> None:
        """Move all joints to a posture of the model, without protection of the arms; return when done."""
        q = self.body.pepper.posture(posture)
        targets = {name: float(q[k]) for name, k in self.body.index.items()}
        self.move_together(method, targets, share, protected=False)

    # Reading arguments.

    def _check_lower_body(self, method: str, joints: Sequence[str]) -> None:
        if any(joint in LEG or joint in WHEELS for joint in joints) and set(joints) != set(BODY):
            self.robot_refuses(method, "the stiffness of Pepper's lower body cannot be changed by itself")

    def _targets(self, method: str, quantity: str, value: Any, joints: list[str]) -> list[float]:
        """Return a target for each joint: one number counts for all, numbers of wheels are dropped."""
        values = self.numbers(method, quantity, value)
        if len(values) == 1 and len(joints) > 1:
            values *= len(joints)
        if len(values) == len(joints) + len(WHEELS):
            values = values[: len(joints)]  # the values of the wheels, which hold no position, are dropped
        if len(values) != len(joints):
            raise self.fail(method, f"{quantity}: got {len(values)} numbers for {len(joints)} joints")
        return values

    def _lists(self, method: str, quantity: str, value: Any, count: int) -> list[list[float]]:
        """Return a list of numbers for each joint, from any form that the robot accepts."""
        if not isinstance(value, Iterable) or isinstance(value, str | bytes | dict):
            return [[self.number(method, quantity, value)] for _ in range(count)]
        rows = list(value)
        if not rows:
            raise self.fail(method, f"{quantity}: got an empty list")
        nested = [isinstance(row, Iterable) and not isinstance(row, str | bytes) for row in rows]
        if not any(nested):
            numbers = self.numbers(method, quantity, rows)
            if count == 1:
                return [numbers]
            if len(numbers) == 1:
                return [list(numbers) for _ in range(count)]
            rows = [[number] for number in numbers]
        if len(rows) == 1 and count > 1:
            rows *= count
        if len(rows) == count + len(WHEELS):
            rows = rows[:count]
        if len(rows) != count:
            raise self.fail(method, f"{quantity}: got {len(rows)} lists for {count} joints")
        return [self.numbers(method, quantity, row) for row in rows]

    def _check_times(self, method: str, joint: str, times: Sequence[float], values: Sequence[float]) -> None:
        if len(times) != len(values):
            raise self.fail(method, f"{joint}: got {len(values)} values and {len(times)} times")
        if times[0] <= 0 or any(b <= a for a, b in itertools.pairwise(times)):
            raise self.fail(
                method, f"{joint}: got the times {list(times)[:8]}, expected times above 0 that rise"
            )
