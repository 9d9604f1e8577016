"""ALTracker: looking and pointing at points, and following targets with known positions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.base_tasks import MoveToTask
from pepper_kin.naoqi.body import Body
from pepper_kin.naoqi.effectors import CHAIN_JOINTS, commanded_posture, space_pose
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.joint_names import BASE_RESOURCES, HEAD, LEG
from pepper_kin.naoqi.joint_tasks import SpeedTask
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.tasks import BodyTask

MODES = ("Head", "BodyRotation", "WholeBody", "Move", "Navigate", "WholeBodyRotation")

ARMS: dict[str, tuple[str, ...]] = {
    "None": (),
    "LArm": ("LArm",),
    "RArm": ("RArm",),
    "Arms": ("LArm", "RArm"),
}
"""Name of an effector -> arms that point."""

NEAR = 0.15
"""Deviation from the distance to the target up to which the base stays [m]."""


class TrackTask(BodyTask):
    """Follow a target with head and arms, and with the base in the modes that move it.

    Joints that another task uses or waits for are left to that task.

    Args:
        tracker: The tracker, which knows the target's position.
        target: Name of the target.
        effector: Arms that point at the target: "LArm", "RArm", "Arms" or "None".
    """

    def __init__(self, tracker: ALTracker, target: str, effector: str) -> None:
        super().__init__("track", ())
        self.tracker, self.target, self.effector = tracker, target, effector
        self._motion = SpeedTask("track", {}, 0.3)
        self._count = 0

    def step(self, body: Body) -> bool:
        """Aim head and arms at the target again, five times a second."""
        point = self.tracker.place_of(self.target)
        if point is None:
            return True
        taken = {name for task in body.tasks if task is not self for name in task.resources}
        if self._count % 10 == 0:
            angles = {} if taken.issuperset(HEAD) else gaze_angles(body, point)
            angles |= pointing_angles(body, point, self.effector)
            self._motion = SpeedTask("track", angles, 0.3)
            self._motion.start(body)
            self._drive(body, point)
        self._count += 1
        self._motion.resources -= taken
        self.resources = self._motion.resources
        self._motion.step(body)
        return True

    def _drive(self, body: Body, point: Array) -> None:
        """Drive toward a point of the world [m], shape (3,), as the tracking mode requires."""
        mode = self.tracker.getMode()
        if mode in ("Head", "WholeBody"):
            return
        x, y, yaw = body.base_pose(False)
        bearing = math.atan2(point[1] - y, point[0] - x)
        turn = math.remainder(bearing - yaw, 2.0 * math.pi)
        goal = [x, y, yaw + turn]
        far = math.hypot(point[0] - x, point[1] - y) - self.tracker.distance
        if mode in ("Move", "Navigate") and abs(far) > NEAR:
            goal = [x + far * math.cos(bearing), y + far * math.sin(bearing), bearing]
        elif abs(turn) < 0.3:
            return
        if not body.tasks.using(BASE_RESOURCES):
            body.do(MoveToTask("trackMove", [goal], world=True))


def gaze_angles(body: Body, point: Array, *, whole_body: bool = False) -> dict[str, float]:
    """Return the angles [rad] of the head (and the leg) that turn the top camera to a point.

    Args:
        body: The simulated body.
        point: Point in the world [m], shape (3,).
        whole_body: Whether hip and knee turn, too.
    """
    pepper, q, place = _seen_from_the_base(body, point)
    joints = [*HEAD, *LEG] if whole_body else list(HEAD)
    result = ik.solve(pepper, [ik.LookAt(place)], q, joints=joints, collisions=False, restarts=4)
    return {joint: float(result.q[pepper.joint_index(joint)]) for joint in joints}


def pointing_angles(body: Body, point: Array, effector: str) -> dict[str, float]:
    """Return the angles [rad] of the arms that point at a point; empty for "None".

    Args:
        body: The simulated body.
        point: Point in the world [m], shape (3,).
        effector: "LArm", "RArm", "Arms" or "None".
    """
    pepper, q, place = _seen_from_the_base(body, point)
    angles: dict[str, float] = {}
    for arm in ARMS[effector]:
        hand, joints = "left" if arm == "LArm" else "right", list(CHAIN_JOINTS[arm])
        result = ik.solve(pepper, [ik.PointAt(hand, place)], q, joints=joints, collisions=False)
        angles |= {joint: float(result.q[pepper.joint_index(joint)]) for joint in joints}
    return angles


def _seen_from_the_base(body: Body, point: Array) -> tuple[PepperModel, Array, Array]:
    """Return a fixed-base Pepper, its commanded angles, shape (n,), and a point in its base frame [m].

    Args:
        body: The simulated body, whose base may have moved.
        point: Point in the world [m], shape (3,).
    """
    inverse = np.linalg.inv(body.frame_pose("base_footprint", False))
    place = inverse[:3, :3] @ np.asarray(point, dtype=float) + inverse[:3, 3]
    return (*commanded_posture(body), place)


class ALTracker(Module):
    """Looking at, pointing at and following targets.

    The position of a target is set by `place_target`, or is that of the same-named object in the scene.
    """

    name = "ALTracker"

    def __init__(self, broker: Any) -> None:
        super().__init__(broker)
        self._targets: dict[str, Any] = {}
        self._places: dict[str, Array] = {}
        self._task: TrackTask | None = None
        self._relative = [-1.0, 0.0, 0.0, 0.1, 0.1, 0.3]

    @property
    def distance(self) -> float:
        """Distance of the base from a target [m]."""
        return math.hypot(self._relative[0], self._relative[1])

    def place_target(self, name: str, point: Any) -> None:
        """Set the position of a target in the world [m], in place of the detection of a face or a ball."""
        self._places[name] = np.asarray(self.numbers("place_target", "point", point, 3))

    def place_of(self, name: str) -> Array | None:
        """Return the position of a target in the world [m], or None if it is unknown."""
        if name in self._places:
            return self._places[name]
        scene = self.body.scene
        known = {} if scene is None else scene.objects
        return None if name not in known else np.asarray(known[name].transform_object_to_world[:3, 3])

    # Looking and pointing.

    def lookAt(self, position: Any, *arguments: Any) -> None:
        """Look at a point by (position, frame, fraction of speed, with the whole body); return when done."""
        method = "lookAt"
        frame, share, whole = self._look_arguments(method, arguments)
        with self.body.time.lock:
            angles = gaze_angles(self.body, self._point(method, position, frame), whole_body=whole)
        self.broker.motion.move_together(method, angles, share)

    def pointAt(self, effector: str, position: Any, *arguments: Any) -> None:
        """Point at a point with "LArm", "RArm" or "Arms" (frame, fraction of speed); return when done."""
        method = "pointAt"
        frame, maxSpeed = arguments if len(arguments) == 2 else (0, *arguments)
        if effector not in ("LArm", "RArm", "Arms"):
            raise self.fail(method, f"effector: got {quoted(effector)}, expected LArm, RArm or Arms")
        share = self.share(method, "maxSpeed", maxSpeed)
        with self.body.time.lock:
            angles = pointing_angles(self.body, self._point(method, position, frame), effector)
        self.broker.motion.move_together(method, angles, share)

    def _look_arguments(self, method: str, arguments: tuple[Any, ...]) -> tuple[int, float, bool]:
        if len(arguments) == 2:  # the old form: fraction of speed, with the whole body
            return 0, self.share(method, "fractionMaxSpeed", arguments[0]), bool(arguments[1])
        if len(arguments) != 3:
            raise self.fail(method, f"got {len(arguments) + 1} arguments, expected 3 or 4")
        return int(arguments[0]), self.share(method, "fractionMaxSpeed", arguments[1]), bool(arguments[2])

    def _point(self, method: str, position: Any, frame: int) -> Array:
        origin = space_pose(self.body, frame, False, self.name, method)
        point = np.asarray(self.numbers(method, "position", position)[:3])
        return np.asarray(origin[:3, :3] @ point + origin[:3, 3])

    # Following.

    def registerTarget(self, pTarget: str, pParams: Any) -> None:
        """Register a target ("Face", "RedBall", "People", an object of the scene) with its size."""
        self._targets[str(pTarget)] = pParams

    def unregisterTarget(self, pTarget: str) -> None:
        """Remove a target."""
        self._targets.pop(pTarget, None)

    def unregisterTargets(self, pTarget: Any) -> None:
        """Remove targets."""
        for name in pTarget:
            self.unregisterTarget(name)

    def unregisterAllTargets(self) -> None:
        """Remove all targets."""
        self._targets.clear()

    def getRegisteredTargets(self) -> list[str]:
        """Return the registered targets."""
        return list(self._targets)

    def getSupportedTargets(self) -> list[str]:
        """Return NAOqi's targets, and the targets and objects with a position."""
        scene = [] if self.body.scene is None else list(self.body.scene.objects)
        return ["RedBall", "Face", "LandMark", "LandMarks", "People", "Sound", *self._places, *scene]

    def track(self, pTarget: str) -> None:
        """Follow a registered target until `stopTracker`; return at once."""
        if pTarget not in self._targets:
            known = ", ".join(self._targets) or "(none)"
            raise self.fail("track", f"{quoted(pTarget)} is not registered; registered: {known}")
        self.stopTracker()
        self._task = TrackTask(self, pTarget, self.getEffector())
        self.body.do(self._task)

    def stopTracker(self) -> None:
        """Stop following the target."""
        with self.body.time.lock:
            if self._task is not None:
                tasks = [self._task, *(t for t in self.body.tasks if t.name == "trackMove")]
                self.body.tasks.kill(tasks, self.body)
            self._task = None

    def isActive(self) -> bool:
        """Return whether a target is followed."""
        return self._task is not None and not self._task.ended

    def getActiveTarget(self) -> str:
        """Return the target that is followed, or ""."""
        return "" if self._task is None else self._task.target

    def isTargetLost(self) -> bool:
        """Return whether the position of the target is unknown."""
        return self._task is None or self.place_of(self._task.target) is None

    def isNewTargetDetected(self) -> bool:
        """Return whether the position of the target is known."""
        return not self.isTargetLost()

    def getTargetPosition(self, pFrame: int = 0) -> list[float]:
        """Return the position of the target in a frame [m]; empty if it is unknown."""
        point = None if self._task is None else self.place_of(self._task.target)
        if point is None:
            return []
        inverse = np.linalg.inv(space_pose(self.body, pFrame, True, self.name, "getTargetPosition"))
        return [float(x) for x in inverse[:3, :3] @ point + inverse[:3, 3]]

    def getRobotPosition(self) -> list[float]:
        """Return x, y [m] and yaw [rad] of the base."""
        return self.broker.motion.getRobotPosition(True)

    # Settings.

    def setMode(self, pMode: str) -> None:
        """Set the mode: "Head", "BodyRotation", "WholeBody", "Move", ..."""
        if pMode not in MODES:
            raise self.fail("setMode", f"mode: got {quoted(pMode)}, expected one of {', '.join(MODES)}")
        self.kept["mode",] = pMode

    def setEffector(self, pEffector: str) -> None:
        """Set the arms that point at the target: "None", "LArm", "RArm" or "Arms"."""
        if pEffector not in ARMS:
            raise self.fail("setEffector", f"got {quoted(pEffector)}, expected {', '.join(ARMS)}")
        self.kept["effector",] = pEffector
        if self._task is not None:
            self.track(self._task.target)

    def removeEffector(self, pEffector: str) -> None:
        """Stop pointing at the target."""
        self.setEffector("None")

    def setRelativePosition(self, target: Any) -> None:
        """Set the position of the base relative to the target: [distance X, Y, angle, thresholds]."""
        self._relative = self.numbers("setRelativePosition", "target", target)

    def getRelativePosition(self) -> list[float]:
        """Return the position of the base relative to the target."""
        return list(self._relative)

    def getTimeOut(self) -> int:
        """Return the time after which a target counts as lost [ms]."""
        return int(self.kept.get(("TimeOut",), 1000.0))

    def initialize(self) -> None:
        """Stop following, and remove targets and settings."""
        self.stopTracker()
        self._targets.clear()
        self.kept.update({("mode",): "Head", ("effector",): "None"})


MODULES = (ALTracker,)
