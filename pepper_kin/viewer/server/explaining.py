"""Explanations for visitors: why the robot gets no nearer to its targets."""

from __future__ import annotations

import copy
from collections.abc import Sequence

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, contacts
from pepper_kin.ik import IKResult, IKStatus, solve
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.viewer.server.words import joint_words, length_words, listed, pair_words, sentence

RESTARTS = 8
_SHARES = (0.1, 0.3, 1.0)
"""Fractions of the remaining path, tried in order: the first contact is the obstruction."""
_NEAR = 0.006
"""Distance below which bodies count as touching [m]: the servo keeps 5 mm."""
_NEARER = 0.0005
"""Decrease of a distance up to which a pair is no obstruction [m]."""


def at_target(tasks: Sequence[Task]) -> str:
    """Return a sentence for a robot at its targets."""
    who = listed(_who(task) for task in tasks)
    return sentence(f"{who} is at its target." if len(tasks) == 1 else f"{who} are at their targets.")


def on_the_way(tasks: Sequence[Task]) -> str:
    """Return a sentence for a robot on the way to its targets."""
    who = listed(_who(task) for task in tasks)
    return sentence(f"{who} follows its target." if len(tasks) == 1 else f"{who} follow their targets.")


def why_no_closer(pepper: PepperModel, q: Array, tasks: Sequence[Task], scene: Scene) -> str:
    """Explain why the robot is at rest at q, shape (n,) [rad or m], before its tasks are met.

    Inverse kinematics from several starts finds solutions that the local servo cannot.
    """
    return no_closer(pepper, q, tasks, scene, solve(pepper, list(tasks), q, scene=scene, restarts=RESTARTS))


def no_closer(pepper: PepperModel, q: Array, tasks: Sequence[Task], scene: Scene, found: IKResult) -> str:
    """Explain why tasks are not met at q, shape (n,) [rad or m], from a result of inverse kinematics."""
    unmet = [task for task in tasks if task.error(pepper, q) > task.tolerance] or list(tasks)
    who = listed(_who(task) for task in unmet)
    turn = all(task.unit == "rad" for task in unmet)
    begin = sentence(f"{who} cannot {'turn there' if turn else 'get closer'}")
    touch = what_would_touch(pepper, q, tasks, scene)
    if touch.startswith(f"{who} "):
        touch = f"it{touch.removeprefix(who)}"
    if found.success:
        reason = f": {touch}" if touch else " this way"
        return f"{begin}{reason}. Another posture reaches the target: press Plan to go around."
    if found.status is IKStatus.CLOSEST_COLLISION and touch:
        return f"{begin}: {touch}. Move the target or what is in the way."
    if found.status is IKStatus.CLOSEST_UNREACHABLE:
        return f"{begin}: {_beyond(unmet, found)}. Bring the target nearer."
    limits = found.blocking_limits or found.active_limits
    if limits:
        verb = "is at the end of its range" if len(limits) == 1 else "are at the ends of their ranges"
        return f"{begin}: {listed(joint_words(name) for name in limits)} {verb}. Move the target."
    return f"{begin}: {touch}. Move the target." if touch else f"{begin}. Move the target."


def what_would_touch(pepper: PepperModel, q: Array, tasks: Sequence[Task], scene: Scene) -> str:
    """Say which bodies would touch if the robot went on toward its tasks; "" if none.

    Args:
        pepper: Model of the robot.
        q: Joint positions [rad or m], shape (n,).
        tasks: Tasks to meet.
        scene: Scene around the robot.
    """
    now = {contact.names: contact.distance for contact in contacts(pepper, q, scene, within=_NEAR)}
    for share in _SHARES:
        ahead = [_part_of_the_way(pepper, q, task, share) for task in tasks]
        beyond = solve(pepper, ahead, q, restarts=0).q
        for contact in contacts(pepper, beyond, scene, within=_NEAR):
            before = now.get(contact.names, _NEAR)
            if contact.distance is None or before is None or contact.distance < before - _NEARER:
                return "{} would touch {}".format(*pair_words(pepper, contact))
    return ""


def _part_of_the_way(pepper: PepperModel, q: Array, task: Task, share: float) -> Task:
    """Return a copy of a task with its target between its frame's position and its own target.

    Args:
        pepper: Model of the robot.
        q: Joint positions [rad or m], shape (n,).
        task: Task to copy.
        share: Fraction of the way to the target, 0 to 1.
    """
    if task.unit != "m" or task.frame is None:
        return task
    place = frame_pose(pepper, q, task.frame)[:3, 3]
    nearer = copy.copy(task)
    target = place + share * (getattr(task, task.target_name) - place)
    object.__setattr__(nearer, task.target_name, target)
    return nearer


def _beyond(unmet: Sequence[Task], found: IKResult) -> str:
    """Say how far the farthest target is out of reach."""
    names = {task.label for task in unmet}
    lengths = [error.value for error in found.errors if error.unit == "m" and error.label in names]
    if not lengths:
        return "the head cannot turn that far"
    return f"the target is {length_words(max(lengths))} out of reach"


def _who(task: Task) -> str:
    return "the gaze" if task.unit == "rad" else f"the {task.label}"
