"""The ground that carries a robot on a planar base."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision import Scene, contacts
from pepper_kin.kinematics import frame_jacobian
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import BASE_JOINTS

NEAR = 1e-3
"""Maximum gap at which a part of the base stands on a body below it [m]."""
_STEEP = 0.7  # minimum vertical component of a contact normal


def standing_on_ground(pepper: PepperModel, scene: Scene) -> Scene:
    """Return a scene in which the base may touch the ground under it, since the base cannot yield upwards.

    The joints of a planar base move only on the ground, so no contact force changes how the base stands on
    it.

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
