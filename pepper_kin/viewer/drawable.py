"""Drawable bodies: a shape, a color and the link that it moves with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import BriefRepr, read_only
from pepper_kin.collision.solids import SceneGeometry
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.shapes import NO_COLOR, Mesh, Shape, Sphere
from pepper_kin.viewer.surface import DrawnSurface, read_colored_surfaces

Color: TypeAlias = tuple[float, float, float, float]

TARGET_COLOR: Color = (0.93, 0.36, 0.2, 1.0)

_RIGID_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Drawable(BriefRepr):
    """A shape in the scene.

    Attributes:
        name: Name, unique within its link.
        link: Name of the link that the shape is fixed to, or None for the world.
        geometry: Geometry of the shape, or a surface that is shaded smoothly by its vertices.
        transform_shape_to_link: Pose of the shape in the link (or in the world), shape (4, 4) [m].
        color: Red, green, blue and opacity, each in [0, 1].
        through: Whether it is drawn over objects in front of it.
    """

    name: str
    link: str | None
    geometry: SceneGeometry | DrawnSurface
    transform_shape_to_link: NDArray[np.float64]
    color: Color
    through: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.geometry, SceneGeometry | DrawnSurface):
            raise InvalidValueError(
                f"geometry of {self.name!r}",
                type(self.geometry).__name__,
                "Box, Sphere, Cylinder, Capsule, Mesh, HalfSpace, ConvexMesh, TriangleMesh, PointCloud "
                "or Surface",
            )
        quantity = f"transform_shape_to_link of {self.name!r}"
        pose = rigid_transforms(quantity, self.transform_shape_to_link, (4, 4))
        object.__setattr__(self, "transform_shape_to_link", pose)
        color = as_finite(self.color, f"color of {self.name!r}", (4,))
        if not ((color >= 0.0) & (color <= 1.0)).all():
            raise InvalidValueError(
                f"color of {self.name!r}", self.color, "numbers in [0, 1]: r, g, b, opacity"
            )
        object.__setattr__(self, "color", tuple(color.tolist()))

    @classmethod
    def from_shape(cls, shape: Shape) -> Drawable:
        """Convert a robot's shape to a drawable."""
        return cls(shape.name, shape.link, shape.geometry, shape.transform_shape_to_link, shape.color)

    @classmethod
    def all_of_shape(cls, shape: Shape) -> tuple[Drawable, ...]:
        """Convert a robot's shape to drawables: one, or one for each color of its mesh file.

        The file's colors are used if the description gives none, as in RViz.

        Raises:
            FileFormatError: The mesh file cannot be read.
        """
        whole = cls.from_shape(shape)
        surfaces = colored_surfaces_of(shape)
        if surfaces is None:
            return (whole,)
        return tuple(
            replace(whole, name=f"{shape.name}/{index}", geometry=surface, color=color)
            for index, (surface, color) in enumerate(surfaces)
        )


def colored_surfaces_of(shape: Shape) -> tuple[tuple[DrawnSurface, Color], ...] | None:
    """Return scaled surfaces [m] and colors of a shape's mesh file; None if its colors are not used."""
    mesh = shape.geometry
    if not isinstance(mesh, Mesh) or shape.color != NO_COLOR or mesh.path.suffix.lower() in (".stl", ".obj"):
        return None
    scale = np.broadcast_to(np.asarray(mesh.scale, dtype=float), 3)
    return tuple(
        (
            DrawnSurface((part.vertices * scale).astype(np.float32), part.faces),
            NO_COLOR if color is None else color,
        )
        for part, color in read_colored_surfaces(mesh.path)
    )


def marker(name: str, position: ArrayLike, radius: float = 0.03, color: Color = TARGET_COLOR) -> Drawable:
    """Create a sphere that marks a target.

    Args:
        name: Name on the page.
        position: Center in the world, shape (3,) [m].
        radius: Radius of the sphere [m].
        color: Red, green, blue and opacity, each in [0, 1].

    Returns:
        The sphere, fixed to the world.

    Raises:
        InvalidValueError: `position` is not three finite numbers, or `color` is not four numbers in [0, 1].
    """
    pose = np.eye(4)
    pose[:3, 3] = as_finite(position, f"position of {name!r}", (3,))
    return Drawable(name, None, Sphere(radius), pose, color)


def seen_through(ball: Drawable) -> Drawable:
    """Return a faint copy of a marker, drawn over all else, so that a target inside a cup is visible."""
    red, green, blue, opacity = ball.color
    return replace(ball, name=f"{ball.name} behind", color=(red, green, blue, 0.55 * opacity), through=True)


def rigid_transforms(quantity: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Copy transforms and check that they are rigid.

    Args:
        quantity: Name of the quantity, for errors.
        value: Transforms [m], shape (..., 4, 4).
        shape: Required shape, (..., 4, 4).

    Returns:
        A read-only copy.

    Raises:
        InvalidValueError: Wrong shape, NaN or infinite, or not a rotation and a translation.
    """
    poses = read_only(as_finite(value, quantity, shape))
    rotation = poses[..., :3, :3]
    departure = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max(axis=(-2, -1))
    bottom = np.abs(poses[..., 3, :] - [0.0, 0.0, 0.0, 1.0]).max(axis=-1)
    wrong = (departure > _RIGID_TOLERANCE) | (bottom > _RIGID_TOLERANCE) | (np.linalg.det(rotation) < 0.0)
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0]) if wrong.ndim else ()
        raise InvalidValueError(
            quantity,
            f"a matrix that is not rigid{f' at index {index}' if index else ''}",
            "a rotation, a translation and the row 0 0 0 1",
        )
    return poses
