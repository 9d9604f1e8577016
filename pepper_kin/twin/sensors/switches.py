"""Bumpers and touch sensors: pads that are pressed or not."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Scene
from pepper_kin.collision.coal_shapes import coal_geometry, is_empty
from pepper_kin.collision.solids import padding
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.reading import SensedState
from pepper_kin.twin.sensors.sensor import Sensor
from pepper_kin.twin.sensors.specification import SensorSpecification

CONTACT_REACH = 0.01
"""A contact presses a pad from this far outside of it [m]: shapes of the body lie around its surface."""


class SceneSolids:
    """The objects of a scene as coal's shapes, made once for all pads."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._solids: list[tuple[Any, Any, float]] = []

    def of(self, scene: Scene) -> list[tuple[Any, Any, float]]:
        """Return shape, pose and padding of each object that stands in the world."""
        import coal

        if scene is not self._scene:
            self._solids = []
            for item in scene.objects.values():
                if is_empty(item.geometry):
                    continue
                pose = item.transform_object_to_world
                placement = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
                self._solids.append((coal_geometry(item.geometry), placement, padding(item.geometry)))
            self._scene = scene
        return self._solids


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
        self._solids = solids
        frames = pepper.pinocchio_model.frames
        joint = frames[pepper.frame_id(specification.frame)].parentJoint
        self._links = frozenset(
            name for name in pepper.frame_names if frames[pepper.frame_id(name)].parentJoint == joint
        )

    def truth(self, state: SensedState) -> NDArray[np.bool_]:
        """Return whether the pad is pressed, shape ()."""
        pose = frame_pose(self.pepper, state.q, self.specification.frame)
        return np.asarray(self._in_contact(pose, state) or self._in_scene(pose, state.scene))

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[np.bool_]:
        """Return the opposite of the truth in a share `error_rate` of the samples."""
        rate = self.specification.error_rate
        wrong = rate > 0 and self.noise.generator(sample).random() < rate
        return np.asarray(truth != wrong)

    def _in_contact(self, pose: NDArray[np.float64], state: SensedState) -> bool:
        for contact in state.contacts:
            for link, point in touched(contact):
                if link in self._links:
                    place = pose[:3, :3].T @ (np.asarray(point) - pose[:3, 3])
                    if (np.abs(place) <= self._half + CONTACT_REACH).all():
                        return True
        return False

    def _in_scene(self, pose: NDArray[np.float64], scene: Scene) -> bool:
        import coal

        placement = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        for shape, where, extra in self._solids.of(scene):
            result.clear()
            if coal.distance(self._pad, placement, shape, where, request, result) <= extra:
                return True
        return False


def touched(contact: Any) -> list[tuple[str | None, NDArray[np.float64]]]:
    """Return what a contact touches, and where: two links or objects with their points.

    Args:
        contact: With `links` and `points`, as `pepper_kin.collision.Contact` has (points may be None, where
            it is not known where), or with `names`, one `point` and a `force`, as a twin's world has.
    """
    if hasattr(contact, "links"):
        return [] if contact.points is None else list(zip(contact.links, contact.points, strict=True))
    if not np.any(contact.force):
        return []
    return [(name, contact.point) for name in contact.names]
