"""Loading of any robot from URDF."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model.follower_limits import warn_of_followers
from pepper_kin.model.kinematic_tree import MOMENTS, impossible_inertia, kinematic_tree, tensor_of
from pepper_kin.model.missing_limits import LimitsLike, with_acceleration_limits
from pepper_kin.model.neighbors import neighboring_pairs
from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.semantics import Semantics, parse_srdf
from pepper_kin.model.urdf_document import UrdfDocument, parse_urdf
from pepper_kin.model.urdf_source import is_text, mesh_folders, read_source, warned
from pepper_kin.model.wheels import Wheels, with_wheels
from pepper_kin.model.xml_source import number_of, positive_of

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

ROUNDED_MOMENT = 1e-12
"""Magnitude of a negative moment of inertia that rounding explains [kg m^2]; it gives a warning, not an
error."""


def load_robot(
    urdf: str | Path,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    *,
    base: str = "fixed",
    wheels: Wheels | None = None,
    acceleration_limits: LimitsLike | None = None,
) -> PepperModel:
    """Load any robot of revolute, continuous and prismatic joints.

    Args:
        urdf: Path of a URDF file, or its text.
        srdf: Path or text of an SRDF with groups, postures and pairs of links that are not checked for
            collision, or None. Without such pairs, neighboring links are not checked.
        package_dirs: Folders that hold packages, for `package://` mesh names. The folder of a URDF file and
            all folders above it are searched too, also for plain file names.
        base: "fixed"; "planar" for three more joints `BaseX`, `BaseY` [m] and `BaseYaw` [rad] between the
            world and the root link; or "differential" for the same joints of a base that moves only where it
            points.
        wheels: Limits of the base's joints for timing, and the turning radius of a differential base, for
            which `wheels` is required.
        acceleration_limits: One number for all joints whose <limit> has no `acceleration` (URDF itself knows
            none), or limits by joint name [rad/s^2 or m/s^2]; they become part of the description.

    Returns:
        A model, as from `load_pepper`.

    Raises:
        FileFormatError: for a file that cannot be read.
        ModelError: naming the malformed element of the description.
        UnknownNameError: for acceleration limits of an unknown joint.
        InvalidValueError: for an acceleration limit that is not above zero, another base, or wheels that do
            not fit the base.

    Warns:
        ModelWarning: naming the parts of the SRDF that the robot lacks, which are left out; values of its
            states that the robot's postures do not have (beyond limits, several for one joint, of followers);
            and each limit of a joint that a following joint narrows.
    """
    with warned(urdf):
        document = parse_urdf(read_source(urdf), mesh_folders(urdf, package_dirs))
        _ = document.shapes  # raises for malformed shapes
    document = with_wheels(document, base, wheels)
    if acceleration_limits is not None:
        document = with_acceleration_limits(document, acceleration_limits)
    semantics = Semantics()
    if srdf is not None:
        with warned(srdf):
            semantics = parse_srdf(read_source(srdf), document)
        _warn_of_what_does_not_fit(srdf, semantics)
    if not semantics.disabled_pairs:
        semantics = replace(semantics, disabled_pairs=neighboring_pairs(document))
    with warned(urdf):
        return build_model(document, semantics)


def _warn_of_what_does_not_fit(srdf: str | Path, semantics: Semantics) -> None:
    """Warn of names in an SRDF that the robot lacks: the text may serve several robots, or be wrong."""
    file = "" if isinstance(srdf, str) and is_text(srdf) else f"{srdf}: "
    unknown = [semantics.unknown_names()] if semantics.unknown else []
    for sentence in (*unknown, *semantics.changed):
        warnings.warn(f"{file}SRDF: {sentence}", ModelWarning, stacklevel=4)


def build_model(document: UrdfDocument, semantics: Semantics) -> PepperModel:
    """Build the model of a document and, as a check, Pinocchio's model.

    Raises:
        ModelError: if Pinocchio refuses the document, or no joint moves.
    """
    if all(joint.type == "fixed" for joint in document.joints):
        raise ModelError(f"URDF: robot {document.name!r} has no moving joint")
    _refuse_what_is_malformed(document)
    pepper = PepperModel(document, semantics)
    pepper.dynamics_model.get()
    warn_of_followers(pepper)
    return pepper


def _refuse_what_is_malformed(document: UrdfDocument) -> None:
    """Refuse inertias that Pinocchio's reader would refuse without a name, or ignore, leaving no mass.

    Raises:
        ModelError: naming the joint or link.
    """
    kinematic_tree(document)
    for link in document.tree.findall("link"):
        for inertial in link.findall("inertial"):
            mass, inertia = inertial.find("mass"), inertial.find("inertia")
            missing = ["mass"] if mass is None or mass.get("value") is None else []
            missing += ["inertia"] if inertia is None else [k for k in MOMENTS if inertia.get(k) is None]
            if missing:
                raise ModelError(f"URDF: inertial of link {link.get('name')} has no {', '.join(missing)}")
            if mass is not None and inertia is not None:
                _check_inertial(f"link {link.get('name')}", mass, inertia)


def _check_inertial(link: str, mass: ET.Element, inertia: ET.Element) -> None:
    """Refuse a negative mass or moment, and warn of an inertia that no real body has.

    Raises:
        ModelError: naming the link and the value.

    Warns:
        ModelWarning: with the reason that `pepper_kin.model.audit` gives.
    """
    positive_of(mass, "value", 0.0, f"mass of {link}")
    values = [number_of(inertia, key, 0.0, f"inertia of {link}") for key in MOMENTS]
    for key, value in zip(MOMENTS, values, strict=True):
        if key[1] == key[2] and value < -ROUNDED_MOMENT:
            raise ModelError(f"URDF: inertia of {link}: {key} is {value:g} kg m^2, expected at least 0")
    tensor = tensor_of(values)
    message = impossible_inertia(np.linalg.eigvalsh(tensor))
    if message and tensor.any():  # zero is the inertia of a point mass
        warnings.warn(f"URDF: {link}: {message}", ModelWarning, stacklevel=7)
