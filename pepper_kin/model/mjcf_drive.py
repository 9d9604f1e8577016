"""Actuators, couplings, sensors and keyframes of the robot in MuJoCo."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.export_inertia import TINY_INERTIA
from pepper_kin.model.kinematic_tree import KinematicTree
from pepper_kin.model.servos import ServoGains, servo_gains
from pepper_kin.model.tree_order import coupling_of
from pepper_kin.model.xml_text import child, number, numbers

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

pinocchio = lazy_module("pinocchio")

TIMESTEP = 0.001
"""Timestep of the MJCF file, equal to the twin's [s]."""
NARROWEST = 1e-9
"""Minimum distance of a lower and an upper limit [rad, m, N m or N]."""


def add_drive(
    root: ET.Element,
    pepper: PepperModel,
    gains: ServoGains,
    light: Collection[str],
    joint_order: list[str],
    sites: list[str],
) -> None:
    """Add couplings, actuators, sensors and keyframes to an MJCF root.

    Every coordinate has the twin's servo, tau = clip(Kp (q_ref - q) + Kd (v_ref - v) + g(q), limits), as two
    actuators: first all positions, `JOINT_position`, then all velocities, `JOINT_velocity`.  MuJoCo's gravity
    compensation is g(q), and the range of a joint's actuator force limits the sum.  Sensors: position,
    velocity and force of each coordinate's servo, and an accelerometer or gyroscope at each frame whose name
    says so.  Each posture becomes a keyframe.

    Args:
        root: The <mujoco> element.
        pepper: The robot.
        gains: Gains of the robot's servos.
        light: Leading joints whose own link has no mass: their followers have the servo's damping.
        joint_order: All joints in the order of MuJoCo's qpos.
        sites: Frames that are sites in the MJCF.
    """
    _add_couplings(child(root, "equality"), pepper)
    actuators, sensors = child(root, "actuator"), child(root, "sensor")
    for index, joint in enumerate(pepper.joint_names):
        kp, lower, upper = gains.stiffness[index], pepper.lower_limits[index], pepper.upper_limits[index]
        bounds = {"ctrlrange": interval(lower, upper)} if math.isfinite(upper - lower) else {}
        child(actuators, "position", name=f"{joint}_position", joint=joint, kp=number(float(kp)), **bounds)
        child(sensors, "jointpos", name=f"{joint}_position", joint=joint)
        child(sensors, "jointvel", name=f"{joint}_velocity", joint=joint)
        child(sensors, "jointactuatorfrc", name=f"{joint}_effort", joint=joint)
    for joint, kv in zip(pepper.joint_names, gains.damping, strict=True):
        kind, gain = ("motor", "gear") if joint in light else ("velocity", "kv")
        child(actuators, kind, name=f"{joint}_velocity", joint=joint, **{gain: number(float(kv))})
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
        target = numbers((*q, *np.zeros(pepper.n)))
        child(keys, "key", name=posture, qpos=numbers(pepper.to_full(q)[order]), ctrl=target)


def mjcf_gains(pepper: PepperModel, light: Collection[str]) -> ServoGains:
    """Return the gains of the twin's servos, reduced to values that MuJoCo can integrate.

    MuJoCo evaluates a servo's stiffness at the start of a step, the twin at its end, so a joint's natural
    frequency w = sqrt(Kp / I) is bounded: Kp <= I w^2 and Kd <= 2 D I w with w = 1 / h and the damping ratio
    D = 1. For leading joints without a mass of their own, w = 0.3 / h and D = 0.3: with more damping,
    followers lag.
    """
    model = pepper.inner_model
    full = pinocchio.crba(model, pepper.pinocchio_data, pepper.to_full(pepper.neutral()))
    full = np.triu(full) + np.triu(full, 1).T
    inertia = np.diag(pepper.full_map.T @ full @ pepper.full_map)
    reduction = np.where([joint in light for joint in pepper.joint_names], 0.3, 1.0)
    frequency = reduction / TIMESTEP
    gains, known = servo_gains(pepper, inertia), np.maximum(inertia, TINY_INERTIA)
    return gains._replace(
        stiffness=np.minimum(gains.stiffness, known * frequency**2),
        damping=np.minimum(gains.damping, 2.0 * reduction * known * frequency),
    )


def _add_couplings(equality: ET.Element, pepper: PepperModel) -> None:
    """Add an equality constraint for each joint that follows another."""
    for joint in list(pepper.inner_model.names)[1:]:
        if joint in pepper.joint_names:
            continue
        leader, gain, shift = coupling_of(pepper, joint)
        child(
            equality, "joint", name=f"{joint}_follows", joint1=joint, joint2=leader,
            polycoef=numbers((shift, gain, 0, 0, 0)), solref="0.005 1", solimp="0.999 0.9999 0.001",
        )  # fmt: skip


def interval(lower: float, upper: float) -> str:
    """Return limits as text, equal limits 1e-9 apart: MuJoCo reads `0 0` as no limits."""
    apart = max(0.0, NARROWEST - (upper - lower)) / 2
    return numbers((lower - apart, upper + apart))


def light_leaders(pepper: PepperModel, tree: KinematicTree) -> dict[str, float]:
    """Return leading joints whose own link has no mass, such as Pepper's hands.

    A damper on a body without mass would hold it against the constraints, so the followers take the servo's
    damping: Kd / sum(gain^2) each, together Kd at the leader.

    Returns:
        Joint -> sum(gain^2) of its followers.
    """
    links = {joint.name: joint.child for joint in pepper.document.joints}
    squares: dict[str, float] = {}
    for joint in list(pepper.inner_model.names)[1:]:
        leader, gain, _ = coupling_of(pepper, joint)
        if joint != leader and gain != 0.0 and links[leader] not in tree.bodies:
            squares[leader] = squares.get(leader, 0.0) + gain**2
    return squares
