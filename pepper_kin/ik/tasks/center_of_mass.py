"""Task that brings the center of mass over a point of the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.loads import center_of_mass_jacobian_with, center_of_mass_with
from pepper_kin.dynamics import center_of_mass, center_of_mass_jacobian
from pepper_kin.dynamics.load import Loads
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, joints_that_change
from pepper_kin.ik.tasks.task import POSITION_TOLERANCE, PointTask, as_targets
from pepper_kin.model import PepperModel

LABEL = "center of mass"


def center_of(pepper: PepperModel, loads: Loads, q: Array) -> Array:
    """Return the center of mass of a robot with its loads [m], shape (3,), at q, shape (n,)."""
    if not loads:
        return center_of_mass(pepper, q)
    return center_of_mass_with(pepper, loads, q)


def center_jacobian_of(pepper: PepperModel, loads: Loads, q: Array) -> Array:
    """Return the Jacobian of `center_of`, shape (3, n), at q, shape (n,)."""
    if not loads:
        return center_of_mass_jacobian(pepper, q)
    return center_of_mass_jacobian_with(pepper, loads, q)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class CenterOfMass(PointTask):
    """The center of mass c of the whole robot is over a point p of the floor: r(q) = c_xy(q) - p, error |r|.

    dr/dq = the first two rows of J_c, see `pepper_kin.dynamics.center_of_mass_jacobian`; the height is free.
    Objects with a mass that are attached in the scene of a search count.

    Attributes:
        target: The point p in the world, x and y [m], shape (2,), read-only.
        loads: Carried objects; a search sets them from its scene.
    """

    target: Array
    loads: Loads
    ground: ClassVar[str] = " of the floor"

    def __init__(
        self,
        point: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        target = read_only(as_targets(point, f"point of {LABEL}", (2,)))
        super().__init__(LABEL, weight=weight, tolerance=tolerance, hard=hard, target=target, loads=())

    def place(self, pepper: PepperModel, q: Array) -> Array:
        """Return c_xy [m], shape (2,)."""
        return center_of(pepper, self.loads, q)[:2]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return the rows of x and y of J_c, shape (2, n)."""
        return center_jacobian_of(pepper, self.loads, q)[:2]

    def _structure(self) -> TaskStructure | None:
        return None if self.loads else TaskStructure(CenterOfMass, target_size=2, hard=self.hard)

    @staticmethod
    def moved_by(pepper: PepperModel, task: TaskStructure) -> np.ndarray:
        """Return whether each joint moves the center of mass horizontally, shape (n,)."""
        return joints_that_change(pepper, lambda q: center_of_mass_jacobian(pepper, q)[:2])

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return c_xy - p and the rows of x and y of J_c."""
        center, jacobian = motion.center
        return center[:2] - target, jacobian[:2, :]
