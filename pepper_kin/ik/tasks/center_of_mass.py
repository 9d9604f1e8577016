"""Bring the center of mass over a point of the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.dynamics import center_of_mass, center_of_mass_jacobian
from pepper_kin.dynamics.load import Loads
from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik.tasks.task import (
    POSITION_TOLERANCE,
    Array,
    Task,
    as_targets,
    words_for_length,
    words_for_vector,
)
from pepper_kin.model import PepperModel

LABEL = "center of mass"


def center_of(pepper: PepperModel, loads: Loads, q: Array) -> Array:
    """Return the center of mass of a robot with what it carries [m], shape (3,), at q, shape (n,)."""
    if not loads:
        return center_of_mass(pepper, q)
    from pepper_kin.collision.loads import center_of_mass_with  # loads the checkers of collisions

    return center_of_mass_with(pepper, loads, q)


def center_jacobian_of(pepper: PepperModel, loads: Loads, q: Array) -> Array:
    """Return the Jacobian of `center_of`, shape (3, n), at q, shape (n,)."""
    if not loads:
        return center_of_mass_jacobian(pepper, q)
    from pepper_kin.collision.loads import center_of_mass_jacobian_with

    return center_of_mass_jacobian_with(pepper, loads, q)


@dataclass(frozen=True, eq=False, init=False)
class CenterOfMass(Task):
    """The center of mass c of the whole robot is over a point p of the floor: r(q) = c_xy(q) - p, error |r|.

    dr/dq = the first two rows of J_c, see `pepper_kin.dynamics.center_of_mass_jacobian`; the height is free.
    Objects that are attached with a mass in the scene of a search count.

    Attributes:
        target: The point p in the world, x and y [m], shape (2,), read-only.
        weight: Weight in the sum of squares.
        tolerance: Largest distance on the floor of a task that is met [m].
        hard: Whether it is met even where soft tasks suffer from it.
        frame: None: it acts on the whole robot.
        label: "center of mass".
        loads: What the robot carries; a search sets it from its scene.
    """

    target: Array
    weight: float
    tolerance: float
    hard: bool
    frame: None
    label: str
    loads: Loads
    unit: ClassVar[str] = "m"

    def __init__(
        self,
        point: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        self._fill(
            LABEL, weight, tolerance, hard,
            target=read_only(as_targets(point, f"point of {LABEL}", (2,))),
            frame=None, label=LABEL, loads=(),
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return c_xy - p [m], shape (2,)."""
        return np.asarray(center_of(pepper, self.loads, q)[:2] - self.target)

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return the rows of x and y of J_c, shape (2, n)."""
        return center_jacobian_of(pepper, self.loads, q)[:2]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return how far from the point the center of mass stops, in words, at q, shape (n,) [rad or m]."""
        distance = words_for_length(self.error(pepper, q))
        return f"{self.label} stops {distance} short of {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the point of the floor below the center of mass, in words, at q, shape (n,) [rad or m]."""
        return f"point {words_for_vector(center_of(pepper, self.loads, q)[:2])} of the floor"
