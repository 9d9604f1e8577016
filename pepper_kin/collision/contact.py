"""Closest pairs, clearances and contacts of two bodies that touch or nearly touch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import FrozenArrays


@dataclass(frozen=True, eq=False)
class ClosestPair(FrozenArrays):
    """The two bodies that are nearest to one another.

    Attributes:
        names: Names of the two: links of the robot, or a link and a scene object.
        distance: Distance [m]; if negative, the depth of their overlap.
        points: (2, 3) the nearest points, one on each, in the world [m].
        links: Link or frame that each moves with; None for an obstacle of the world.
    """

    names: tuple[str, str]
    distance: float
    points: NDArray[np.float64]
    links: tuple[str | None, str | None] = (None, None)


@dataclass(frozen=True)
class Clearance:
    """Minimum distances of the robot, with attached objects, to itself and to obstacles.

    Attributes:
        itself: Distance between its own parts [m], at most 0 in contact.
        obstacles: Distance to the objects of the scene [m], at most 0 in contact; inf without objects.
    """

    itself: float
    obstacles: float

    @property
    def least(self) -> float:
        """Minimum of the two distances [m]."""
        return min(self.itself, self.obstacles)

    def sentence(self) -> str:
        """Return both distances in words, obstacles first."""
        far = math.isinf(self.obstacles)
        around = "no obstacles" if far else f"{1000 * self.obstacles:.1f} mm from obstacles"
        return around if math.isinf(self.itself) else f"{around}, {1000 * self.itself:.1f} mm from itself"

    def as_dict(self) -> dict[str, float | None]:
        """Return the distances for JSON; None stands for infinity."""
        return {name: value if math.isfinite(value) else None for name, value in vars(self).items()}


@dataclass(frozen=True, eq=False)
class Contact(FrozenArrays):
    """A pair of bodies that touch, or that are nearer than the requested distance.

    The two links of a dependent range (`pepper_kin.collision.dependent_ranges`) are known to touch but not
    where: their distance, points and normal are None.

    Attributes:
        names: Names of the two: links of the robot or objects.
        distance: Distance [m]; if negative, the depth of their overlap.
        points: (2, 3) the nearest points, or the deepest where they overlap, one on each, in the world [m].
        normal: (3,) unit vector from the first to the second; moving the second along it by the depth ends
            the overlap.
        links: Link or frame that each moves with; None for an obstacle of the world.
    """

    names: tuple[str, str]
    distance: float | None
    points: NDArray[np.float64] | None
    normal: NDArray[np.float64] | None
    links: tuple[str | None, str | None]

    @property
    def depth(self) -> float | None:
        """Depth of the overlap [m], 0 without overlap; None if it is not known."""
        return None if self.distance is None else max(-self.distance, 0.0)
