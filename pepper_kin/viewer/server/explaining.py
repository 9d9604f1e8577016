"""Explanations for visitors: why the body does not get nearer to its targets."""

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
"""Of the rest of the way, tried one after the other: what would touch first is what is in the way."""
_NEAR = 0.006
"""Distance that counts as touching [m]: the servo keeps 5 mm."""
_NEARER = 0.0005
"""What comes nearer by less than this is not in the way [m]."""


def at_target(tasks: Sequence[Task]) -> str:
    """Return the sentence that says that the body has arrived."""
    who = listed(_who(task) for task in tasks)
    return sentence(f"{who} is at its target." if len(tasks) == 1 else f"{who} are at their targets.")


def on_the_way(tasks: Sequence[Task]) -> str:
    """Return the sentence that says that the body follows."""
    who = listed(_who(task) for task in tasks)
    return sentence(f"{who} follows its target." if len(tasks) == 1 else f"{who} follow their targets.")


def why_no_closer(pepper: PepperModel, q: Array, tasks: Sequence[Task], scene: Scene) -> str:
    """Say why the body rests at joint positions q, shape (n,) [rad or m], without having met its tasks.

    Inverse kinematics from many starts finds what the servo, which is local, cannot.
    """
    return no_closer(pepper, q, tasks, scene, solve(pepper, list(tasks), q, scene=scene, restarts=RESTARTS))


def no_closer(pepper: PepperModel, q: Array, tasks: Sequence[Task], scene: Scene, found: IKResult) -> str:
    """Say why tasks are not met at q, shape (n,) [rad or m], given what inverse kinematics found."""
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
    """Say what would touch what if the body went on toward its tasks; empty where nothing would.

    Args:
        pepper: The robot.
        q: Where it is [rad or m], shape (n,).
        tasks: What it is to meet.
        scene: The world around it.
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
    """Return a task whose target lies on the way from where its frame is to the task's own.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        task: The task.
        share: Part of the way, 0 to 1.
    """
    if task.unit != "m" or task.frame is None:
        return task
    place = frame_pose(pepper, q, task.frame)[:3, 3]
    nearer = copy.copy(task)
    target = place + share * (getattr(task, task.target_name) - place)
    object.__setattr__(nearer, task.target_name, target)
    return nearer


def _beyond(unmet: Sequence[Task], found: IKResult) -> str:
    """Say by how much the farthest target is out of reach."""
    names = {task.label for task in unmet}
    lengths = [error.value for error in found.errors if error.unit == "m" and error.label in names]
    if not lengths:
        return "the head cannot turn that far"
    return f"the target is {length_words(max(lengths))} out of reach"


def _who(task: Task) -> str:
    return "the gaze" if task.unit == "rad" else f"the {task.label}"
