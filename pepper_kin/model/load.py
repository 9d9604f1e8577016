"""Loading of Pepper, from its URDF texts or xacro sources."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from pepper_kin.file_access.atomic_file import as_path
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.expanded_urdf import BASES, DEFAULTS, HANDS, expand, expanded, urdf_folder
from pepper_kin.model.head_pitch import DOCUMENTED, HEAD_LIMITS
from pepper_kin.model.joint_vectors import check_choice, check_positive
from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.semantics import parse_srdf
from pepper_kin.model.urdf_document import UrdfDocument, parse_urdf

if TYPE_CHECKING:
    from pepper_kin.model.shapes import Shape

sphere_set = lazy_module("pepper_kin.model.sphere_set")
vendor_meshes = lazy_module("pepper_kin.model.vendor_meshes")


def load_pepper(
    base: str = "fixed",
    hands: str = "locked",
    *,
    head_limits: str = "urdf",
    meshes: str | Path | None = None,
    mesh_scale: float = 0.1,
) -> PepperModel:
    """Load Pepper.

    Args:
        base: "fixed", or "planar" for three more joints `BaseX`, `BaseY` [m] and `BaseYaw` [rad].
        hands: "locked" (fingers fixed, open), "mimic" (`LHand`, `RHand` drive their fingers) or
            "independent" (28 finger joints).
        head_limits: "urdf": HeadPitch up to 36.5 degrees; "documented": up to 25.5, as on the vendor's page,
            beyond which no robot was seen. How the pitch depends on the yaw is the same for both.
        meshes: Folder with the vendor's meshes, named after the links, to show instead of this library's
            shapes.
        mesh_scale: Factor from the unit of the vendor's meshes to meters.

    Returns:
        The model; 15 joints with the defaults. Loaded once per choice, then shared: it is frozen.

    Raises:
        InvalidValueError: for another base, hands or head_limits.
        FileFormatError: for a folder without meshes.
    """
    check_choice("base", base, BASES)
    check_choice("hands", hands, HANDS)
    check_choice("head_limits", head_limits, HEAD_LIMITS)
    folder = None if meshes is None else str(as_path(meshes, "meshes").resolve())
    scale = check_positive("mesh_scale", mesh_scale)
    return _load_pepper(base, hands, head_limits, folder, scale)


@lru_cache(maxsize=16)  # at most 16 robots
def _load_pepper(
    base: str, hands: str, head_limits: str, meshes: str | None, mesh_scale: float
) -> PepperModel:
    """Return Pepper for checked arguments, cached for each choice."""
    if head_limits == "documented":
        return _load_pepper(base, hands, "urdf", meshes, mesh_scale).with_limits(
            upper={"HeadPitch": DOCUMENTED}
        )
    document = parse_urdf(pepper_urdf(base=base, hands=hands))
    if meshes is not None:
        document = vendor_meshes.with_vendor_meshes(document, meshes, mesh_scale)
    srdf = (urdf_folder() / "pepper.srdf").read_text(encoding="utf-8")
    return PepperModel(document, parse_srdf(srdf, document), _pepper_spheres)


def _pepper_spheres(document: UrdfDocument) -> tuple[Shape, ...]:
    """Return Pepper's sphere set, imported at its first use."""
    return sphere_set.pepper_spheres(document)


def pepper_urdf(**arguments: str) -> str:
    """Return Pepper's URDF text: from the package, or expanded from the xacro sources for other arguments.

    Args:
        **arguments: xacro arguments: name, prefix, base, hands, mesh_dir.

    Returns:
        Text of the URDF.
    """
    choice = DEFAULTS | arguments
    known = len(choice) == 2 and choice["base"] in BASES and choice["hands"] in HANDS
    return (expanded(**choice) if known else None) or expand(**arguments)
