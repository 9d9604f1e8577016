"""A camera for pictures: it stands where the given points fill the frame, and knows where each one lands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FIELD_OF_VIEW = 32.0  # [degree], vertical


@dataclass(frozen=True)
class Camera:
    """A pinhole.

    Attributes:
        position: Where it is in the world, shape (3,) [m].
        target: What is in the middle of the picture, shape (3,) [m].
        size: Width and height of the picture [pixel].
    """

    position: Array
    target: Array
    size: tuple[int, int]

    def project(self, points: ArrayLike) -> Array:
        """Return where points of the world are in the picture, shape (..., 2) [pixel from the upper left]."""
        right, up, back = _axes(self.position - self.target)
        offset = np.asarray(points, dtype=float) - self.position
        scale = self.size[1] / (2 * np.tan(np.radians(FIELD_OF_VIEW) / 2)) / -(offset @ back)
        return np.array(self.size) / 2 + np.stack([offset @ right * scale, -(offset @ up) * scale], axis=-1)

    def script(self) -> str:
        """Return the script that puts a motion page's camera here; three.js has y up."""
        (px, py, pz), (tx, ty, tz) = self.position, self.target
        return (
            "<script>(() => { const { camera, controls } = pepperKin.viewer;"
            f" camera.fov = {FIELD_OF_VIEW}; controls.target.set({tx}, {tz}, {-ty});"
            f" camera.position.set({px}, {pz}, {-py}); controls.update(); pepperKin.viewer.set_dirty();"
            " })();</script>"
        )


def framing(
    points: ArrayLike,
    size: tuple[int, int],
    azimuth: float = 38.0,
    elevation: float = 14.0,
    *,
    margin: float = 1.08,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Camera:
    """Return the camera that sees points as large as the picture allows.

    Args:
        points: What must be in the picture, shape (k, 3) [m].
        size: Width and height of the picture [pixel].
        azimuth: From the front towards the robot's left [degree].
        elevation: Above the horizon [degree].
        margin: Distance, as a multiple of the least.
        shift: How far what is seen moves to the right and up, in heights of the picture.

    Returns:
        The camera.
    """
    a, e = np.radians([azimuth, elevation])
    axes = _axes(np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]))
    visible = np.asarray(points, dtype=float).reshape(-1, 3) @ np.array(axes).T
    middle = (visible.min(axis=0) + visible.max(axis=0)) / 2
    slope = np.tan(np.radians(FIELD_OF_VIEW) / 2)
    wide, high = (np.abs(visible[:, :2] - middle[:2]) / [slope * size[0] / size[1], slope]).T
    distance = margin * max(0.3, float((visible[:, 2] - middle[2] + np.maximum(wide, high)).max()))
    target = middle @ np.array(axes)
    target -= 2 * slope * distance * (shift[0] * axes[0] + shift[1] * axes[1])
    return Camera(target + distance * axes[2], target, size)


def _axes(backward: Array) -> tuple[Array, Array, Array]:
    """Return the picture's right and up and the direction to the viewer, in the world."""
    back = backward / np.linalg.norm(backward)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right), back
