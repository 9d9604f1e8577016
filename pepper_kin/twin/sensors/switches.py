"""Bumpers and touch sensors: pads that are pressed or not."""

from __future__ import annotations

from dataclasses import dataclass, replace
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

Array = NDArray[np.float64]

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
        middle: Center of a box around it, in its own axes [m], shape (3,).
        half: Half lengths of that box, without the padding [m], shape (3,).
    """

    item: SceneObject
    shape: Any
    place: Any
    padding: float
    middle: Array
    half: Array


class SceneSolids:
    """The objects of a scene as coal's shapes, and which of them may reach which pad."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._state: SensedState | None = None
        self._pads: list[tuple[str, float]] = []
        self._solids: dict[str, Solid] = {}
        self._near: list[list[Solid]] = []

    def add_pad(self, frame: str, radius: float) -> int:
        """Return the number of a new pad: a ball of a radius [m] about a frame."""
        self._pads.append((frame, radius))
        return len(self._pads) - 1

    def near(self, state: SensedState, pad: int) -> list[Solid]:
        """Return the objects whose boxes are within a pad's ball, but for rounding."""
        if state is not self._state:
            self._near, self._state = self._all_near(state), state
        return self._near[pad]

    def _all_near(self, state: SensedState) -> list[list[Solid]]:
        self._look(state.scene)
        solids = tuple(self._solids.values())
        if not solids:
            return [[] for _ in self._pads]
        centers = np.array([state.pose(frame)[:3, 3] for frame, _ in self._pads])
        poses = np.array([solid.item.transform_object_to_world for solid in solids])
        off = centers[:, np.newaxis] - poses[:, :3, 3]
        local = (off[:, :, np.newaxis] @ poses[:, :3, :3])[:, :, 0]  # in the axes of each object
        local -= self._middles
        beyond = np.maximum(np.abs(local) - self._halves, 0.0)
        reach = np.array([radius for _, radius in self._pads])[:, np.newaxis] + self._paddings
        near = ~((beyond * beyond).sum(axis=2) > reach * reach)
        return [[solids[k] for k in np.flatnonzero(row)] if row.any() else [] for row in near]

    def _look(self, scene: Scene) -> None:
        """Make the objects that stand in the world; what was made of a shape before is kept."""
        if scene is self._scene:
            return
        before, self._solids = self._solids, {}
        for name, item in scene.objects.items():
            known = before.get(name)
            if known is not None and known.item is item:
                self._solids[name] = known
            elif known is not None and known.item.geometry is item.geometry:
                self._solids[name] = replace(
                    known, item=item, place=_placement(item.transform_object_to_world)
                )
            elif not is_empty(item.geometry):
                self._solids[name] = _solid(item)
        solids = self._solids.values()
        self._middles = np.array([solid.middle for solid in solids]).reshape(-1, 3)
        self._halves = np.array([solid.half for solid in solids]).reshape(-1, 3)
        self._paddings = np.array([solid.padding for solid in solids]) + ROUNDING
        self._scene = scene


def _solid(item: SceneObject) -> Solid:
    extra, place = padding(item.geometry), _placement(item.transform_object_to_world)
    shape = coal_geometry(item.geometry)
    if isinstance(item.geometry, HalfSpace):
        return Solid(item, shape, place, extra, np.zeros(3), np.full(3, np.inf))
    shape.computeLocalAABB()
    box = shape.aabb_local
    low, high = np.array(box.min_), np.array(box.max_)
    return Solid(item, shape, place, extra, (low + high) / 2, (high - low) / 2)


def _placement(pose: Array) -> Any:
    import coal

    return coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))


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
        self._number = solids.add_pad(specification.frame, float(np.linalg.norm(self._half)))
        frames = pepper.inner_model.frames
        joint = frames[pepper.frame_id(specification.frame)].parentJoint
        self._links = frozenset(
            name for name in pepper.frame_names if frames[pepper.frame_id(name)].parentJoint == joint
        )

    def truth(self, state: SensedState) -> NDArray[np.bool_]:
        """Return whether the pad is pressed, shape ()."""
        pose = state.pose(self.specification.frame)
        return np.asarray(self._in_contact(pose, state) or self._in_scene(pose, state))

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[np.bool_]:
        """Return the opposite of the truth in a share `error_rate` of the samples."""
        rate = self.specification.error_rate
        wrong = rate > 0 and self.noise.generator(sample).random() < rate
        return np.asarray(truth != wrong)

    def _in_contact(self, pose: Array, state: SensedState) -> bool:
        for link, point in state.touches:
            if link in self._links:
                place = pose[:3, :3].T @ (np.asarray(point) - pose[:3, 3])
                if (np.abs(place) <= self._half + CONTACT_REACH).all():
                    return True
        return False

    def _in_scene(self, pose: Array, state: SensedState) -> bool:
        near = self._solids.near(state, self._number)
        if not near:
            return False
        import coal

        placement, request = _placement(pose), coal.DistanceRequest()
        return any(
            coal.distance(self._pad, placement, solid.shape, solid.place, request, coal.DistanceResult())
            <= solid.padding
            for solid in near
        )
