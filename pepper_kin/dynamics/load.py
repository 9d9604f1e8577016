"""Load: a rigid object fixed to a frame of the robot."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from pepper_kin.arrays import Array

PARAMETERS = 10
"""Number of inertial parameters of a load in machine code: mass m [kg], first moments h = m c [kg m], and
xx, xy, xz, yy, yz, zz of the second moments Sigma = sum(m x x^T) [kg m^2], about the origin of a frame."""

STATIC_PARAMETERS = 4
"""Number of the first parameters, m and h, which suffice at rest."""


class Load(NamedTuple):
    """A rigid object fixed to a frame; by default a point mass at the frame's origin.

    Attributes:
        frame: The link or frame that carries it.
        mass: Mass [kg].
        center: Center of mass in the frame's axes [m].
        inertia: xx, xy, xz, yy, yz and zz of the inertia about the center of mass, in the frame's axes
            [kg m^2].
        name: Name of the object in its scene; empty for a payload.
    """

    frame: str
    mass: float
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    name: str = ""

    @property
    def tensor(self) -> Array:
        """Inertia about the center of mass, shape (3, 3) [kg m^2]."""
        xx, xy, xz, yy, yz, zz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def is_point(self) -> bool:
        """Whether the load is a point mass at the frame's origin."""
        return not (any(self.center) or any(self.inertia))

    def __str__(self) -> str:
        what = f" of {self.name!r}" if self.name else ""
        return f"{self.mass:.4g} kg{what} at {self.frame}"


Loads: TypeAlias = tuple[Load, ...]


def carried_words(loads: Loads) -> str:
    """Return the loads in words, such as " with 0.3 kg at LArm_effector"; empty for none."""
    return "".join(f" with {load}" for load in loads)
