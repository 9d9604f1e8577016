"""Cameras of images: named views, or a position and a target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite

CameraView: TypeAlias = Literal["three-quarter", "front", "side", "top"]

_LEAST = 0.05
"""Near plane: minimum distance that the camera sees [m]."""


@dataclass(frozen=True, eq=False)
class Viewpoint(FrozenArrays):
    """A camera at any position, for images, videos and pages.

        viewer.save_image("hand.png", q, view=pk.viewer.Viewpoint((1.2, 0.9, 1.1), (0.4, 0.2, 0.8)))

    It is upright, with a vertical field of view of 32 degrees.

    Attributes:
        position: Position of the camera in the world, shape (3,) [m].
        target: Point in the middle of the image, shape (3,) [m]; at least 5 cm away.
    """

    position: NDArray[np.float64]
    target: NDArray[np.float64]

    def __init__(self, position: ArrayLike, target: ArrayLike) -> None:
        place = read_only(as_finite(position, "position of the camera", (3,)))
        aim = read_only(as_finite(target, "target of the camera", (3,)))
        if np.linalg.norm(place - aim) < _LEAST:
            raise InvalidValueError(
                "target of the camera", aim.tolist(), f"a point at least {_LEAST:g} m from its position"
            )
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "target", aim)


def view_options(view: CameraView | Viewpoint) -> dict[str, str]:
    """Return the options of a page's address that select a view.

    Raises:
        UnknownNameError: There is no view of that name.
    """
    if isinstance(view, Viewpoint):
        return {"camera": ",".join(f"{x:.9g}" for x in (*view.position, *view.target))}
    if view not in get_args(CameraView):
        raise UnknownNameError("camera view", view, get_args(CameraView))
    return {"view": view}
