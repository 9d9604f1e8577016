"""Arms are slowed and stopped before they touch the body or the scene, as by ALMotion's protection."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import NearPairs, Scene, near_pairs
from pepper_kin.model import PepperModel

KEPT = 0.002
"""Distance below which an arm comes no nearer [m]."""

LOOK = 0.15
"""Distance within which bodies are looked at [m]: no hand moves that far in a cycle."""

DAMPING = 0.25
"""Share of the distance left, less `KEPT`, by which an arm may come nearer in a cycle."""

_CLOSER = 1e-6  # [m]
_STILL = 1e-4  # [rad] of a step that gets nowhere


@dataclass
class ProtectedArm:
    """An arm and what it is kept from.

    Attributes:
        joints: Places of its joints in the model, without the hand's.
        from_body: Whether it is kept from the robot's other links.
        from_scene: Whether it is kept from the scene.
    """

    joints: Sequence[int]
    from_body: bool = True
    from_scene: bool = True

    def concerned(self, near: NearPairs, objects: frozenset[str]) -> NDArray[np.bool_]:
        """Return which pairs count for this arm, shape (k,).

        Args:
            near: Pairs of bodies.
            objects: Names of the scene's objects.
        """
        outside = np.array([bool(objects.intersection(names)) for names in near.names], dtype=bool)
        moved = near.movers[:, list(self.joints)].any(axis=1)
        return np.asarray(moved & np.where(outside, self.from_scene, self.from_body))


@dataclass
class ArmProtection:
    """The protection of all arms.

    Attributes:
        pepper: The model.
        arms: By name.
        active: Whether any arm is protected at all.
        held: Joints of the arms that were kept where they were in the last cycle, or nearly.
    """

    pepper: PepperModel
    arms: dict[str, ProtectedArm] = field(default_factory=dict)
    active: bool = True
    held: set[int] = field(default_factory=set)

    def allowed(
        self, before: Array, wanted: Array, scene: Scene | None, free: Set[int] = frozenset()
    ) -> Array:
        """Return what of the wanted positions of the joints is allowed in a cycle, shape (n,).

        An arm's step d q is shortened until, for each pair of bodies at a distance d with the gradient g,
        g . d q >= -DAMPING (d - KEPT), and left out where a body still came nearer than `KEPT`: a velocity
        damper (Faverjon and Tournassoud, 1987) with one factor for an arm, so that it goes on in its
        direction.

        Args:
            before: Positions of the joints [rad or m], shape (n,).
            wanted: After the cycle, shape (n,).
            scene: What stands around the robot.
            free: Joints of arms that are not protected in this cycle.
        """
        step = wanted - before
        self.held.clear()
        moving = [
            arm
            for arm in self.arms.values()
            if self.active
            and (arm.from_body or (arm.from_scene and scene is not None))
            and step[arm.joints].any()
            and free.isdisjoint(arm.joints)
        ]
        if not moving:
            return wanted
        objects = frozenset(scene.objects) if scene is not None else frozenset()
        near, result = near_pairs(self.pepper, before, LOOK, scene), wanted.copy()
        margin = DAMPING * np.maximum(near.distances - KEPT, 0.0)
        for arm in moving:
            closing = -near.gradients[:, arm.joints] @ step[arm.joints]
            counts = arm.concerned(near, objects) & (closing > margin)
            if counts.any():
                share = (margin[counts] / closing[counts]).min()
                result[arm.joints] = before[arm.joints] + share * step[arm.joints]
        self._hold(moving, near, before, result, scene, objects)
        for arm in moving:
            done = np.abs(result[arm.joints] - before[arm.joints]).max()
            if done < min(_STILL, np.abs(step[arm.joints]).max()):
                self.held.update(arm.joints)
        return result

    def _hold(
        self,
        moving: Sequence[ProtectedArm],
        near: NearPairs,
        before: Array,
        result: Array,
        scene: Scene | None,
        objects: frozenset[str],
    ) -> None:
        """Leave out the steps of arms by which a body comes nearer than `KEPT`; distances are not linear.

        Args:
            moving: Arms that move.
            near: Pairs that were near before.
            before: Positions of the joints [rad or m], shape (n,).
            result: After the cycle, shape (n,); changed.
            scene: What stands around the robot.
            objects: Names of its objects.
        """
        after = near_pairs(self.pepper, result, KEPT, scene)
        if not len(after):
            return
        distances = dict(zip(near.indices.tolist(), near.distances.tolist(), strict=True))
        were = np.array([distances.get(pair, np.inf) for pair in after.indices.tolist()])
        closer = after.distances < were - _CLOSER
        for arm in moving:
            if (arm.concerned(after, objects) & closer).any():
                result[arm.joints] = before[arm.joints]
