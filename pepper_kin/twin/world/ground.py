"""The ground that carries a robot on a planar base."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision import Scene, contacts
from pepper_kin.kinematics import frame_jacobian
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import BASE_JOINTS

NEAR = 1e-3
"""Gap up to which a part of the base stands on what is below it [m]."""
_STEEP = 0.7  # least vertical part of a normal


def standing_on_ground(pepper: PepperModel, scene: Scene) -> Scene:
    """Return a scene in which the base may touch what it stands on: the base cannot yield upwards.

    Joints of a planar base slide and turn on the ground, so no contact force changes how it lies on it.

    Args:
        pepper: The robot, in its neutral posture.
        scene: The scene.
    """
    base = np.isin(pepper.joint_names, BASE_JOINTS)
    if not base.any() or not scene.objects:
        return scene
    q = pepper.neutral()
    for contact in contacts(pepper, q, scene, within=NEAR):
        link, thing = contact.names
        if thing not in scene.objects or contact.normal is None or abs(contact.normal[2]) < _STEEP:
            continue
        if not frame_jacobian(pepper, q, contact.links[0] or link)[:, ~base].any():
            scene = scene.allow(thing, link)
    return scene
