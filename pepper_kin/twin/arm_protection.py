"""Protection of the arms from contact with the body and the scene, by the nearest clear posture."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import NearPairs, Scene, near_pairs
from pepper_kin.core.quadratic_program import solve_program
from pepper_kin.model import PepperModel

KEPT = 0.003
"""Distance that arms keep from bodies [m]."""

TOUCH = 0.001
"""Distance below which an arm comes no nearer, for any target [m]."""

LOOK = 0.15
"""Distance within which bodies are considered [m]: no hand moves that far in a cycle."""

DAMPING = 0.25
"""Fraction of the distance minus `KEPT` by which an arm may come nearer in a cycle."""

SLIDING = 0.25
"""Maximum fraction of velocity limits while an arm is kept off a body, so that lag does not cut corners."""

REACH = 0.8
"""Upper bound on the distance of any point of an arm from any of its joint axes [m]."""

_CLOSER = 1e-6  # [m]


@dataclass
class ProtectedArm:
    """An arm, and the bodies that it is kept off.

    Attributes:
        joints: Indices of the arm's joints in the model, without the hand's, shape (k,).
        from_body: Whether the arm is kept off the robot's other links.
        from_scene: Whether the arm is kept off the scene.
    """

    joints: NDArray[np.intp]
    from_body: bool = True
    from_scene: bool = True

    def concerned(self, near: NearPairs, objects: frozenset[str]) -> NDArray[np.bool_]:
        """Return which pairs count for this arm, shape (k,).

        Args:
            near: Pairs of bodies.
            objects: Names of the scene's objects.
        """
        moved = near.movers[:, self.joints].any(axis=1)
        if not objects:
            return np.asarray(moved & self.from_body)
        outside = np.array([bool(objects.intersection(names)) for names in near.names], dtype=bool)
        return np.asarray(moved & np.where(outside, self.from_scene, self.from_body))


@dataclass
class ArmProtection:
    """The protection of all arms.

    Attributes:
        pepper: The model.
        cycle: Time from one posture to the next [s].
        arms: Arm name -> arm.
        active: Whether protection is active.
    """

    pepper: PepperModel
    cycle: float
    arms: dict[str, ProtectedArm] = field(default_factory=dict)
    active: bool = True

    def allowed(
        self, before: Array, wanted: Array, scene: Scene | None = None, free: Set[int] = frozenset()
    ) -> Array:
        """Return the allowed positions after a cycle that are nearest to the wanted ones, shape (n,).

        Joints of no protected arm take the wanted positions, and an arm without motion stays, however near it
        is.  The positions x of the other arms' joints minimize |x - wanted|^2 within position and velocity
        limits, with

            g . (x - before) >= DAMPING (KEPT - d),   without DAMPING where d < KEPT,

        for each pair of bodies at a distance d with the gradient g (velocity dampers: Faverjon and
        Tournassoud, 1987): arms slide along bodies.  If these constraints are infeasible, no pair comes
        nearer.  Distances are not linear: an arm that would bring a body nearer than `TOUCH` stays.

        Args:
            before: Allowed positions of the previous cycle [rad or m], shape (n,).
            wanted: Wanted positions [rad or m], shape (n,).
            scene: The world around the robot.
            free: Joints of arms that are not protected in this cycle.
        """
        arms = [
            arm
            for arm in self.arms.values()
            if self.active
            and (arm.from_body or (arm.from_scene and scene is not None))
            and (not free or free.isdisjoint(arm.joints.tolist()))
            and not np.array_equal(before[arm.joints], wanted[arm.joints])
        ]
        if not arms:
            return wanted
        joints = np.concatenate([arm.joints for arm in arms])
        now, most = before[joints], self.pepper.velocity_limits[joints] * self.cycle
        aim, start, result = wanted[joints], wanted.copy(), wanted.copy()
        behind = np.abs(aim - now) > most * (1.0 + 1e-9)  # joints that lag behind the wanted positions
        speeds = np.where(behind, SLIDING * most, most)
        low = np.maximum(now - speeds, np.minimum(self.pepper.lower_limits[joints], now))
        high = np.minimum(now + speeds, np.maximum(self.pepper.upper_limits[joints], now))
        end = np.minimum(np.maximum(aim, low), high)
        start[joints], result[joints] = now, end
        way = REACH * float(np.abs(end - now).sum()) / DAMPING
        objects = frozenset(scene.objects) if scene is not None else frozenset()
        near = near_pairs(self.pepper, start, min(KEPT + way, LOOK), scene)
        if not len(near):
            return result
        counts = np.logical_or.reduce([arm.concerned(near, objects) for arm in arms])
        rows, left = near.gradients[:, joints][counts], KEPT - near.distances[counts]
        least = np.where(left < 0.0, DAMPING * left, left)
        if (rows @ (end - now) >= least).all():
            return result
        low, high = np.maximum(low, now - SLIDING * most), np.minimum(high, now + SLIDING * most)
        identity, base = np.eye(len(joints)), rows @ now
        clear = solve_program(identity, -aim, low, high, rows, least + base)
        if clear is None:
            clear = solve_program(identity, -aim, low, high, rows, np.minimum(least, 0.0) + base)
        result[joints] = now if clear is None else clear
        moved = result[joints] - now
        curved = 0.5 * REACH * float(np.abs(moved).sum()) ** 2  # bound on nonlinearity of distances
        if (rows @ moved - left).min() + KEPT - curved < TOUCH:
            self._hold(arms, near, start, result, scene)
        return result

    def _hold(
        self,
        arms: Sequence[ProtectedArm],
        near: NearPairs,
        start: Array,
        result: Array,
        scene: Scene | None,
    ) -> None:
        """Undo the steps of arms that bring a body nearer than `TOUCH`.

        Args:
            arms: The protected arms.
            near: Pairs of bodies that were near before.
            start: Positions before the cycle [rad or m], shape (n,).
            result: Positions after the cycle [rad or m], shape (n,); changed in place.
            scene: The world around the robot.
        """
        after = near_pairs(self.pepper, result, TOUCH, scene)
        if not len(after):
            return
        distances = dict(zip(near.indices.tolist(), near.distances.tolist(), strict=True))
        were = np.array([distances.get(pair, np.inf) for pair in after.indices.tolist()])
        closer = after.distances < were - _CLOSER
        objects = frozenset(scene.objects) if scene is not None else frozenset()
        for arm in arms:
            if (arm.concerned(after, objects) & closer).any():
                result[arm.joints] = start[arm.joints]


def arm_protection(pepper: PepperModel, cycle: float) -> ArmProtection:
    """Return the protection of Pepper's arms from its own body, from shoulder to wrist; hands are open.

    Args:
        pepper: The robot; arms without any joint are left out.
        cycle: Time from one posture to the next [s].
    """
    names = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
    arms = {}
    for side in "LR":
        known = [side + name for name in names if side + name in pepper.joint_names]
        if known:
            arms[f"{side}Arm"] = ProtectedArm(np.array([pepper.joint_index(name) for name in known]))
    return ArmProtection(pepper, cycle, arms)
