"""Models with other limits or masses: a changed description, from which a new model is built."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import (
    InvalidValueError,
    ModelError,
    ModelWarning,
    UnknownNameError,
    suspect_degrees,
)
from pepper_kin.model.follower_limits import followers_of
from pepper_kin.model.joint_vectors import as_finite, check_positive, shown
from pepper_kin.model.semantics import changed_states
from pepper_kin.model.urdf_document import parse_urdf
from pepper_kin.model.xml_source import MOST
from pepper_kin.model.xml_text import own_child

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

RAISED = 3.0
"""Ratio of a new velocity limit to the old one above which a limit of more than a turn a second gives a
warning: it may be in degrees."""

JointValues: TypeAlias = "ArrayLike | Mapping[str, float]"


def with_limits(pepper: PepperModel, changes: Mapping[str, JointValues | None]) -> PepperModel:
    """Return the model of `PepperModel.with_limits`, which describes arguments and errors.

    Args:
        pepper: The robot.
        changes: "lower", "upper", "velocity", "acceleration" and "effort" -> new values; None keeps the
            limits.
    """
    limits = {
        "lower": pepper.lower_limits,
        "upper": pepper.upper_limits,
        "velocity": pepper.velocity_limits,
        "acceleration": pepper.acceleration_limits,
        "effort": pepper.effort_limits,
    }
    new = {
        quantity: limits[quantity]
        if value is None
        else _of_joints(pepper, f"{quantity} limits", value, limits[quantity])
        for quantity, value in changes.items()
    }
    _check(pepper, new)
    root = pepper.document.copied_tree()
    for element in root.findall("joint"):
        name = element.get("name", "")
        if name not in pepper.joint_names:
            continue
        limit = own_child(element, "limit")
        values = {quantity: float(array[pepper.joint_index(name)]) for quantity, array in new.items()}
        if element.get("type") != "prismatic":
            element.set("type", "continuous" if np.isinf(values["lower"]) else "revolute")
        for quantity, value in values.items():
            if np.isfinite(value):
                limit.set(quantity, repr(value))
            else:
                limit.attrib.pop(quantity, None)
    return _with_all(_rebuilt(pepper, root), new)


def _with_all(pepper: PepperModel, new: Mapping[str, Array]) -> PepperModel:
    """Return a robot that has all new limits, shape (n,) each.

    Raises:
        InvalidValueError: for a limit that a following joint does not allow.
    """
    for quantity, values in new.items():
        found = getattr(pepper, f"{quantity}_limits")
        for j in np.flatnonzero(found != values):
            name = pepper.joint_names[j]
            raise InvalidValueError(
                f"{quantity} limit of {name}", float(values[j]),
                f"{found[j]:.6g} or narrower: {followers_of(pepper, name)} bind it",
            )  # fmt: skip
    return pepper


def with_masses(pepper: PepperModel, masses: Mapping[str, float]) -> PepperModel:
    """Return the model of `PepperModel.with_masses`, which describes arguments and errors."""
    root = pepper.document.copied_tree()
    found: dict[str, ET.Element] = {}
    for link in root.findall("link"):
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is not None and mass is not None and float(mass.get("value", "0")) > 0:
            found[link.get("name", "")] = inertial
    if not isinstance(masses, Mapping):
        raise InvalidValueError("masses", repr(masses), "link -> mass [kg]")
    for name, value in masses.items():
        if name not in found:
            raise UnknownNameError("link with a mass", name, found)
        new = check_positive(f"mass of {name}", value, "kg")
        if new > MOST:
            raise InvalidValueError(f"mass of {name}", new, f"at most {MOST:g} kg, as in descriptions")
        mass, inertia = found[name].find("mass"), found[name].find("inertia")
        assert mass is not None
        factor = new / float(mass.get("value", "0"))
        mass.set("value", repr(new))
        if inertia is not None:
            for key, moment in list(inertia.attrib.items()):
                inertia.set(key, repr(factor * float(moment)))
    return _rebuilt(pepper, root)


def _rebuilt(pepper: PepperModel, root: ET.Element) -> PepperModel:
    """Return a robot built from a changed tree of its description; warn of states that changed with it."""
    if pepper.dynamics_model.changed() is not None:
        raise ModelError(
            f"robot {pepper.name!r}: it was given another pinocchio_model, which the new one would not have; "
            "change limits and masses first, then call with_pinocchio_model"
        )
    old = pepper.document
    document = parse_urdf(ET.tostring(root, encoding="unicode"), old.package_dirs)
    before = set(changed_states(pepper.semantics.states, old))
    for sentence in changed_states(pepper.semantics.states, document):
        if sentence not in before:
            warnings.warn(f"SRDF: {sentence}", ModelWarning, stacklevel=5)
    made = replace(document, wheels=old.wheels)
    return pepper.with_parts(document=made)


def with_pinocchio_model(pepper: PepperModel, model: Any) -> PepperModel:
    """Return the model of `PepperModel.with_pinocchio_model`, which describes arguments and errors."""
    own = pepper.inner_model
    if not isinstance(model, type(own)):
        raise InvalidValueError("model", shown(model), "a pinocchio.Model, such as a changed pinocchio_model")
    if list(model.names) != list(own.names) or model.nq != own.nq:
        expected = f"the joints of robot {pepper.name!r}: {', '.join(list(own.names)[1:])}"
        raise InvalidValueError("model", f"joints {', '.join(list(model.names)[1:])}", expected)
    # Pinocchio's comparison leaves out the inertia that is fixed to the world.
    same = model == own and model.inertias[0] == own.inertias[0]
    return pepper if same else pepper.with_parts(changed=model.copy())


def _of_joints(pepper: PepperModel, quantity: str, value: JointValues, present: Array) -> Array:
    """Return values of all joints, shape (n,), from one number, n numbers, or a mapping by joint and group.

    Args:
        pepper: The robot.
        quantity: Name of the values in messages.
        value: One number, numbers of shape (n,), or a mapping from joints and groups to numbers.
        present: Values kept by joints that a mapping does not name, shape (n,).

    Raises:
        UnknownNameError: for a name that is neither a joint nor a group.
        InvalidValueError: for a wrong shape, NaN, or anything but numbers.
    """
    if not isinstance(value, Mapping):
        array = np.asarray(value, dtype=object)
        numbers = [_number(quantity, each) for each in array.reshape(-1)]
        if array.shape not in ((), (pepper.n,)):
            raise InvalidValueError(quantity, f"shape {array.shape}", f"one number, or shape ({pepper.n},)")
        return np.broadcast_to(np.array(numbers), (pepper.n,)).copy()
    result = np.array(present)
    for name, number in value.items():
        places = [pepper.joint_index(joint) for joint in pepper.resolve_joints(name)]
        result[places] = _number(f"{quantity} of {name}", number)
    return result


def _number(quantity: str, value: object) -> float:
    """Return a finite number or an infinity as a float."""
    if isinstance(value, (float, np.floating)) and np.isinf(value):
        return float(value)
    return float(as_finite(value, quantity, ()))  # type: ignore[arg-type]


def _check(pepper: PepperModel, new: Mapping[str, Array]) -> None:
    """Check new limits.

    Args:
        pepper: The robot before the change.
        new: New limits, each of shape (n,): "lower" and "upper" [rad or m], "velocity" [rad/s or m/s],
            "acceleration" [rad/s^2 or m/s^2] and "effort" [N m or N].

    Raises:
        InvalidValueError: for a lower limit above the upper one, an infinite limit of a joint that is
            prismatic or bounded on the other side, a position limit beyond a turn and outside the old range,
            or another limit that is not above zero, unless the robot had it before.
    """
    for j, name in enumerate(pepper.joint_names):
        lower, upper = float(new["lower"][j]), float(new["upper"][j])
        endless = lower == -np.inf and upper == np.inf and pepper.joint_units[j] == "rad"
        if not endless and not (np.isfinite([lower, upper]).all() and lower <= upper):
            raise InvalidValueError(
                f"limits of {name}", f"{lower:.6g} to {upper:.6g} {pepper.joint_units[j]}",
                "a lower limit not above the upper one; for no limits -inf and inf, of joints that turn only",
            )  # fmt: skip
        for quantity, value in (("lower", lower), ("upper", upper)):
            question, old = (
                suspect_degrees(value, pepper.joint_units[j]),
                (pepper.lower_limits[j], pepper.upper_limits[j]),
            )
            if question and not old[0] <= value <= old[1]:
                raise InvalidValueError(
                    f"{quantity} limit of {name}", f"{value:.6g} rad", f"radians{question}"
                )
        speed, before = float(new["velocity"][j]), float(pepper.velocity_limits[j])
        if (question := suspect_degrees(speed, pepper.joint_units[j])) and speed > RAISED * before:
            warnings.warn(
                f"velocity limit of {name}: {speed:.6g} rad/s in place of {before:.6g} rad/s{question}",
                ModelWarning, stacklevel=5,
            )  # fmt: skip
        for quantity in ("velocity", "acceleration", "effort"):
            value = float(new[quantity][j])
            # Limits of the description, which may be zero, are not refused.
            if not value > 0 and value != float(getattr(pepper, f"{quantity}_limits")[j]):
                raise InvalidValueError(
                    f"{quantity} limit of {name}", value, "a number above 0, inf for none"
                )
