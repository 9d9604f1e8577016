"""Bumpers and touch sensors: pads that are pressed or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import HalfSpace, Scene
from pepper_kin.collision.coal_shapes import coal_geometry, is_empty
from pepper_kin.collision.solids import SceneGeometry, padding
from pepper_kin.core.simulation.near_boxes import Boxes, balls_near_boxes
from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.reading import SensedState, touched
from pepper_kin.twin.sensors.sensor import ErringSensor
from pepper_kin.twin.sensors.specification import SensorSpecification

CONTACT_REACH = 0.01
"""Distance outside a pad at which a contact presses it [m]: shapes of the body enclose its surface."""

ROUNDING = 1e-6
"""Distance from a pad beyond which objects are not checked more closely [m]."""


@dataclass(frozen=True, eq=False)
class SolidShape:
    """A shape of a scene with its shape in coal.

    Attributes:
        geometry: Geometry in the scene.
        shape: Shape in coal.
        padding: Distance by which the geometry extends beyond coal's shape [m].
        middle: Center of a box around it, in its own axes [m], shape (3,).
        half: Half lengths of that box, without the padding [m], shape (3,).
    """

    geometry: SceneGeometry
    shape: Any
    padding: float
    middle: Array
    half: Array


class Pads:
    """Boxes about frames of the robot that are pressed by objects of the scene and by contacts.

    All pads are checked together, so that their sensors must have the same rate.

    Args:
        pepper: The robot.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._pepper = pepper
        self._frames: list[str] = []
        self._halves, self._balls = np.empty((0, 3)), np.empty((0, 4))
        self._shapes: list[Any] = []
        self._by_link: dict[str, list[int]] = {}
        self._scene: Scene | None = None
        self._state: SensedState | None = None
        self._solids: dict[str, SolidShape] = {}
        self._boxes = Boxes(np.empty((0, 4, 4)), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))

    def add(self, frame: str, size: tuple[float, float, float]) -> int:
        """Add a pad; return its index.

        Args:
            frame: Name of the frame at its center, with its axes.
            size: Full lengths of the pad [m].
        """
        import coal

        number, half = len(self._frames), np.array(size) / 2
        self._frames.append(frame)
        self._shapes.append(coal.Box(*size))
        self._halves = np.vstack([self._halves, half])
        self._balls = np.vstack([self._balls, [0.0, 0.0, 0.0, np.linalg.norm(half)]])
        frames = self._pepper.inner_model.frames
        joint = frames[self._pepper.frame_id(frame)].parentJoint
        for name in self._pepper.frame_names:
            if frames[self._pepper.frame_id(name)].parentJoint == joint:
                self._by_link.setdefault(name, []).append(number)
        return number

    def pressed(self, state: SensedState) -> list[bool]:
        """Return for each pad whether anything presses it."""
        if state is not self._state:
            self._pressed, self._state = self._all_pressed(state), state
        return self._pressed

    def _all_pressed(self, state: SensedState) -> list[bool]:
        poses, pressed = [state.pose(frame) for frame in self._frames], [False] * len(self._frames)
        for contact in state.contacts:
            for link, point in touched(contact, self._by_link):
                for number in self._by_link[link]:
                    pose = poses[number]
                    place = pose[:3, :3].T @ (np.asarray(point) - pose[:3, 3])
                    if (np.abs(place) <= self._halves[number] + CONTACT_REACH).all():
                        pressed[number] = True
        self._look(state.scene)
        if not self._solids:
            return pressed
        for number, pose in enumerate(poses):
            self._balls[number, :3] = pose[:3, 3]
        pairs = np.empty((len(poses) * len(self._solids), 2), np.int64)
        found = balls_near_boxes(self._balls, self._boxes, pairs)
        if found:
            solids = tuple(self._solids.values())
            for number, row in pairs[:found].tolist():
                if not pressed[number]:
                    pressed[number] = self._reaches(number, poses[number], solids[row], self._boxes.pose[row])
        return pressed

    def _reaches(self, number: int, pad: Array, solid: SolidShape, pose: Array) -> bool:
        """Return whether a solid reaches into a pad; poses are transforms to the world, shape (4, 4)."""
        import coal

        request, result = coal.DistanceRequest(), coal.DistanceResult()
        shape, place = self._shapes[number], _placement(pad)
        gap = coal.distance(shape, place, solid.shape, _placement(pose), request, result)
        return bool(gap <= solid.padding)

    def _look(self, scene: Scene) -> None:
        """Take the objects that stand in the world; what was made of a shape before is kept."""
        if scene is self._scene:
            return
        before, solids, poses = self._solids, {}, []
        for name, item in scene.objects.items():
            known = before.get(name)
            if known is None or known.geometry is not item.geometry:
                if is_empty(item.geometry):
                    continue
                known = _solid(item.geometry)
            solids[name] = known
            poses.append(item.transform_object_to_world)
        found = list(solids.values())
        if found and found == list(before.values()):
            self._boxes.pose[:] = poses
        else:
            self._boxes = Boxes(
                np.array(poses).reshape(-1, 4, 4),
                np.array([solid.middle for solid in found]).reshape(-1, 3),
                np.array([solid.half for solid in found]).reshape(-1, 3),
                np.array([solid.padding for solid in found]) + ROUNDING,
            )
        self._scene, self._solids = scene, solids


def _solid(geometry: SceneGeometry) -> SolidShape:
    extra, shape = padding(geometry), coal_geometry(geometry)
    if isinstance(geometry, HalfSpace):
        return SolidShape(geometry, shape, extra, np.zeros(3), np.full(3, np.inf))
    shape.computeLocalAABB()
    box = shape.aabb_local
    low, high = np.array(box.min_), np.array(box.max_)
    return SolidShape(geometry, shape, extra, (low + high) / 2, (high - low) / 2)


def _placement(pose: Array) -> Any:
    """Return a pose, shape (4, 4), as coal takes it."""
    import coal

    return coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))


class Switch(ErringSensor):
    """Whether anything presses a pad: an object of the scene reaches into it, or a contact lies on it.

    The pad is a box about the sensor's frame.  Objects that the robot carries do not press.
    """

    dtype = np.bool_
    uses_scene = True

    def __init__(
        self, pepper: PepperModel, specification: SensorSpecification, seed: int, pads: Pads
    ) -> None:
        super().__init__(pepper, specification, seed)
        self._pads, self._number = pads, pads.add(specification.frame, specification.pad)
        self.exact = specification.error_rate == 0

    def truth(self, state: SensedState) -> NDArray[np.bool_]:
        """Return whether the pad is pressed, shape ()."""
        return np.asarray(self._pads.pressed(state)[self._number])

    def measured(self, truth: NDArray[Any], sample: int) -> NDArray[np.bool_]:
        """Return the opposite of the truth, shape (), in a share `error_rate` of the samples."""
        rate = self.specification.error_rate
        wrong = self.noise.generator(sample).random() < rate
        return np.asarray(truth != wrong)
