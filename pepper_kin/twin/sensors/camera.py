"""Pinhole cameras: depth and color pictures of scene and robot."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.shading import Surfaces, place_rays, shade
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import MOST, as_finite, as_real, check_positive, check_whole, shown
from pepper_kin.twin.sensors.noise import within_range
from pepper_kin.twin.sensors.robot_rays import RobotRays, no_surfaces
from pepper_kin.twin.sensors.specification import sensor_specifications

MOST_PIXELS = 10_000
"""Most columns, or rows, of an image."""
_EMPTY = Scene()


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole with a lens; see `camera_intrinsics`.

    A point at (x, y, z) in the optical frame (z forward, x right, y down) projects to column fx x / z + cx
    and row fy y / z + cy; pixel centers have whole numbers.

    Attributes:
        width: Columns, 1 to 10,000.
        height: Rows, 1 to 10,000.
        fx: [pixels].
        fy: [pixels].
        cx: [pixels].
        cy: [pixels].
        k1: Radial distortion.
        k2: Radial distortion.
        p1: Tangential distortion.
        p2: Tangential distortion.
        k3: Radial distortion.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: for pixels that are not a whole number above 0, or a number that is not finite.
        """
        for name in ("width", "height"):
            check_whole(name, getattr(self, name), 1, MOST_PIXELS)
        for name in ("fx", "fy"):
            check_positive(name, getattr(self, name), "[pixels]")
        for name in ("cx", "cy", "k1", "k2", "p1", "p2", "k3"):
            if not math.isfinite(as_real(getattr(self, name))):
                raise InvalidValueError(name, getattr(self, name), "a finite number")

    def distorted(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return where the lens puts points of the plane z = 1 (Brown, Decentering distortion, 1966).

        Args:
            x: To the right, shape (...).
            y: Down, shape (...).
        """
        square = x * x + y * y
        radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3))
        return (
            x * radial + 2 * self.p1 * x * y + self.p2 * (square + 2 * x * x),
            y * radial + self.p1 * (square + 2 * y * y) + 2 * self.p2 * x * y,
        )

    def rays(self, lens: bool = False) -> Array:
        """Return the point of the plane z = 1 that each pixel projects to, in the optical frame.

        Args:
            lens: Whether to apply the lens's distortion, which is inverted by iteration.

        Returns:
            Points, shape (height, width, 3).
        """
        u, v = np.meshgrid(np.arange(self.width, dtype=np.float64), np.arange(self.height, dtype=np.float64))
        image_x, image_y = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        x, y = image_x, image_y
        for _ in range(30 if lens else 0):
            off_x, off_y = self.distorted(x, y)
            x, y = x + image_x - off_x, y + image_y - off_y
        return np.stack([x, y, np.ones_like(x)], axis=-1)


@cache
def camera_intrinsics(name: str, resolution: str = "QVGA") -> Intrinsics:
    """Return the intrinsics of one of Pepper's cameras, the defaults of its ROS driver.

    Args:
        name: "camera_top", "camera_bottom" or "camera_depth".
        resolution: "VGA" (640 x 480), "QVGA" (320 x 240) or "QQVGA" (160 x 120).

    Raises:
        UnknownNameError: for another camera or resolution.
    """
    text = (files("pepper_kin.twin") / "data" / "cameras.json").read_text(encoding="utf-8")
    cameras = json.loads(text)["cameras"]
    if name not in cameras:
        raise UnknownNameError("camera", name, cameras)
    if resolution not in cameras[name]:
        raise UnknownNameError(f"resolution of {name}", resolution, cameras[name])
    return Intrinsics(**cameras[name][resolution])


class Camera:
    """A camera on the robot's head, traced ray by ray: no display, one ray per pixel, no blur.

    It renders the scene, a floor, and the robot's own body except the link that carries it.  Any camera
    gives both depth and color; for one thread at a time.

    Args:
        pepper: The robot.
        name: "camera_top", "camera_bottom" or "camera_depth".
        resolution: "VGA", "QVGA" or "QQVGA".
        intrinsics: Used in place of the published ones.
        lens: Whether pictures are distorted as by the lens; otherwise they are those of a pinhole.
        geometry_type: "visual" for the surfaces of the body that are drawn, "collision" for the shapes around
            them.
        floor: Whether there is a floor at z = 0 besides what the scene holds.
        rays: Rays to share with other cameras of the robot, in place of `geometry_type` and `floor`.
        depth_range: Least and greatest depth that it measures [m]; if omitted, the maker's 0.4 m to 8 m for
            "camera_depth" (see `sensor_specifications`), and (0, inf) for the others.

    Attributes:
        name: Name of the camera.
        intrinsics: In use.
        frame: The optical frame: z forward, x right, y down.
        depth_range: Least and greatest depth that it measures [m].

    Raises:
        UnknownNameError: for another camera or resolution.
        InvalidValueError: for other geometry types, or a range that is none.
    """

    def __init__(
        self,
        pepper: PepperModel,
        name: str = "camera_top",
        resolution: str = "QVGA",
        *,
        intrinsics: Intrinsics | None = None,
        lens: bool = False,
        geometry_type: str = "visual",
        floor: bool = True,
        rays: RobotRays | None = None,
        depth_range: tuple[float, float] | None = None,
    ) -> None:
        published = camera_intrinsics(name, resolution)
        self.pepper, self.name = pepper, name
        self.intrinsics = published if intrinsics is None else intrinsics
        own = sensor_specifications()[name]
        if depth_range is None:
            depth_range = (own.minimum, own.maximum) if own.kind == "depth_camera" else (0.0, np.inf)
        near, far = map(float, depth_range) if np.shape(depth_range) == (2,) else (np.nan, np.nan)
        if not 0.0 <= near < far:
            raise InvalidValueError("depth_range", shown(depth_range), "least and greatest depth [m]")
        self.depth_range = near, far
        self.frame = own.frame
        self._lens = lens
        plane = self.intrinsics.rays(lens).reshape(-1, 3)
        self._cosine = 1.0 / np.linalg.norm(plane, axis=-1)
        self._directions = plane * self._cosine[:, None]
        self._world_rays = np.empty_like(self._directions), np.empty_like(self._directions)
        self._surfaces: Surfaces | None = None
        shared = RobotRays(pepper, geometry_type, blind_to=self.frame, floor=floor) if rays is None else rays
        self._rays = shared

    def depth(self, q: ArrayLike, scene: Scene | None = None) -> Array:
        """Return the distance to the surface at each pixel, along the optical axis.

        Args:
            q: Joint positions [rad or m], shape (n,).
            scene: The world; None for an empty one.

        Returns:
            Depth [m], shape (height, width): -inf for what is nearer than the range, inf where it is farther
            or nothing is (ROS's REP 117).

        Raises:
            InvalidValueError: for a q of wrong length, or with NaN or infinity.
        """
        checked, origins, directions = self._placed(q)
        world = _EMPTY if scene is None else scene
        distance = self._rays.distances_checked(checked, world, origins, directions)
        depth = np.asarray(distance * self._cosine).reshape(self._shape)
        return within_range(*self.depth_range, depth)

    def color(self, q: ArrayLike, scene: Scene | None = None) -> NDArray[np.uint8]:
        """Return a picture with plain shading: one distant light, no shadows, no gloss, a pale sky.

        Args:
            q: Joint positions [rad or m], shape (n,).
            scene: The world; None for an empty one.

        Returns:
            Red, green, blue, shape (height, width, 3).

        Raises:
            InvalidValueError: for a q of wrong length, or with NaN or infinity.
        """
        picture = np.empty(self._directions.shape, np.uint8)
        world = _EMPTY if scene is None else scene
        checked, origins, directions = self._placed(q)
        if self._surfaces is None:
            self._surfaces = no_surfaces(len(directions))
        self._rays.look_checked(checked, world, origins, directions, self._surfaces)
        shade(directions, self._surfaces, picture)
        return picture.reshape(*self._shape, 3)

    def points(self, depth: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Return the points that a depth picture shows, such as for `Scene.add_point_cloud`.

        Pixel (u, v) of depth z shows the point z r(u, v), with r the ray of the pixel in the plane z = 1; see
        `Intrinsics.rays`.

        Args:
            depth: Distances along the optical axis [m], shape (height, width), by `depth` or a sensor; pixels
                without a finite one, above 0, show nothing.
            q: Joint positions when the picture was taken [rad or m], shape (n,), for points in the world;
                None for points in the optical frame.

        Returns:
            Points [m], shape (k, 3), row by row.

        Raises:
            InvalidValueError: for another shape, or a q of wrong length, or with NaN or infinity.
        """
        try:
            far = np.array(depth, dtype=float)
        except (TypeError, ValueError):
            far = np.zeros(0)
        if far.shape != self._shape:
            raise InvalidValueError("depth", shown(depth), f"numbers of shape {self._shape}")
        far = far.reshape(-1)
        seen = np.isfinite(far) & (far > 0)
        points = self._directions[seen] * (far[seen] / self._cosine[seen])[:, None]
        if q is None:
            return np.asarray(points)
        pose = frame_pose(self.pepper, as_finite(q, "q", (self.pepper.n,), MOST), self.frame)
        return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])

    def project(self, q: ArrayLike, points: ArrayLike) -> Array:
        """Return where points of the world appear.

        Args:
            q: Joint positions [rad or m], shape (n,).
            points: In the world [m], shape (k, 3).

        Returns:
            Column and row [pixels] and depth [m], shape (k, 3); NaN for column and row of what is not in
            front of the camera.

        Raises:
            InvalidValueError: for wrong shapes, NaN or infinity.
        """
        pose = frame_pose(self.pepper, as_finite(q, "q", (self.pepper.n,)), self.frame)
        place = (as_finite(points, "points", (None, 3)) - pose[:3, 3]) @ pose[:3, :3]
        depth = place[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = place[:, 0] / depth, place[:, 1] / depth
            if self._lens:
                x, y = self.intrinsics.distorted(x, y)
            u, v = self.intrinsics.fx * x + self.intrinsics.cx, self.intrinsics.fy * y + self.intrinsics.cy
        ahead = depth > 0
        return np.column_stack([np.where(ahead, u, np.nan), np.where(ahead, v, np.nan), depth])

    @property
    def _shape(self) -> tuple[int, int]:
        return self.intrinsics.height, self.intrinsics.width

    def _placed(self, q: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q [rad or m], checked, shape (n,), and start [m] and direction of the rays, shape (k, 3).

        The next call writes to the same arrays: new ones of this size cost more than the rays.
        """
        checked = as_finite(q, "q", (self.pepper.n,), MOST)
        pose = frame_pose(self.pepper, checked, self.frame)
        place_rays(pose, self._directions, *self._world_rays)
        return checked, *self._world_rays
