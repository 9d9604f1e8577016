"""Tasks on center of mass and torques of a robot with loads."""

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
    """Return the tasks, with loads set in tasks on the center of mass and on torques.

    Tasks with loads are evaluated in Python: their machine code exists without loads only. Tasks that have
    loads already are not changed.
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
