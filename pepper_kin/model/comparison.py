"""Differences of two descriptions, joint by joint and link by link."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.poses import rpy_of
from pepper_kin.model.text_table import text_table
from pepper_kin.model.tolerant_urdf import Fault, JointFacts, LinkFacts, read_tolerantly, rotation_angle
from pepper_kin.model.urdf_source import read_source


@dataclass(frozen=True)
class Difference:
    """One quantity in which two descriptions differ.

    Attributes:
        kind: "joint" or "link".
        name: Name of the joint or link.
        quantity: Quantity that differs, such as "upper limit"; "presence" if only one robot has the part.
        first: Value in the first description, as text.
        second: Value in the second description, as text.
        size: Magnitude of the difference, in the quantity's unit; None for values that are not numbers.
        unit: Unit of `size`.
    """

    kind: str
    name: str
    quantity: str
    first: str
    second: str
    size: float | None
    unit: str


@dataclass(frozen=True)
class Comparison:
    """All differences of two descriptions.

    Attributes:
        names: The robots' names.
        same_joints: Number of joints in both descriptions.
        same_links: Number of links in both descriptions.
        total_masses: Total mass of each robot [kg].
        differences: Differences of joints, then of links.
        faults: Unreadable parts of both descriptions; `where` begins with "first: " or "second: ".
    """

    names: tuple[str, str]
    same_joints: int
    same_links: int
    total_masses: tuple[float, float]
    differences: tuple[Difference, ...]
    faults: tuple[Fault, ...]

    @property
    def equal(self) -> bool:
        """Whether nothing differs and everything could be read."""
        return not self.differences and not self.faults

    def of(self, name: str) -> tuple[Difference, ...]:
        """Return the differences of one joint or link."""
        return tuple(item for item in self.differences if item.name == name)

    def to_dict(self) -> dict[str, object]:
        """Return everything as plain values for JSON."""
        return {"equal": self.equal, **asdict(self)}

    def report(self) -> str:
        """Return the differences as a table of text."""
        first, second = self.names
        lines = [
            f"{first} (first) against {second} (second)",
            f"{self.same_joints} joints and {self.same_links} links in both; "
            f"{self.total_masses[0]:.5f} kg and {self.total_masses[1]:.5f} kg",
            "",
        ]
        rows = [
            (
                f"{d.kind} {d.name}", d.quantity, d.first, d.second,
                "" if d.size is None else f"{d.size:.3g} {d.unit}".rstrip(),
            )
            for d in self.differences
        ]  # fmt: skip
        head = ("what", "quantity", "first", "second", "difference")
        lines += text_table(head, rows) if rows else ["no difference"]
        return "\n".join([*lines, *(f"fault: {fault}" for fault in self.faults)])


def compare(
    first: PepperModel | str | Path, second: PepperModel | str | Path, tolerance: float = 1e-9
) -> Comparison:
    """Compare two descriptions by the names of their joints and links.

    Joints are compared by type, parent, child, origin, axis, limits and mimic element; links by mass, center
    of mass and inertia about it, in link axes. Visual geometry and collision shapes are not compared.

    Args:
        first: A loaded robot, URDF text or path.
        second: Another robot, in one of the same forms.
        tolerance: Maximum difference of equal numbers, in their SI unit.

    Raises:
        FileFormatError: for a path that cannot be read.
        ModelError: for a robot whose `pinocchio_model` was changed by hand.
    """
    a, b = read_tolerantly(read_source(first)), read_tolerantly(read_source(second))
    found: list[Difference] = []
    for kind, ours, theirs in (("joint", a.joints, b.joints), ("link", a.links, b.links)):
        for name in [*ours, *(name for name in theirs if name not in ours)]:
            if name not in ours or name not in theirs:
                texts = ("yes" if name in ours else "no", "yes" if name in theirs else "no")
                found.append(Difference(kind, name, "presence", *texts, None, ""))
    for name in (name for name in a.joints if name in b.joints):
        found += _Differ("joint", name, tolerance).joints(a.joints[name], b.joints[name])
    for name in (name for name in a.links if name in b.links):
        found += _Differ("link", name, tolerance).links(a.links[name], b.links[name])
    found.sort(key=lambda item: item.kind)
    faults = [
        Fault(fault.kind, f"{place}: {fault.where}", fault.message)
        for place, facts in (("first", a), ("second", b))
        for fault in facts.faults
        if fault.kind != "mesh"
    ]
    masses = [sum(link.mass or 0.0 for link in facts.links.values()) for facts in (a, b)]
    return Comparison(
        names=(a.name, b.name),
        same_joints=len(a.joints.keys() & b.joints.keys()),
        same_links=len(a.links.keys() & b.links.keys()),
        total_masses=(float(masses[0]), float(masses[1])),
        differences=tuple(found),
        faults=tuple(faults),
    )


def _text(value: float | NDArray[np.float64] | None) -> str:
    """Return a number, or the numbers of an array of any shape, with six digits; "none" for None."""
    return "none" if value is None else " ".join(f"{v:.6g}" for v in np.ravel(value))


class _Differ:
    """Differences of one joint or link."""

    def __init__(self, kind: str, name: str, tolerance: float) -> None:
        self.kind, self.name, self.tolerance = kind, name, tolerance

    def item(
        self, quantity: str, first: str, second: str, size: float | None = None, unit: str = ""
    ) -> Difference:
        """Return one difference of this joint or link."""
        return Difference(self.kind, self.name, quantity, first, second, size, unit)

    def arrays(
        self, quantity: str, a: NDArray[np.float64], b: NDArray[np.float64], unit: str
    ) -> Iterator[Difference]:
        """Yield a difference where two arrays of one shape differ in a component by more than the tolerance.

        Args:
            quantity: Name of the quantity.
            a: Values of the first model [unit].
            b: Values of the second model [unit].
            unit: Unit of the values.
        """
        size = float(np.abs(a - b).max())
        if size > self.tolerance:
            yield self.item(quantity, _text(a), _text(b), size, unit)

    def values(self, quantity: str, a: float | None, b: float | None, unit: str) -> Iterator[Difference]:
        """Yield a difference where two numbers differ by more than the tolerance, or one is missing."""
        if a is None or b is None:
            if a is not b:
                yield self.item(quantity, _text(a), _text(b))
        elif abs(a - b) > self.tolerance:
            yield self.item(quantity, _text(a), _text(b), abs(a - b), unit)

    def joints(self, a: JointFacts, b: JointFacts) -> Iterator[Difference]:
        """Yield all differences of two joints of one name."""
        for quantity in ("type", "parent", "child"):
            x, y = getattr(a, quantity), getattr(b, quantity)
            if x != y:
                yield self.item(quantity, x, y)
        yield from self.arrays("position", a.origin[:3, 3], b.origin[:3, 3], "m")
        angle = rotation_angle(a.origin[:3, :3], b.origin[:3, :3])
        if angle > max(self.tolerance, 1e-7):
            rpy = (_text(np.array(rpy_of(joint.origin[:3, :3]))) for joint in (a, b))
            yield self.item("orientation (rpy)", next(rpy), next(rpy), angle, "rad")
        if a.type != "fixed" and b.type != "fixed":
            yield from self.arrays("axis", a.axis, b.axis, "")
            unit = "m" if a.type == "prismatic" else "rad"
            force = "N" if a.type == "prismatic" else "N m"
            for key, measure in (
                ("lower", unit),
                ("upper", unit),
                ("velocity", f"{unit}/s"),
                ("effort", force),
            ):
                yield from self.values(f"{key} limit", a.limits.get(key), b.limits.get(key), measure)
        if (a.mimic and a.mimic[0]) != (b.mimic and b.mimic[0]):
            leaders = ["nothing" if m is None else m[0] for m in (a.mimic, b.mimic)]
            yield self.item("follows", leaders[0], leaders[1])
        elif a.mimic is not None and b.mimic is not None:
            yield from self.values("multiplier", a.mimic[1], b.mimic[1], "")
            yield from self.values("offset", a.mimic[2], b.mimic[2], "")

    def links(self, a: LinkFacts, b: LinkFacts) -> Iterator[Difference]:
        """Yield all differences of two links of one name."""
        masses = a.mass or 0.0, b.mass or 0.0
        yield from self.values("mass", *masses, "kg")
        if min(masses) > 0:
            yield from self.arrays("center of mass", a.center, b.center, "m")
        if a.inertia is not None and b.inertia is not None:
            rows, columns = np.triu_indices(3)
            yield from self.arrays("inertia", a.inertia[rows, columns], b.inertia[rows, columns], "kg m^2")
