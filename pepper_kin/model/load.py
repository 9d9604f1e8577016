"""Loading of a `PepperModel` from xacro or URDF."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from pepper_kin.atomic_file import as_path
from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.frozen_arrays import read_only
from pepper_kin.model.dynamics_model import DynamicsModel
from pepper_kin.model.expanded_urdf import BASES, DEFAULTS, HANDS, expand, expanded, urdf_folder
from pepper_kin.model.joint_vectors import check_choice, check_positive
from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.semantics import Semantics, parse_srdf
from pepper_kin.model.tree_order import depth_first, frame_ids
from pepper_kin.model.urdf_document import MOST, Joint, UrdfDocument, number_of, parse_urdf, positive_of
from pepper_kin.model.urdf_source import is_text, mesh_folders, read_source, warned

if TYPE_CHECKING:
    from pepper_kin.model.missing_limits import LimitsLike
    from pepper_kin.model.shapes import Shape
    from pepper_kin.model.wheels import Wheels

SphereSet: TypeAlias = "Callable[[UrdfDocument], tuple[Shape, ...]]"


def load_pepper(
    base: str = "fixed",
    hands: str = "locked",
    *,
    meshes: str | Path | None = None,
    mesh_scale: float = 0.1,
) -> PepperModel:
    """Load Pepper.

    Args:
        base: "fixed", or "planar" for three more joints `BaseX`, `BaseY` [m] and `BaseYaw` [rad].
        hands: "locked" (fingers fixed, open), "mimic" (`LHand`, `RHand` drive their fingers) or
            "independent" (28 finger joints).
        meshes: Folder with the vendor's meshes, named after the links, to show in place of our own shapes.
        mesh_scale: Factor from the unit of these meshes to meters.

    Returns:
        The model; 15 joints with the defaults. Loaded once per choice, then shared: it is frozen.

    Raises:
        InvalidValueError: for another base or hands.
        FileFormatError: for a folder without meshes.
    """
    check_choice("base", base, BASES)
    check_choice("hands", hands, HANDS)
    folder = None if meshes is None else str(as_path(meshes, "meshes").resolve())
    return _load_pepper(base, hands, folder, check_positive("mesh_scale", mesh_scale))


@lru_cache(maxsize=16)  # the robots of 16 choices
def _load_pepper(base: str, hands: str, meshes: str | None, mesh_scale: float) -> PepperModel:
    urdf = pepper_urdf(base=base, hands=hands)
    if meshes is not None:
        from pepper_kin.model.vendor_meshes import with_vendor_meshes

        urdf = with_vendor_meshes(urdf, meshes, mesh_scale)
    document = parse_urdf(urdf)
    srdf = (urdf_folder() / "pepper.srdf").read_text(encoding="utf-8")
    return model_of(document, parse_srdf(srdf, document), _pepper_spheres)


def _pepper_spheres(document: UrdfDocument) -> tuple[Shape, ...]:
    from pepper_kin.model.sphere_set import pepper_spheres

    return pepper_spheres(document)


def pepper_urdf(**arguments: str) -> str:
    """Return Pepper's URDF text: as it comes with the package, or expanded again from the xacro sources.

    Args:
        **arguments: xacro arguments: name, prefix, base, hands, mesh_dir.

    Returns:
        The URDF.
    """
    choice = DEFAULTS | arguments
    known = len(choice) == 2 and choice["base"] in BASES and choice["hands"] in HANDS
    return (expanded(**choice) if known else None) or expand(**arguments)


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
            collision, if there is one. Without such pairs, links one joint apart are not checked.
        package_dirs: Folders that hold packages, for `package://` mesh names. Those above a URDF file are
            sought too, and file names without a folder beside it.
        base: "fixed"; "planar" for three more joints `BaseX`, `BaseY` [m] and `BaseYaw` [rad] between the
            world and the root link; or "differential" for the same of a base that goes where it points.
        wheels: What the base can do: limits of its joints for timing, and the turning radius of a
            differential one, for which it must be given.
        acceleration_limits: One number for all joints whose <limit> has no `acceleration` (URDF itself knows
            none), or limits by joint name [rad/s^2 or m/s^2]; they become part of the description.

    Returns:
        The same kind of object as `load_pepper` gives.

    Raises:
        FileFormatError: where a file cannot be read.
        ModelError: where the description is malformed; names the element.
        UnknownNameError: for acceleration limits of a joint that there is not.
        InvalidValueError: for one that is not above zero, another base, or wheels that do not go with it.

    Warns:
        ModelWarning: naming what the SRDF speaks of and the robot lacks; that is left out.
    """
    with warned(urdf):
        document = parse_urdf(read_source(urdf), mesh_folders(urdf, package_dirs))
        _ = document.shapes  # refuses what is malformed
    if base != "fixed" or wheels is not None:
        from pepper_kin.model.wheels import with_wheels

        document = with_wheels(document, base, wheels)
    if acceleration_limits is not None:
        from pepper_kin.model.missing_limits import with_acceleration_limits

        document = with_acceleration_limits(document, acceleration_limits)
    semantics = Semantics()
    if srdf is not None:
        with warned(srdf):
            semantics = parse_srdf(read_source(srdf), document)
        _warn_of_unknown_names(srdf, semantics)
    if not semantics.disabled_pairs:
        from pepper_kin.model.neighbors import neighboring_pairs

        semantics = replace(semantics, disabled_pairs=neighboring_pairs(document))
    with warned(urdf):
        return build_model(document, semantics)


def _warn_of_unknown_names(srdf: str | Path, semantics: Semantics) -> None:
    """Warn of names in an SRDF that the robot lacks: one text may serve variants, or a name may be wrong."""
    if semantics.unknown:
        file = "" if isinstance(srdf, str) and is_text(srdf) else f"{srdf}: "
        warnings.warn(f"{file}SRDF: {semantics.unknown_names()}", ModelWarning, stacklevel=3)


