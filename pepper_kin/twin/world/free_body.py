"""Free bodies: a rigid box or sphere, or a mover of the scene, and its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision.solids import SceneGeometry
from pepper_kin.model import Box, Sphere


@dataclass(frozen=True, eq=False)
class FreeBody(FrozenArrays):
    """A rigid body of uniform density, and its state.  Arrays are read-only.

    Attributes:
        name: Name of the body.
        geometry: Shape of the body, centered at its frame.
        mass: Mass [kg].
        inertia: Principal moments about the axes of its frame [kg m^2], shape (3,).
        friction: Coefficient of friction; the geometric mean of both bodies' coefficients counts.
        pose: `transform_body_to_world`, shape (4, 4).
        velocity: Velocity of its center [m/s], then angular velocity [rad/s], in world axes, shape (6,).
    """

    name: str
    geometry: SceneGeometry
    mass: float
    inertia: Array
    friction: float
    pose: Array
    velocity: Array

    def __post_init__(self) -> None:
        for name in ("inertia", "pose", "velocity"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def position(self) -> Array:
        """Position of its center in the world [m], shape (3,), read-only."""
        return self.pose[:3, 3]

    @property
    def momentum(self) -> Array:
        """Linear, m v [N s], then angular about the world's origin, x x m v + I w [N m s], shape (6,)."""
        linear = self.mass * self.velocity[:3]
        rotation = self.pose[:3, :3]
        spin = rotation @ (self.inertia * (rotation.T @ self.velocity[3:]))
        return np.concatenate([linear, np.cross(self.position, linear) + spin])

    @property
    def kinetic_energy(self) -> float:
        """Kinetic energy of translation and rotation, m v^2 / 2 + w . I w / 2 [J]."""
        turning = self.pose[:3, :3].T @ self.velocity[3:]
        moving = self.velocity[:3]
        return float(self.mass * moving @ moving + self.inertia @ turning**2) / 2


def principal_inertia(geometry: Box | Sphere, mass: float) -> Array:
    """Return the principal moments of inertia of a body of uniform density [kg m^2], shape (3,)."""
    if isinstance(geometry, Sphere):
        return np.full(3, 0.4 * mass * geometry.radius**2)
    squares = np.square(geometry.size)
    return mass / 12 * (squares.sum() - squares)
