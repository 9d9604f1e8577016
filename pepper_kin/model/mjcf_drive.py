"""Actuators, couplings, sensors and key frames of the robot in MuJoCo."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.model.kinematic_tree import KinematicTree
from pepper_kin.model.tree_order import coupling_of, leader_of
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.model.xml_text import child, number, numbers

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

STIFFNESS_PER_EFFORT = 20.0
"""Assumed stiffness of a position actuator per unit of its effort limit [1/rad or 1/m].

An error of 0.05 rad calls for the whole effort.  The gains of the real robot's boards are not published.
"""
DAMPING_TIME = 0.1
"""Assumed ratio of an actuator's damping to its stiffness [s]; it damps all of Pepper's joints well."""
FOLLOWER_DAMPING = 3e-4
"""Assumed damping of joints that follow one without mass, Pepper's fingers [N m s/rad].

It stands in for their leader's: a damper on a body without mass would hold it against the constraints.
"""
NARROWEST = 1e-9
"""Least distance of a lower and an upper limit [rad, m or their units of speed and force]."""
BASE_DAMPING = 400.0
"""Assumed gain of the base's velocity actuators [N s/m or N m s/rad]."""


def add_drive(
    root: ET.Element, pepper: PepperModel, tree: KinematicTree, joint_order: list[str], sites: list[str]
) -> None:
    """Add couplings, actuators, sensors and key frames to an MJCF root.

    Every coordinate gets one actuator of its name: the base's follow a velocity, as NAOqi commands it, all
    others a position.  Forces are limited by the effort limits, and so are joints that follow others (by
    their own).  Sensors: position and velocity of each coordinate, force of each actuator, and an
    accelerometer or gyroscope at each frame whose name says so.  Each posture becomes a key frame.

    Args:
        root: The <mujoco> element.
        pepper: The robot.
        tree: Its tree.
        joint_order: All joints in the order of MuJoCo's qpos.
        sites: Frames that became sites.
    """
    _add_couplings(child(root, "equality"), pepper)
    actuators, sensors = child(root, "actuator"), child(root, "sensor")
    for index, joint in enumerate(pepper.joint_names):
        _add_actuator(actuators, pepper, tree, index)
        child(sensors, "jointpos", name=f"{joint}_position", joint=joint)
        child(sensors, "jointvel", name=f"{joint}_velocity", joint=joint)
        child(sensors, "actuatorfrc", name=f"{joint}_effort", actuator=joint)
    for site in sites:
        name = site.removesuffix("_frame")
        if name.endswith("Accelerometer"):
            child(sensors, "accelerometer", name=name, site=site)
        elif name.endswith("Gyrometer"):
            child(sensors, "gyro", name=name, site=site)
    keys = child(root, "keyframe")
    full_names = list(pepper.inner_model.names)[1:]
    order = [full_names.index(joint) for joint in joint_order]
    for posture in pepper.posture_names:
        q = pepper.posture(posture)
        target = np.where(np.isin(pepper.joint_names, BASE_JOINTS), 0.0, q)
        child(keys, "key", name=posture, qpos=numbers(pepper.to_full(q)[order]), ctrl=numbers(target))


def _add_couplings(equality: ET.Element, pepper: PepperModel) -> None:
    for joint in list(pepper.inner_model.names)[1:]:
        if joint in pepper.joint_names:
            continue
        leader, gain, shift = coupling_of(pepper, joint)
        child(
            equality, "joint", name=f"{joint}_follows", joint1=joint, joint2=leader,
            polycoef=numbers((shift, gain, 0, 0, 0)), solref="0.005 1", solimp="0.999 0.9999 0.001",
        )  # fmt: skip


def _add_actuator(actuators: ET.Element, pepper: PepperModel, tree: KinematicTree, index: int) -> None:
    joint, effort = pepper.joint_names[index], float(pepper.effort_limits[index])
    force = {"forcerange": interval(-effort, effort)} if math.isfinite(effort) else {}
    effort = effort if math.isfinite(effort) else 1.0
    if joint in BASE_JOINTS:
        speed = float(pepper.velocity_limits[index])
        bounds = {"ctrlrange": interval(-speed, speed)} if math.isfinite(speed) else {}
        child(
            actuators, "velocity", name=joint, joint=joint, kv=number(BASE_DAMPING), **bounds, **force,
        )  # fmt: skip
        return
    lower, upper = float(pepper.lower_limits[index]), float(pepper.upper_limits[index])
    bounds = {"ctrlrange": interval(lower, upper)} if math.isfinite(upper - lower) else {}
    stiffness = STIFFNESS_PER_EFFORT * effort
    damping = 0.0 if is_light(pepper, tree, joint) else DAMPING_TIME * stiffness
    child(
        actuators, "position", name=joint, joint=joint, kp=number(stiffness),
        kv=number(damping), **bounds, **force,
    )  # fmt: skip


def interval(lower: float, upper: float) -> str:
    """Return limits as MuJoCo reads them; equal ones 1e-9 apart, since it takes `0 0` for no limits."""
    apart = max(0.0, NARROWEST - (upper - lower)) / 2
    return numbers((lower - apart, upper + apart))


def is_light(pepper: PepperModel, tree: KinematicTree, joint: str) -> bool:
    """Whether a joint leads others and its own link has no mass."""
    leads = any(
        leader_of(pepper, name) == joint
        for name in list(pepper.inner_model.names)[1:]
        if name not in pepper.joint_names
    )
    link = next(item.child for item in pepper.document.joints if item.name == joint)
    return leads and link not in tree.bodies
