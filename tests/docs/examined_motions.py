"""Motions that programs of the documentation make, each examined by the certificate and on the twin."""

import ast
from collections.abc import Iterator
from typing import Any

import numpy as np

import pepper_kin as pk

MOST_BEHIND = 0.01
"""Greatest distance of the twin from a motion that a page makes [rad or m]."""


def run_examined(source: str, name: str, namespace: dict[str, Any]) -> list[str]:
    """Run a program statement by statement; return what is wrong with the motions that it makes."""
    examined = dict(_motions(namespace))
    faults: dict[str, list[str]] = {}
    for statement in ast.parse(source, name).body:
        exec(compile(ast.Module([statement], []), name, "exec"), namespace)
        examine(namespace, examined, faults)
    return [fault for found in faults.values() for fault in found]


def examine(
    namespace: dict[str, Any], examined: dict[str, pk.Trajectory], faults: dict[str, list[str]]
) -> None:
    """Examine the motions that variables of a program hold since its last statement.

    A variable whose motion was at fault is cleared by another one, as where a program checks and repairs it.

    Args:
        namespace: The program's variables.
        examined: The motion of each variable that was examined last; brought up to date.
        faults: What is wrong with it; brought up to date.
    """
    for variable, motion in _motions(namespace):
        if examined.get(variable) is not motion:
            examined[variable] = motion
            faults[variable] = [f"{variable}: {fault}" for fault in _faults(motion, namespace)]


def _motions(namespace: dict[str, Any]) -> Iterator[tuple[str, pk.Trajectory]]:
    """Yield the variables of a program that are motions, or results with one."""
    for variable, value in list(namespace.items()):
        found = value if isinstance(value, pk.Trajectory) else getattr(value, "trajectory", None)
        if isinstance(found, pk.Trajectory) and not isinstance(value, type):
            yield variable, found


def _faults(motion: pk.Trajectory, namespace: dict[str, Any]) -> list[str]:
    """Return what fails of a motion for the newest robot of a program that has its joints."""
    robots = [one for one in namespace.values() if isinstance(one, pk.PepperModel)]
    robots = [one for one in robots if one.joint_names == motion.joint_names] or [pk.load_pepper()]
    robot = robots[-1]
    if robot.joint_names != motion.joint_names or robot.requirements.balance is None:
        return []
    certificate = motion.check(robot, collisions=False)
    if not certificate.success:
        return [", ".join(certificate.failures)]
    run = pk.Twin(robot).execute(motion, hold_time=0.5)
    behind = float(np.abs(run.position - run.reference_position).max())
    return [] if behind <= MOST_BEHIND else [f"the twin is {1000 * behind:.1f} mrad or mm behind"]
