"""Bumpers and touch sensors: pads that are pressed or not."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import HalfSpace, Scene, SceneObject
from pepper_kin.collision.coal_shapes import coal_geometry, is_empty
from pepper_kin.collision.solids import padding
from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.sensor import Sensor
from pepper_kin.twin.sensors.specification import SensorSpecification

CONTACT_REACH = 0.01
"""A contact presses a pad from this far outside of it [m]: shapes of the body lie around its surface."""

ROUNDING = 1e-6
"""Objects that are farther than this from reaching a pad are not looked at more closely [m]."""


@dataclass(frozen=True, eq=False)
class Solid:
    """An object of a scene as coal knows it.

    Attributes:
        item: The object.
        shape: Coal's.
        place: Coal's transform of it.
        padding: How far it reaches beyond [m].
        rotation: Rows of the rotation from the world into the axes of a box around it.
        centre: Of that box, in the world [m].
        half: Half lengths of that box, without the padding [m].
    """

    item: SceneObject
    shape: Any
    place: Any
    padding: float
    rotation: list[list[float]]
    centre: list[float]
    half: list[float]

    def may_reach(self, point: list[float], radius: float) -> bool:
        """Return whether its box is within a radius [m] of a point, but for rounding."""
        x, y, z = (a - b for a, b in zip(point, self.centre, strict=True))
        square = 0.0
        for (a, b, c), half in zip(self.rotation, self.half, strict=True):
            square += max(abs(a * x + b * y + c * z) - half, 0.0) ** 2
        return not square > (radius + self.padding + ROUNDING) ** 2


class SceneSolids:
    """The objects of a scene as coal's shapes, made once for all pads."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._solids: dict[str, Solid] = {}

    def of(self, scene: Scene) -> Iterable[Solid]:
        """Return the objects that stand in the world."""
        if scene is not self._scene:
            before, self._solids = self._solids, {}
            for name, item in scene.objects.items():
                if not is_empty(item.geometry):
                    known = before.get(name)
                    self._solids[name] = known if known and known.item is item else _solid(item)
            self._scene = scene
        return self._solids.values()


def _solid(item: SceneObject) -> Solid:
    import coal

    pose, extra = item.transform_object_to_world, padding(item.geometry)
    place = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
    shape = coal_geometry(item.geometry)
    turn = pose[:3, :3].T.tolist()
    if isinstance(item.geometry, HalfSpace):
        return Solid(item, shape, place, extra, turn, [0.0, 0.0, 0.0], [math.inf] * 3)
    shape.computeLocalAABB()
    box = shape.aabb_local
    low, high = np.array(box.min_), np.array(box.max_)
    centre = pose[:3, :3] @ ((low + high) / 2) + pose[:3, 3]
    return Solid(item, shape, place, extra, turn, centre.tolist(), ((high - low) / 2).tolist())


class Switch(Sensor):
    """Whether anything presses a pad: an object of the scene reaches into it, or a contact lies on it.

    The pad is a box about the sensor's frame.  Objects that the robot carries do not press.
    """

    def __init__(
        self, pepper: PepperModel, specification: SensorSpecification, seed: int, solids: SceneSolids
    ) -> None:
        super().__init__(pepper, specification, seed)
        import coal

        self._pad = coal.Box(*specification.pad)
        self._half = np.array(specification.pad) / 2
        self._radius = float(np.linalg.norm(self._half))
        self._solids = solids
        frames = pepper.pinocchio_model.frames
        joint = frames[pepper.frame_id(specification.frame)].parentJoint
        self._links = frozenset(
            name for name in pepper.frame_names if frames[pepper.frame_id(name)].parentJoint == joint
        )

    def truth(self, state: SensedState) -> NDArray[np.bool_]:
        """Return whether the pad is pressed, shape ()."""
        pose = state.pose(self.specification.frame)
        return np.asarray(self._in_contact(pose, state) or self._in_scene(pose, state.scene))

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[np.bool_]:
        """Return the opposite of the truth in a share `error_rate` of the samples."""
        rate = self.specification.error_rate
        wrong = rate > 0 and self.noise.generator(sample).random() < rate
        return np.asarray(truth != wrong)

    def _in_contact(self, pose: NDArray[np.float64], state: SensedState) -> bool:
        for link, point in state.touches:
            if link in self._links:
                place = pose[:3, :3].T @ (np.asarray(point) - pose[:3, 3])
                if (np.abs(place) <= self._half + CONTACT_REACH).all():
                    return True
        return False

    def _in_scene(self, pose: NDArray[np.float64], scene: Scene) -> bool:
        import coal

        centre = pose[:3, 3].tolist()
        near = [solid for solid in self._solids.of(scene) if solid.may_reach(centre, self._radius)]
        if not near:
            return False
        placement = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
        request = coal.DistanceRequest()
        return any(
            coal.distance(self._pad, placement, solid.shape, solid.place, request, coal.DistanceResult())
            <= solid.padding
            for solid in near
        )
