"""ALNavigation and ALLocalization: motion around obstacles, and the pose of the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pepper_kin.model import load_pepper
from pepper_kin.motion import plan
from pepper_kin.naoqi.base_tasks import MoveToTask
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.motion_base import Pose

FARTHEST = 3.0
"""Maximum distance of a target of `navigateTo` [m] (Aldebaran's documents)."""

ARC = 0.2
"""Maximum angle of an arc that is approximated by a line [rad]."""

NO_MAP = "the twin keeps no map; its place is known"


class ALNavigation(Module):
    """Motion of the base to poses, around the obstacles of the scene."""

    name = "ALNavigation"
    not_simulated = dict.fromkeys(
        (
            "explore", "saveExploration", "loadExploration", "getMetricalMap", "getExplorationPath",
            "startMapping", "computePathInMap", "setDefaultExploration",
        ),
        NO_MAP,
    )  # fmt: skip

    def navigateTo(self, x: float, y: float, *arguments: Any) -> bool:
        """Move to a pose in FRAME_ROBOT, within 3 m, around obstacles; return whether the base arrived."""
        method = "navigateTo"
        place = [self.number(method, "x", x), self.number(method, "y", y)]
        theta = (
            self.number(method, "theta", arguments[0]) if arguments and not _is_config(arguments[0]) else 0.0
        )
        if math.hypot(*place) > FARTHEST:
            raise self.fail(
                method, f"the target is {math.hypot(*place):.3g} m away, expected at most {FARTHEST:g} m"
            )
        return self._go(Pose(*self.body.base_pose(False)).moved(place[0], place[1], theta))

    def navigateToInMap(self, target: Any) -> bool:
        """Move to a pose in the world, around obstacles; return whether the base arrived."""
        x, y, *theta = self.numbers("navigateToInMap", "target", target)
        return self._go([x, y, theta[0] if theta else float(self.body.base_pose(False)[2])])

    def moveAlong(self, trajectory: Any) -> bool:
        """Move along "Holonomic" parts with "Line" or "Circle" paths; return whether the base arrived."""
        places = self._places("moveAlong", trajectory)
        self.broker.motion.stop_velocity()
        return self._arrived(MoveToTask("moveAlong", places))

    def findFreeZone(self, desiredRadius: float, maximumDisplacement: float) -> list[Any]:
        """Return [0, radius, [x, y]] [m] of the free zone around the robot; 1 if it is below the desired."""
        desired = self.number("findFreeZone", "desiredRadius", desiredRadius)
        x, y, _ = self.body.base_pose(True)
        nearest = self.body.nearest_obstacle(desired)
        radius = desired if nearest is None else min(desired, math.hypot(nearest[0] - x, nearest[1] - y))
        return [int(radius < desired), radius, [float(x), float(y)]]

    getFreeZone = stopAndComputeFreeZone = findFreeZone

    def stopNavigateTo(self) -> None:
        """Brake."""
        self.broker.motion.stopMove()

    def relocalizeInMap(self, estimation: Any) -> list[Any]:
        """Return [0, [pose, uncertainty]] of the base; the estimation is ignored."""
        return [0, [self.getRobotPositionInMap()[0], [0.0, 0.0, 0.0]]]

    def getRobotPositionInMap(self) -> list[list[float]]:
        """Return [[x, y, yaw], uncertainty] of the base in the world [m, rad]."""
        return [[float(v) for v in self.body.base_pose(True)], [0.0, 0.0, 0.0]]

    def _go(self, goal: Sequence[float]) -> bool:
        """Move to a pose in the world, in a scene along a planned path; return whether the base arrived."""
        self.broker.motion.stop_velocity()
        places = [np.asarray(goal)]
        if self.body.scene is not None:
            path = self._path(goal)
            if path is None:
                return False
            places = path
        protected, self.body.move_protected = self.body.move_protected, False  # the path avoids obstacles
        try:
            return self._arrived(MoveToTask("navigateTo", places, world=True))
        finally:
            self.body.move_protected = protected

    def _arrived(self, task: MoveToTask) -> bool:
        """Run a task of the base to its end; return whether it arrived."""
        self.body.wait(self.body.do(task))
        return not task.error and not task.killed

    def _path(self, goal: Sequence[float]) -> list[Any] | None:
        """Return the poses of a path of the base around the obstacles, or None if none was found."""
        pepper = load_pepper(base="planar")
        posture = {
            name: self.body.commanded(name) for name in pepper.joint_names if not name.startswith("Base")
        }
        start = pepper.joint_vector(
            {**posture, **dict(zip(pepper.joint_names[:3], self.body.base_pose(False), strict=True))}
        )
        start = np.clip(start, pepper.lower_limits, pepper.upper_limits)
        end = start.copy()
        end[:3] = goal
        found = plan(pepper, start, end, self.body.scene, joints=list(pepper.joint_names[:3]), margin=0.03)
        return [row[:3] for row in found.path[1:]] if found.path is not None else None

    def _places(self, method: str, trajectory: Any) -> list[list[float]]:
        """Return the poses of a trajectory's parts, in the frame of its start."""
        if not isinstance(trajectory, list | tuple) or not trajectory:
            raise self.fail(method, f"trajectory: got {quoted(trajectory)}, expected a list")
        if trajectory[0] == "Composed":
            places = [Pose(0.0, 0.0, 0.0)]
            for part in trajectory[1:]:
                begin = places[-1]
                places += [begin.moved(*place) for place in self._places(method, part)]
            return [list(place) for place in places[1:]]
        path = trajectory[1] if trajectory[0] == "Holonomic" and len(trajectory) > 2 else None
        if not isinstance(path, list | tuple) or len(path) < 2 or path[0] not in ("Line", "Circle"):
            raise self.fail(
                method,
                f"got {quoted(trajectory)}, expected Composed or Holonomic parts with a Line or a Circle",
            )
        theta = self.number(method, "theta", trajectory[2])
        x, y = self.numbers(method, str(path[0]), path[1], 2)
        if path[0] == "Line":
            return [[x, y, theta]]
        span = self.number(method, "angle of the circle", path[2] if len(path) > 2 else None)
        shares = np.linspace(0.0, 1.0, 1 + math.ceil(1 + abs(span) / ARC))[1:]
        turned = [Pose(x, y, float(share * span)).moved(-x, -y, 0.0) for share in shares]
        return [[p[0], p[1], float(share * theta)] for p, share in zip(turned, shares, strict=True)]


class ALLocalization(Module):
    """The pose of the robot relative to its home."""

    name = "ALLocalization"
    not_simulated = dict.fromkeys(("learnHomeFromPanorama", "getPanorama", "getLandmarks"), NO_MAP)

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._home = np.zeros(3)
        self._learnt = False

    def learnHome(self) -> int:
        """Set the present pose as home; return 0."""
        self._home, self._learnt = self.body.base_pose(True), True
        return 0

    def isDataAvailable(self) -> bool:
        """Return whether a home was set."""
        return self._learnt

    def isInCurrentHome(self) -> list[Any]:
        """Return [0, whether the robot is within half a meter of its home]."""
        return [0, bool(np.hypot(*(self.body.base_pose(True) - self._home)[:2]) < 0.5)]

    def goToHome(self) -> int:
        """Move to the home; return 0, or 1 if the base did not arrive."""
        return self.goToPosition([0.0, 0.0, 0.0])

    def goToPosition(self, position: Any) -> int:
        """Move to a pose relative to home; return 0, or 1 if the base did not arrive."""
        x, y, *theta = self.numbers("goToPosition", "position", position)
        goal = Pose(*self._home).moved(x, y, theta[0] if theta else 0.0)
        return 0 if self.broker.module("ALNavigation").navigateToInMap(goal) else 1

    def getRobotPosition(self, *_: Any) -> list[float]:
        """Return x, y [m] and yaw [rad] relative to home."""
        moved = self.body.base_pose(True) - self._home
        cos, sin = math.cos(self._home[2]), math.sin(self._home[2])
        turn = math.remainder(float(moved[2]), 2.0 * math.pi)
        return [float(cos * moved[0] + sin * moved[1]), float(cos * moved[1] - sin * moved[0]), turn]

    def getRobotOrientation(self, *_: Any) -> list[Any]:
        """Return [0, [yaw relative to home, uncertainty]] [rad]."""
        return [0, [self.getRobotPosition()[2], 0.0]]

    def stopAll(self) -> None:
        """Brake."""
        self.broker.motion.stopMove()

    def clear(self, *_: Any) -> int:
        """Remove the home; return 0."""
        self._home, self._learnt = np.zeros(3), False
        return 0


def _is_config(value: Any) -> bool:
    return isinstance(value, list | tuple)


MODULES = (ALNavigation, ALLocalization)
