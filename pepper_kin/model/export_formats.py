"""Export of the robot to the file formats of other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.model.dynamics_model import described
from pepper_kin.model.export_mjcf import mjcf_text
from pepper_kin.model.export_sdf import sdf_text
from pepper_kin.model.export_srdf import srdf_text
from pepper_kin.model.export_urdf import urdf_text
from pepper_kin.model.joint_vectors import check_choice

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

FORMATS = ("urdf", "srdf", "sdf", "mjcf")


class ExportOptions(TypedDict, total=False):
    """Keyword arguments of `export`."""

    mesh_paths: str | None
    zero_inertials: bool
    balance_inertias: bool


def export(
    pepper: PepperModel,
    format: str,
    *,
    mesh_paths: str | None = None,
    zero_inertials: bool = False,
    balance_inertias: bool = False,
) -> str:
    """Return the robot as the text of a file.

    All formats describe the same kinematics, masses, limits and friction of joints; the page on the
    description lists the limits of each format.  With `mesh_paths="relative"` the files that `mesh_files`
    lists must be copied beside the text.

    Args:
        pepper: The robot.
        format: "urdf", "srdf", "sdf" or "mjcf".
        mesh_paths: Names of mesh files: "package" (default of URDF; not in MJCF, which has no packages),
            "absolute" (default of SDF and MJCF) or "relative" (`meshes/NAME` beside the text).
        zero_inertials: Whether to write masses of zero into links without mass, for PyBullet; URDF only.
        balance_inertias: Whether to raise the principal moments of inertias that no body can have, which SDF
            and MJCF refuse, until they are possible, with a warning that names link and amount; SDF and MJCF
            only.

    Returns:
        Text of the file.

    Raises:
        InvalidValueError: for another format or mesh_paths, or for zero_inertials or balance_inertias with a
            format that does not have it.
        ModelError: naming contents that the format cannot hold: inertias that no body can have, reserved
            names; for a chain of joints that is too long for a format with nested bodies; and, except for
            SRDF, for a robot whose `pinocchio_model` was changed by hand.

    Warns:
        ModelWarning: naming each mesh that MuJoCo cannot read, whose shape is left out of an MJCF, and the
            amounts that `balance_inertias` added.
    """
    check_choice("format", format, FORMATS)
    try:
        return _text(pepper, format, mesh_paths, zero_inertials, balance_inertias)
    except RecursionError as error:
        reason = f"its chain of joints is too long for {format}, whose bodies hold one another"
        raise ModelError(f"robot {pepper.name!r}: {reason}") from error


def _text(
    pepper: PepperModel, format: str, mesh_paths: str | None, zero_inertials: bool, balance: bool
) -> str:
    """Return the text of a format, with the format's default of `mesh_paths`."""
    if zero_inertials and format != "urdf":
        raise InvalidValueError("zero_inertials", "True", "False: only URDF leaves the mass of a link out")
    if balance and format not in ("sdf", "mjcf"):
        raise InvalidValueError("balance_inertias", "True", "False: only SDF and MJCF refuse inertias")
    if format == "srdf":
        return srdf_text(pepper)
    described(pepper)
    if format == "urdf":
        return urdf_text(pepper, mesh_paths or "package", zero_inertials)
    if format == "sdf":
        return sdf_text(pepper, mesh_paths or "absolute", balance)
    if mesh_paths == "package":
        raise InvalidValueError("mesh_paths", "'package'", "'absolute' or 'relative': MJCF has no packages")
    return mjcf_text(pepper, mesh_paths or "absolute", balance_inertias=balance)
