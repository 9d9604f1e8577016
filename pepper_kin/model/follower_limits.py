"""Limits of coordinates with following joints, whose limits count too."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model.urdf_document import Joint

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

Array = NDArray[np.float64]

ROUNDED = 1e-6
"""Relative difference of a leader's and its follower's limits that rounding of a text explains."""


def coupled_limits(joints: list[Joint], full_map: Array, offset: Array) -> dict[str, Array]:
    """Return the limits of all coordinates, narrowed by the limits of following joints, shape (n,) each.

    A joint of q_full = E q + e stays within [l, u] if its coordinate is between (l - e) / E and (u - e) / E,
    in ascending order; its velocity and acceleration stay within v and a if the coordinate's velocity and
    acceleration are at most v / |E| and a / |E|. Differences by rounding alone change no limit. A follower
    with a multiplier of zero does not move, and narrows no limit.

    Args:
        joints: All moving joints, in the order of q_full.
        full_map: E, shape (n_full, n), with one entry other than zero per row at most.
        offset: e, shape (n_full,) [rad or m].

    Returns:
        "lower" and "upper" [rad or m], "velocity" and "acceleration" [rad/s or m/s, and per second], and
        "effort" [N m or N], the effort limits of the leading joints: an effort limit bounds an actuator, and
        a follower has none, since the coupling moves it. Pinocchio's mimic joints have one effort limit per
        coordinate as well, and MuJoCo's `actuatorfrcrange` bounds actuators only.

    Raises:
        ModelError: if the limits of a joint and of its followers exclude each other, or a follower with a
            multiplier of zero is outside its limits.
    """
    names = ("lower", "upper", "velocity", "acceleration", "effort")
    leading = [row for row, joint in enumerate(joints) if joint.mimic is None]
    found = {name: np.array([getattr(joints[row], name) for row in leading]) for name in names}
    for row, joint in enumerate(joints):
        if joint.mimic is None:
            continue
        column = int(np.argmax(np.abs(full_map[row])))
        gain, shift = full_map[row, column], offset[row]
        if gain == 0.0:
            _refuse_outside(joint, shift)
            continue
        low, high = sorted(((joint.lower - shift) / gain, (joint.upper - shift) / gain))
        rate, change = joint.velocity / abs(gain), joint.acceleration / abs(gain)
        size = max(abs(x) for x in (low, high, 0.0) if np.isfinite(x))
        for name, value, sign in (
            ("lower", low, 1.0),
            ("upper", high, -1.0),
            ("velocity", rate, -1.0),
            ("acceleration", change, -1.0),
        ):
            rounding = ROUNDED * (size if name in ("lower", "upper") else value)
            if np.isfinite(value) and sign * (value - found[name][column]) > rounding:
                found[name][column] = value
        if found["lower"][column] > found["upper"][column]:
            leader = joints[leading[column]]
            raise ModelError(
                f"URDF: joint {joint.name} ({joint.lower:g} to {joint.upper:g}) follows {leader.name} "
                f"({leader.lower:g} to {leader.upper:g}) with the factor {gain:g} and the offset {shift:g}: "
                "no position is within the limits of both"
            )
    return found


def _refuse_outside(joint: Joint, position: float) -> None:
    """Refuse a joint that does not move and whose position is outside its limits."""
    if not joint.lower - ROUNDED <= position <= joint.upper + ROUNDED:
        raise ModelError(
            f"URDF: joint {joint.name} follows with the factor 0 and stands at {position:g}, "
            f"its limits are {joint.lower:g} to {joint.upper:g}"
        )


def warn_of_followers(pepper: PepperModel) -> None:
    """Warn of coordinates whose limits are narrowed by following joints.

    Warns:
        ModelWarning: naming the coordinate, its followers, and each limit before and after; and a coordinate
            without an effort limit whose followers have one, which is not used.
    """
    joints = {joint.name: joint for joint in pepper.document.joints}
    for column, name in enumerate(pepper.joint_names):
        changed = [
            f"{limit} limit {own:.6g} -> {now:.6g}"
            for limit in ("lower", "upper", "velocity", "acceleration")
            if (own := getattr(joints[name], limit)) != (now := getattr(pepper, f"{limit}_limits")[column])
        ]
        if changed:
            message = f"joint {name}: {followers_of(pepper, name)} bind it: {', '.join(changed)}"
            warnings.warn(f"URDF: {message}", ModelWarning, stacklevel=5)
        idle = [one for one in _followers(pepper, name) if np.isfinite(joints[one].effort)]
        if idle and not np.isfinite(pepper.effort_limits[column]):
            message = (
                f"joint {name} has no effort limit; those of {', '.join(idle)}, which follow it, bind nothing"
            )
            warnings.warn(f"URDF: {message}", ModelWarning, stacklevel=5)


def followers_of(pepper: PepperModel, name: str) -> str:
    """Return the joints that follow a coordinate as text, such as "the limits of A, B, which follow it,"."""
    return f"the limits of {', '.join(_followers(pepper, name))}, which follow it,"


def _followers(pepper: PepperModel, name: str) -> list[str]:
    """Return the joints that follow a coordinate, directly or through others."""
    joints = {joint.name: joint for joint in pepper.document.joints}
    found = []
    for joint in pepper.document.joints:
        leader = joint
        while leader.mimic is not None:
            leader = joints[leader.mimic[0]]
        if leader.name == name and joint is not leader:
            found.append(joint.name)
    return found