def build_model(document: UrdfDocument, semantics: Semantics) -> PepperModel:
    """Build the model of a document from elsewhere, and Pinocchio's at once, to see whether it can be built.

    Raises:
        ModelError: where Pinocchio refuses it, or no joint moves.
    """
    if all(joint.type == "fixed" for joint in document.joints):
        raise ModelError(f"URDF: robot {document.name!r} has no moving joint")
    _refuse_what_is_malformed(document)
    pepper = model_of(document, semantics)
    pepper.dynamics_model.get()
    return pepper


def model_of(
    document: UrdfDocument, semantics: Semantics, sphere_set: SphereSet | None = None, changed: object = None
) -> PepperModel:
    """Build the model of a document that is known to be sound; Pinocchio's is built when it is needed.

    Args:
        document: The robot.
        semantics: Groups, states and pairs never checked for collision.
        sphere_set: Makes the spheres that contain the body, if there are any.
        changed: A `pinocchio.Model` to use in place of that of the document, if there is one.

    Raises:
        ModelError: for a joint that mimics itself.
    """
    joints = {joint.name: joint for joint in document.joints if joint.type != "fixed"}
    order = depth_first(document)
    full_names = tuple(joint.name for joint in order if joint.type != "fixed")
    names = tuple(name for name in full_names if joints[name].mimic is None)
    full_map, full_offset = _mimic_map(full_names, names, joints)

    def column(attribute: str) -> np.ndarray:
        return read_only([getattr(joints[name], attribute) for name in names])

    return PepperModel(
        name=document.name,
        urdf=document.text,
        document=document,
        joint_names=names,
        joint_units=tuple("m" if joints[name].type == "prismatic" else "rad" for name in names),
        lower_limits=column("lower"),
        upper_limits=column("upper"),
        velocity_limits=column("velocity"),
        acceleration_limits=column("acceleration"),
        effort_limits=column("effort"),
        semantics=semantics,
        sphere_set=sphere_set,
        full_map=read_only(full_map),
        full_offset=read_only(full_offset),
        dynamics_model=DynamicsModel(document, full_names, changed),
        _frame_ids=frame_ids(document, order),
    )


ROUNDED_MOMENT = 1e-12
"""How far below zero rounding may leave a moment of inertia [kg m^2]; it is warned of."""


def _refuse_what_is_malformed(document: UrdfDocument) -> None:
    """Refuse what Pinocchio's reader would refuse unnamed, or leave out: a link then has no mass.

    Raises:
        ModelError: naming the joint or link.
    """
    from pepper_kin.model.kinematic_tree import kinematic_tree

    kinematic_tree(document)
    for link in ET.fromstring(document.text).findall("link"):
        for inertial in link.findall("inertial"):
            mass, inertia = inertial.find("mass"), inertial.find("inertia")
            keys = [] if inertia is None else ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]
            missing = ["mass"] if mass is None or mass.get("value") is None else []
            missing += ["inertia"] if inertia is None else [key for key in keys if inertia.get(key) is None]
            if missing:
                raise ModelError(f"URDF: inertial of link {link.get('name')} has no {', '.join(missing)}")
            if mass is not None and inertia is not None:
                _check_inertial(f"link {link.get('name')}", mass, inertia)


def _check_inertial(link: str, mass: ET.Element, inertia: ET.Element) -> None:
    """Refuse numbers that no computation could use, and warn of an inertia that no real body has.

    Raises:
        ModelError: naming the link and the value.

    Warns:
        ModelWarning: in the words of `pepper_kin.model.audit`.
    """
    from pepper_kin.model.audit_links import impossible_inertia

    positive_of(mass, "value", 0.0, f"mass of {link}")
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    values = [number_of(inertia, key, 0.0, f"inertia of {link}") for key in keys]
    for key, value in zip(keys, values, strict=True):
        if key[1] == key[2] and value < -ROUNDED_MOMENT:
            raise ModelError(f"URDF: inertia of {link}: {key} is {value:g} kg m^2, expected at least 0")
    ixx, iyy, izz, ixy, ixz, iyz = values
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    message = impossible_inertia(np.linalg.eigvalsh(tensor))
    if message and tensor.any():  # without any inertia it is a mass at a point
        warnings.warn(f"URDF: {link}: {message}", ModelWarning, stacklevel=6)


def _mimic_map(
    full_names: tuple[str, ...], names: tuple[str, ...], joints: dict[str, Joint]
) -> tuple[np.ndarray, np.ndarray]:
    """Return E and e of q_full = E q + e; chains of mimic joints are followed to their leader."""
    full_map, offset = np.zeros((len(full_names), len(names))), np.zeros(len(full_names))
    known = {name: (column, 1.0, 0.0) for column, name in enumerate(names)}
    for row, name in enumerate(full_names):
        chain = []
        while name not in known:
            chain.append(name)
            name = joints[name].mimic[0]  # type: ignore[index]
            if len(chain) > len(full_names):
                raise ModelError(f"URDF: joint {name} mimics itself")
        for follower in reversed(chain):
            leader, multiplier, addend = joints[follower].mimic  # type: ignore[misc]
            column, gain, shift = known[leader]
            known[follower] = column, multiplier * gain, multiplier * shift + addend
            if not max(map(abs, known[follower][1:])) <= MOST:
                reason = f"its factors multiply to more than {MOST:g}"
                raise ModelError(f"URDF: joint {follower} mimics {leader}: {reason}")
        column, gain, shift = known[full_names[row]]
        full_map[row, column], offset[row] = gain, shift
    return full_map, offset
