"""ALMotion: methods for the base."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.naoqi.base_tasks import MoveToTask, VelocityTask
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import BASE_RESOURCES
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.twin.base import OmniBase, arc_moved, pepper_base

MOVE_CONFIG = {
    "MaxVelXY": ("linear_velocity", 0.1, 0.55),
    "MaxVelTheta": ("angular_velocity", 0.2, 2.0),
    "MaxAccXY": ("linear_acceleration", 0.1, 0.55),
    "MaxAccTheta": ("angular_acceleration", 0.1, 3.0),
    "MaxJerkXY": (None, 0.2, 5.0),
    "MaxJerkTheta": (None, 0.2, 50.0),
}
"""Key of a move configuration -> limit of the base, minimum and maximum (Aldebaran's documents)."""

JERKS = {"MaxJerkXY": 1.0, "MaxJerkTheta": 2.0}

NO_FEET = "Pepper has wheels and no feet"

HALF_STANCE = 0.05
"""Half of the distance between NAO's feet, whose steps the base follows [m]."""


class Pose(NamedTuple):
    """A planar pose: x, y [m], yaw [rad]."""

    x: float
    y: float
    yaw: float

    def moved(self, x: float, y: float, yaw: float) -> Pose:
        """Return this pose composed with x, y, yaw in its own frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Pose(self.x + cos * x - sin * y, self.y + sin * x + cos * y, self.yaw + yaw)


def middle(left: Pose, right: Pose) -> Pose:
    """Return the mean pose of two feet."""
    return Pose((left.x + right.x) / 2.0, (left.y + right.y) / 2.0, (left.yaw + right.yaw) / 2.0)


class BaseMethods(Module):
    """Methods of ALMotion for the base."""

    def move(self, x: float, y: float, theta: float, moveConfig: Any = None) -> None:
        """Move with a velocity [m/s, m/s, rad/s] until `stopMove`; return at once."""
        self._go("move", (x, y, theta), moveConfig)

    def moveToward(self, x: float, y: float, theta: float, moveConfig: Any = None) -> None:
        """Move with fractions (-1 to 1) of the maximum velocity until `stopMove`; return at once."""
        method = "moveToward"
        shares = [self.number(method, "velocity", value) for value in (x, y, theta)]
        if max(map(abs, shares)) > 1.0:
            raise self.fail(method, f"velocity: got {shares}, expected shares between -1 and 1")
        geometry = self._configured(method, moveConfig).geometry
        fastest = (geometry.linear_velocity, geometry.linear_velocity, geometry.angular_velocity)
        self._go(method, [a * b for a, b in zip(shares, fastest, strict=True)], moveConfig)

    def setWalkTargetVelocity(self, x: float, y: float, theta: float, frequency: float, *_: Any) -> None:
        """Move with fractions of the maximum velocity; the frequency of steps is ignored."""
        self.number("setWalkTargetVelocity", "frequency", frequency)
        self.moveToward(x, y, theta)

    def moveTo(self, *arguments: Any) -> bool:
        """Move to a pose in FRAME_ROBOT; return when the motion has ended.

        Forms: (x, y, theta), with a duration [s], with a configuration, with both; for NAO
        ([[x, y, theta], ...]), each pose in the frame of the previous one, with a configuration.

        Returns:
            Whether the base arrived.
        """
        places, duration, config = self._way("moveTo", arguments)
        self._configure("moveTo", config)
        with self.body.time.lock:
            self.stop_velocity()
            task = self.body.do(MoveToTask("moveTo", places, duration=duration))
        self.body.wait(task)
        return not task.killed and not task.error

    walkTo = moveTo

    def setFootSteps(self, legName: Any, footSteps: Any, timeList: Any, clearExisting: bool) -> None:
        """Move the base as a walk of NAO would, by steps [x, y, theta] from foot to foot; return at once."""
        method = "setFootSteps"
        times = self.numbers(method, "timeList", timeList)
        self._walk(method, legName, footSteps, times[-1] if times else None)

    def setFootStepsWithSpeed(
        self, legName: Any, footSteps: Any, fractionMaxSpeed: Any, clearExisting: bool
    ) -> None:
        """Move the base as a walk of NAO would; return when the motion has ended."""
        method = "setFootStepsWithSpeed"
        self.numbers(method, "fractionMaxSpeed", fractionMaxSpeed)
        self.body.wait(self._walk(method, legName, footSteps, None))

    def getFootSteps(self) -> list[Any]:
        """Return the remaining steps, of which there are none."""
        self.robot_refuses("getFootSteps", NO_FEET)
        return [[], [], []]

    def getFootGaitConfig(self, config: str) -> list[list[Any]]:
        """Return the configuration of steps, which is empty without feet."""
        self.robot_refuses("getFootGaitConfig", NO_FEET)
        return []

    def _walk(self, method: str, legs: Any, steps: Any, duration: float | None) -> BodyTask:
        """Start a motion of the base to the mean pose of the feet after NAO's last step."""
        self.robot_refuses(method, NO_FEET)
        feet = {"LLeg": Pose(0.0, HALF_STANCE, 0.0), "RLeg": Pose(0.0, -HALF_STANCE, 0.0)}
        places = []
        for leg, step in zip(legs, steps, strict=False):
            if leg not in feet:
                raise self.fail(method, f"legName: got {quoted(leg)}, expected LLeg or RLeg")
            support = feet["RLeg" if leg == "LLeg" else "LLeg"]
            feet[leg] = support.moved(*self.numbers(method, "footSteps", step, 3))
            places.append(list(middle(feet["LLeg"], feet["RLeg"])))
        if not places:
            raise self.fail(method, "footSteps: got an empty list")
        with self.body.time.lock:
            self.stop_velocity()
            return self.body.do(MoveToTask(method, places[-1:], duration=duration))

    def waitUntilMoveIsFinished(self) -> None:
        """Wait until the base has reached its pose and is at rest; return at once while a velocity drives."""

        def finished() -> bool:
            moves = self._moves()
            if moves:
                return not any(
                    isinstance(t, MoveToTask) or (isinstance(t, VelocityTask) and not t.twist.any())
                    for t in moves
                )
            return bool(np.abs(self.body.controller.twist).max() < 1e-6)

        self.body.time.wait_until(finished)

    waitUntilWalkIsFinished = waitUntilMoveIsFinished

    def moveIsActive(self) -> bool:
        """Return whether the base moves or has a task."""
        with self.body.time.lock:
            return bool(self._moves()) or bool(np.abs(self.body.controller.twist).max() > 1e-6)

    walkIsActive = moveIsActive

    def stopMove(self) -> None:
        """Brake; return when the base is at rest, after 5 s at most."""
        with self.body.time.lock:
            self.body.tasks.stop(BASE_RESOURCES, self.body)
        self.body.time.wait_until(lambda: bool(np.abs(self.body.controller.twist).max() < 1e-6), 5.0)

    stopWalk = stopMove

    def killMove(self) -> None:
        """End the tasks of the base, which brakes; return at once."""
        with self.body.time.lock:
            self.body.tasks.stop(BASE_RESOURCES, self.body)

    killWalk = killMove

    def getMoveConfig(self, config: str) -> list[list[Any]]:
        """Return names and values of the "Max", "Min" or "Default" configuration."""
        if config not in ("Max", "Min", "Default"):
            raise self.fail("getMoveConfig", f"config: got {quoted(config)}, expected Max, Min or Default")
        geometry = pepper_base()
        rows = []
        for name, (limit, least, most) in MOVE_CONFIG.items():
            default = JERKS[name] if limit is None else float(getattr(geometry, limit))
            rows.append([name, {"Max": most, "Min": least, "Default": default}[config]])
        return rows

    def getRobotPosition(self, useSensors: bool) -> list[float]:
        """Return x, y [m] and yaw [rad] of the base in FRAME_WORLD."""
        with self.body.time.lock:
            return [float(x) for x in self.body.base_pose(bool(useSensors))]

    def getNextRobotPosition(self) -> list[float]:
        """Return the pose of the base after braking: x, y [m] and yaw [rad]."""
        with self.body.time.lock:
            twist, limits = self.body.controller.twist, self.body.controller.base.geometry
            speed = float(np.hypot(twist[0], twist[1])) / limits.linear_acceleration
            duration = max(speed, abs(float(twist[2])) / limits.angular_acceleration)
            return [float(x) for x in arc_moved(self.body.controller.pose, duration * twist / 2.0)]

    def getRobotVelocity(self) -> list[float]:
        """Return v_x, v_y [m/s] and omega [rad/s] in the axes of the base."""
        with self.body.time.lock:
            return [float(x) for x in self.body.controller.twist]

    def getMoveArmsEnabled(self, chainName: str = "Arms") -> bool:
        """Return whether the arms may move while the base does."""
        left, right = self._arms_while_moving
        return {"LArm": left, "RArm": right}.get(chainName, left and right)

    def setMoveArmsEnabled(self, leftArmEnabled: bool, rightArmEnabled: bool) -> None:
        """Set whether the arms may move while the base does."""
        self._arms_while_moving = (bool(leftArmEnabled), bool(rightArmEnabled))

    setWalkArmsEnabled = setMoveArmsEnabled

    def getWalkArmsEnabled(self) -> list[bool]:
        """Return whether the left and the right arm may move while the base does."""
        return list(self._arms_while_moving)

    _arms_while_moving = (True, True)

    # Tasks and arguments.

    def _moves(self) -> list[BodyTask]:
        return self.body.tasks.using(BASE_RESOURCES)

    def stop_velocity(self) -> None:
        """End a velocity task, so that a motion to a pose can start."""
        with self.body.time.lock:
            self.body.tasks.kill([t for t in self._moves() if isinstance(t, VelocityTask)], self.body)

    def _go(self, method: str, twist: Iterable[Any], config: Any) -> None:
        values = [self.number(method, "velocity", value) for value in twist]
        self._configure(method, config)
        with self.body.time.lock:
            self.body.tasks.kill([t for t in self._moves() if isinstance(t, MoveToTask)], self.body)
            self.body.do(VelocityTask(method, values))

    def _way(self, method: str, arguments: tuple[Any, ...]) -> tuple[list[list[float]], float | None, Any]:
        """Return poses, duration [s] and configuration of the arguments of `moveTo`."""
        if arguments and isinstance(arguments[0], list | tuple):
            first, rest = arguments[0], arguments[1:]
            rows, here, places = [first], Pose(0.0, 0.0, 0.0), []
            if first and isinstance(first[0], list | tuple):
                self.robot_refuses(method, "control points are for NAO")
                rows = list(first)
            for row in rows:
                here = here.moved(*self.numbers(method, "controlPoint", row, 3))
                places.append(list(here))
            return places, None, rest[0] if rest else None
        if len(arguments) < 3:
            raise self.fail(method, f"got {len(arguments)} arguments, expected x, y and theta")
        place = [self.number(method, "target", value) for value in arguments[:3]]
        duration, config = None, None
        for other in arguments[3:]:
            if isinstance(other, list | tuple):
                config = other
            else:
                duration = self.number(method, "time", other)
        return [place], duration, config

    def _configured(self, method: str, config: Any) -> OmniBase:
        """Return the base with the limits of a move configuration, and defaults for the rest."""
        changes = {}
        for row in config or ():
            if not isinstance(row, list | tuple) or len(row) != 2 or row[0] not in MOVE_CONFIG:
                known = ", ".join(MOVE_CONFIG)
                if isinstance(row, list | tuple) and len(row) == 2 and isinstance(row[0], str):
                    continue  # keys for the feet of NAO have no meaning here
                raise self.fail(method, f"moveConfig: got {quoted(row)}, expected pairs of these: {known}")
            limit, least, most = MOVE_CONFIG[row[0]]
            value = self.number(method, str(row[0]), row[1])
            if limit is not None:
                changes[limit] = float(np.clip(value, least, most))
        geometry = replace(pepper_base(), **changes)  # type: ignore[arg-type]
        return OmniBase(geometry)

    def _configure(self, method: str, config: Any) -> None:
        with self.body.time.lock:
            self.body.controller.base = self._configured(method, config)
