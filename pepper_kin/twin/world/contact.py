"""Contacts of a world's last step, and how they were solved."""

from __future__ import annotations

from dataclasses import dataclass

from pepper_kin.arrays import Array, BriefRepr, FrozenArrays, read_only


@dataclass(frozen=True, eq=False)
class WorldContact(FrozenArrays):
    """A point where two bodies touched, or could have touched, during the last step.  Arrays are read-only.

    Attributes:
        names: Names of the robot's links or objects; the one that moves more freely comes first.
        point: Contact point in the world [m], shape (3,).
        normal: Unit vector from the second body to the first, shape (3,).
        gap: Gap between the surfaces before the step [m], below zero if they overlap.
        force: Force on the first body during the step [N], shape (3,); opposite on the second body.
    """

    names: tuple[str, str]
    point: Array
    normal: Array
    gap: float
    force: Array

    def __post_init__(self) -> None:
        for name in ("point", "normal", "force"):
            if getattr(self, name).flags.writeable:
                object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class StepSolution(BriefRepr):
    """Velocities after a step, and the contact impulses.

    Attributes:
        velocity: Velocities u, shape (N,).
        impulses: Normal, first and second tangent of each point [N s], shape (3 k,).
        solver: Name of the solver.
        problems: Number of convex problems solved.
        coulomb_error: Normal velocity by which sliding contacts deviate from Coulomb's law [m/s].
    """

    velocity: Array
    impulses: Array
    solver: str
    problems: int
    coulomb_error: float
