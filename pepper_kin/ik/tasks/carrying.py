"""Tasks on the center of mass and the torques of a robot that carries something."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pepper_kin.ik.tasks.center_of_mass import CenterOfMass
from pepper_kin.ik.tasks.center_of_mass_over_wheels import CenterOfMassOverWheels
from pepper_kin.ik.tasks.holding_torque import HoldingTorque
from pepper_kin.ik.tasks.task import Task

if TYPE_CHECKING:
    from pepper_kin.dynamics.load import Loads


def with_loads(tasks: Iterable[Task], loads: Loads) -> list[Task]:
    """Return tasks of which those on the center of mass and on torques count what is carried.

    These are evaluated in Python: there is machine code for them without loads only.  Tasks that count
    something already stay as they are.
    """
    found = []
    for task in tasks:
        if (
            loads
            and isinstance(task, CenterOfMass | CenterOfMassOverWheels | HoldingTorque)
            and not task.loads
        ):
            task = task.altered(loads=loads)
        found.append(task)
    return found
