"""Poses of all moving bodies, packed for the pages."""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, loads_of
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.viewer.server.layers import MASS, MASS_BODY, ZMP, ZMP_BODY, target_body
from pepper_kin.viewer.server.readings import balance_points
from pepper_kin.viewer.server.targets import SharedTargets

pinocchio = lazy_module("pinocchio")

POSES, DRAWING = 1, 2
"""Kind of a binary message: its first number, little-endian, 32 bit; the second is a stamp."""


def drawing_message(command: bytes) -> bytes:
    """Pack a drawing command as a message."""
    return struct.pack("<II", DRAWING, 0) + command


class BodyPoses:
    """Poses of links, balance points and targets, in this order.

    Args:
        pepper: Model of the robot.
        links: Names of the links whose poses the pages need.
        targets: Targets of the robot.
    """

    def __init__(self, pepper: PepperModel, links: tuple[str, ...], targets: SharedTargets) -> None:
        self._pepper, self._targets = pepper, targets
        self._frames = [pepper.frame_id(link) for link in links]
        self._balance = np.zeros((2, 3))
        self.names = (*links, MASS_BODY, ZMP_BODY, *(target_body(name) for name in targets.names))

    def packed(
        self, q: Array, v: Array, a: Array, shown: Mapping[str, bool], stamp: int, scene: Scene | None = None
    ) -> bytes:
        """Pack the message: kind, stamp, and seven float32 per body (x, y, z, quaternion xyzw).

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,).
            a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
            shown: Name of a layer -> whether it is shown.
            stamp: Stamp, the message's second number.
            scene: Scene around the robot, with attached objects; None for none.
        """
        if shown.get(MASS) or shown.get(ZMP):
            self._balance[:] = balance_points(self._pepper, q, v, a, loads_of(self._pepper, scene))
        values = np.zeros((len(self.names), 7), dtype="<f4")
        values[:, 6] = 1.0
        count = len(self._frames)
        model, data = self._pepper.inner_model, self._pepper.pinocchio_data
        pinocchio.forwardKinematics(model, data, self._pepper.to_full(q))
        for row, frame in enumerate(self._frames):
            values[row] = pinocchio.SE3ToXYZQUAT(pinocchio.updateFramePlacement(model, data, frame))
        values[count : count + 2, :3] = self._balance
        values[count + 2 :, :3] = self._targets.positions()
        return struct.pack("<II", POSES, stamp) + values.tobytes()
