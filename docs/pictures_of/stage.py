"""A stage for pictures: robots solid and ghostly, traces, points and things, drawn as the library draws."""

from __future__ import annotations

import io
import itertools
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

import pepper_kin as pk
from pepper_kin.collision.solids import PointCloud, SceneGeometry, TriangleMesh
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.viewer.browser_session import BrowserSession
from pepper_kin.viewer.drawable import Color, Drawable, marker
from pepper_kin.viewer.recording import save_motion_page

from .camera import Camera

ORANGE: Color = (0.93, 0.36, 0.20, 1.0)
BLUE: Color = (0.16, 0.42, 0.78, 1.0)
GREEN: Color = (0.18, 0.58, 0.35, 1.0)
GRAY: Color = (0.45, 0.50, 0.56, 1.0)
WOOD: Color = (0.76, 0.55, 0.37, 1.0)

MOVED = 0.02  # [m] and of the entries of a rotation: what moved less casts no ghost
TIMEOUT = 600.0  # [s] for one picture, on a machine that is busy
OVERSAMPLING = 2  # pixels that are drawn for each that is kept, along either axis


class Stage:
    """Things to draw; each method adds one and returns the stage."""

    def __init__(self) -> None:
        self._drawn: list[Drawable] = []

    def robot(
        self,
        pepper: PepperModel,
        q: ArrayLike,
        *,
        color: Color | None = None,
        opacity: float = 1.0,
        apart_from: ArrayLike | None = None,
        place: ArrayLike | None = None,
    ) -> Stage:
        """Add a robot at joint positions.

        Args:
            pepper: The robot.
            q: Joint positions, shape (n,).
            color: One color for all of it; None keeps its own.
            opacity: 1 for a solid, less for a ghost.
            apart_from: Joint positions, shape (n,); only links that are elsewhere than there are drawn.
            place: Transform from the robot's world to this one, shape (4, 4); None for none.
        """
        names = list(dict.fromkeys(shape.link for shape in pepper.visual_shapes))
        poses = frame_poses(pepper, np.asarray(q, dtype=float), names)
        other = (
            None if apart_from is None else frame_poses(pepper, np.asarray(apart_from, dtype=float), names)
        )
        moved = np.full(len(names), True) if other is None else np.abs(poses - other).max(axis=(1, 2)) > MOVED
        poses = poses if place is None else np.asarray(place) @ poses
        for shape in pepper.visual_shapes:
            if not moved[names.index(shape.link)]:
                continue
            pose = poses[names.index(shape.link)] @ shape.transform_shape_to_link
            tint = (shape.color if color is None else color)[:3]
            self.add(shape.geometry, pose, (*tint, opacity))
        return self

    def scene(self, scene: pk.Scene) -> Stage:
        """Add a scene's objects."""
        for thing in scene.objects.values():
            self.add(thing.geometry, thing.transform_object_to_world, thing.color)
        return self

    def ball(self, point: ArrayLike, color: Color = ORANGE, radius: float = 0.025) -> Stage:
        """Add a ball that marks a place."""
        self._drawn.append(marker(f"{len(self._drawn)}", point, radius, color))
        return self

    def tube(self, points: ArrayLike, color: Color = ORANGE, radius: ArrayLike = 0.005) -> Stage:
        """Add a tube along points, shape (k, 3), of one radius or one at each point."""
        return self.add(tube_mesh(points, radius), np.eye(4), color)

    def arrow(self, start: ArrayLike, end: ArrayLike, color: Color = ORANGE, radius: float = 0.006) -> Stage:
        """Add an arrow."""
        a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(b - a))
        neck = b - (b - a) / length * min(6 * radius, 0.6 * length)
        return self.tube([a, neck, neck + 1e-6 * (b - a), b], color, [radius, radius, 2.4 * radius, 1e-5])

    def points(self, points: ArrayLike, color: Color, radius: float = 0.006) -> Stage:
        """Add many little balls, shape (k, 3)."""
        return self.add(PointCloud(np.asarray(points, dtype=float), radius), np.eye(4), color)

    def cubes(self, centers: ArrayLike, edge: float, color: Color) -> Stage:
        """Add a cube at each of many places, shape (k, 3)."""
        places = np.asarray(centers, dtype=float).reshape(-1, 1, 3)
        if not places.size:
            return self
        corners = edge * (np.array(list(itertools.product((0, 1), repeat=3))) - 0.5)
        quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
        faces = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        indices = faces + 8 * np.arange(len(places)).reshape(-1, 1, 1)
        mesh = TriangleMesh((places + corners).reshape(-1, 3), indices.reshape(-1, 3))
        return self.add(mesh, np.eye(4), color)

    def add(self, geometry: SceneGeometry, pose: ArrayLike, color: Color) -> Stage:
        """Add a solid at a pose in the world."""
        self._drawn.append(Drawable(f"{len(self._drawn)}", None, geometry, np.asarray(pose), color))
        return self

    def picture(self, camera: Camera) -> Image.Image:
        """Draw what is on the stage as the camera sees it."""
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "stage.html"
            save_motion_page(self._drawn, (), [0.0], np.zeros((1, 0, 4, 4)), page, title="stage")
            (drawn,) = pictures_of_page(page, camera, [0.0])
            return drawn


def pictures_of_page(page: Path, camera: Camera, times: Iterable[float]) -> list[Image.Image]:
    """Draw a motion page at some times [s], as a camera sees it."""
    aim(page, camera)
    size = (OVERSAMPLING * camera.size[0], OVERSAMPLING * camera.size[1])
    with BrowserSession(page, size, timeout=TIMEOUT) as session:
        drawn = [Image.open(io.BytesIO(session.picture(time))).convert("RGB") for time in times]
    return [image.resize(camera.size, Image.Resampling.LANCZOS) for image in drawn]


def aim(page: Path, camera: Camera) -> None:
    """Let a motion page begin with this camera."""
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("</body>", f"{camera.script()}</body>"), encoding="utf-8")


def tube_mesh(points: ArrayLike, radius: ArrayLike, corners: int = 10) -> TriangleMesh:
    """Return a tube along points.

    Args:
        points: Its middle line, shape (k, 3) [m]; neighbors that coincide count once.
        radius: At all points, or at each, shape (k,) [m].
        corners: Of its section.

    Returns:
        The mesh; its ends are open.
    """
    line = np.asarray(points, dtype=float)
    radii = np.broadcast_to(np.asarray(radius, dtype=float), len(line))
    kept = np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9])
    line, radii = line[kept], radii[kept]
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    side = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    angles = np.arange(corners) * (2 * np.pi / corners)
    rings = []
    for center, tangent, r in zip(line, tangents, radii, strict=True):
        side = side - (side @ tangent) * tangent  # carried along without twisting
        side /= np.linalg.norm(side)
        ring: NDArray[np.float64] = np.outer(np.cos(angles), side)
        rings.append(center + r * (ring + np.outer(np.sin(angles), np.cross(tangent, side))))
    here = np.arange(corners)
    after = np.roll(here, -1)
    faces = [
        corner
        for first in range(0, corners * (len(line) - 1), corners)
        for corner in (
            np.stack([first + here, first + after, first + corners + after], axis=1),
            np.stack([first + here, first + corners + after, first + corners + here], axis=1),
        )
    ]
    return TriangleMesh(np.concatenate(rings), np.concatenate(faces))
