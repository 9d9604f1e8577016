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
    examined = {id(motion): motion for _, motion in _motions(namespace)}
    faults = []
    for statement in ast.parse(source, name).body:
        exec(compile(ast.Module([statement], []), name, "exec"), namespace)
        faults += faults_of_motions(namespace, examined)
    return faults


def faults_of_motions(namespace: dict[str, Any], examined: dict[int, pk.Trajectory]) -> list[str]:
    """Return what is wrong with the motions among a program's variables that were not examined before.

    Args:
        namespace: The program's variables.
        examined: Motions by identity; new ones are added, so that no identity is used twice.
    """
    faults = []
    for variable, motion in _motions(namespace):
        if id(motion) not in examined:
            examined[id(motion)] = motion
            faults += [f"{variable}: {fault}" for fault in _faults(motion, namespace)]
    return faults


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
