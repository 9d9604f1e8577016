"""Robot on a base that can be placed anywhere on the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.wheels import BASE_JOINTS, on_planar_base

FAR = 1000.0
"""Maximum distance of a base pose from the world's origin along each axis, without a robot's own limit
[m]."""


@dataclass(frozen=True, eq=False)
class MovingBase:
    """A robot together with its copy on a planar base of three joints.

    With it, targets in the world, obstacles and all tasks are independent of the base's pose.

    Attributes:
        robot: The robot with a moving base; the given robot itself if it has one.
        base: Indices of `BASE_JOINTS` in the joint vectors of `robot`, shape (3,).
        body: Indices of the given robot's joints in the joint vectors of `robot`, shape (n,).
    """

    robot: PepperModel
    base: np.ndarray
    body: np.ndarray

    def states(self, q: Array, places: Array) -> Array:
        """Return joint vectors of `robot`, shape (N, robot.n), from one of the given robot and N base poses.

        Args:
            q: Joint positions of the given robot [rad or m], shape (n,).
            places: Base poses: x, y [m] and yaw [rad], shape (N, 3); they replace base positions in q.
        """
        states = np.zeros((len(places), self.robot.n))
        states[:, self.body] = q
        states[:, self.base] = places
        return states

    def movable(self, mask: np.ndarray) -> np.ndarray:
        """Return a mask of the given robot's joints, shape (n,), as a mask of `robot`, without the base."""
        result = np.zeros(self.robot.n, dtype=bool)
        result[self.body] = mask
        result[self.base] = False
        return result

    def names(self, mask: np.ndarray) -> tuple[str, ...]:
        """Return the names of the joints of `robot` in a mask, shape (robot.n,)."""
        return tuple(self.robot.joint_names[i] for i in np.flatnonzero(mask))


@kept_for_robot(most=1)
def moving_base(pepper: PepperModel) -> MovingBase:
    """Return the robot with a moving base, built once for each robot.

    Raises:
        InvalidValueError: for a robot that has only some of the base's joints.
    """
    present = [name for name in BASE_JOINTS if name in pepper.joint_names]
    if present and len(present) < len(BASE_JOINTS):
        raise InvalidValueError("base joints", ", ".join(present), f"all of {', '.join(BASE_JOINTS)}")
    robot = pepper if present else _on_wheels(pepper)
    base = np.array([robot.joint_index(name) for name in BASE_JOINTS])
    body = np.array([robot.joint_index(name) for name in pepper.joint_names])
    return MovingBase(robot, base, body)


def wrapped(angle: Array) -> Array:
    """Return angles of any shape, moved into [-pi, pi) [rad]."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def _on_wheels(pepper: PepperModel) -> PepperModel:
    """Return the robot with the base's joints between the world and its root link."""
    moving = on_planar_base(pepper.document, "placement", FAR, {})
    robot = pepper.with_parts(document=moving, changed=None)
    changed = pepper.dynamics_model.changed()
    if changed is not None:  # not in the document: payloads, other masses, placements, gravity
        model = robot.pinocchio_model
        model.gravity = changed.gravity
        for joint, name in enumerate(changed.names):
            own = model.getJointId(name) if joint else model.getJointId(BASE_JOINTS[2])
            model.inertias[own] = changed.inertias[joint]
            if joint:
                model.jointPlacements[own] = changed.jointPlacements[joint]
                place, old = model.joints[own].idx_v, changed.joints[joint].idx_v
                for quantity in ("armature", "friction", "damping", "rotorInertia", "rotorGearRatio"):
                    getattr(model, quantity)[place] = getattr(changed, quantity)[old]
        for frame in changed.frames:
            if model.existFrame(frame.name, frame.type):
                model.frames[model.getFrameId(frame.name, frame.type)].placement = frame.placement
        robot = robot.with_pinocchio_model(model)
    return robot
