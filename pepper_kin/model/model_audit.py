"""Audit of a description: all incomplete or unphysical parts, with numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pepper_kin.model.audit_links import LinkRow, audit_links
from pepper_kin.model.audit_tree import JointRow, audit_joints, fingers_found, head_notes, reachable_links
from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.text_table import text_table
from pepper_kin.model.tolerant_urdf import Fault, read_tolerantly
from pepper_kin.model.urdf_source import mesh_folders, read_source


@dataclass(frozen=True)
class Audit:
    """Findings of an audit.

    Attributes:
        name: Name of the robot.
        links: Rows of the links that have mass.
        joints: Rows of the moving joints.
        frames: Number of links, frames without mass included.
        reachable: Number of links connected to the root.
        total_mass: Sum of the links' masses [kg].
        fingers: (fixed, following the hand, independent, missing) finger joints of Pepper's 28; None for a
            robot without such joints.
        meshes: Number of mesh references.
        faults: Faults of the description.
        notes: Unusual parts that can be right, such as mass outside the link's shapes, or an upper limit of
            Pepper's HeadPitch that no robot was seen to reach.
    """

    name: str
    links: tuple[LinkRow, ...]
    joints: tuple[JointRow, ...]
    frames: int
    reachable: int
    total_mass: float
    fingers: tuple[int, int, int, int] | None
    meshes: int
    faults: tuple[Fault, ...]
    notes: tuple[Fault, ...]

    @property
    def success(self) -> bool:
        """Whether there is no fault."""
        return not self.faults

    def of_kind(self, kind: str) -> tuple[Fault, ...]:
        """Return the faults of one kind."""
        return tuple(fault for fault in self.faults if fault.kind == kind)

    def to_dict(self) -> dict[str, object]:
        """Return everything as plain values for JSON."""
        return {"success": self.success, **asdict(self)}

    def report(self) -> str:
        """Return the tables and the faults as text."""
        unresolved = len(self.of_kind("mesh"))
        lines = [f"Audit of {self.name}", ""]
        lines += text_table(
            (
                "link",
                "mass [kg]",
                "least moment [kg m^2]",
                "triangle margin [share]",
                "gyration [m]",
                "reach [m]",
                "",
            ),
            [row.cells() for row in self.links],
        )
        head = (
            "joint", "type", "lower [rad or m]", "upper [rad or m]", "velocity [rad/s or m/s]",
            "effort [N m or N]", "",
        )  # fmt: skip
        lines += ["", *text_table(head, [row.cells() for row in self.joints])]
        lines += [
            "",
            f"total mass        {self.total_mass:.5f} kg in {len(self.links)} links",
            f"moving joints     {len(self.joints)}",
            f"reachable frames  {self.reachable} of {self.frames}",
            f"meshes            {self.meshes - unresolved} of {self.meshes} found",
        ]
        if self.fingers is not None:
            fixed, following, free, missing = self.fingers
            lines.append(
                f"finger joints     {following} follow their hand, {fixed} fixed, {free} independent, "
                f"{missing} missing"
            )
        for title, items in (("notes", self.notes), ("faults", self.faults)):
            lines += ["", f"{len(items)} {title}" if items else f"no {title}", *(f"  {i}" for i in items)]
        return "\n".join(lines)


def audit(source: PepperModel | str | Path, package_dirs: Sequence[str | Path] = ()) -> Audit:
    """Audit a description.

    A malformed description is reported, not refused. Document types and entities are never read.

    Args:
        source: A loaded robot, the text of a URDF, or the path of a URDF file.
        package_dirs: Folders that hold packages, for `package://` mesh names. The folder of a URDF file and
            all folders above it are searched too, also for plain file names.

    Returns:
        The findings; `success` is true without any fault.

    Raises:
        FileFormatError: for a path that cannot be read.
        ModelError: for a robot whose `pinocchio_model` was changed by hand.
    """
    facts = read_tolerantly(read_source(source), mesh_folders(source, package_dirs))
    faults = list(facts.faults)
    links, notes = audit_links(facts, faults)
    joints = audit_joints(facts, faults)
    notes += head_notes(facts.joints)
    reachable = reachable_links(facts, faults)
    shapes = [shape for link in facts.links.values() for shape in link.shapes]
    return Audit(
        name=facts.name,
        links=tuple(links),
        joints=tuple(joints),
        frames=len(facts.links),
        reachable=len(reachable),
        total_mass=float(sum(row.mass for row in links)),
        fingers=fingers_found(facts, faults),
        meshes=sum(shape.kind == "mesh" for shape in shapes),
        faults=tuple(faults),
        notes=tuple(notes),
    )
