"""Audit of the links: whether a real body can have their masses and inertias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.model.kinematic_tree import ROUNDING, impossible_inertia
from pepper_kin.model.shape_extent import link_extent
from pepper_kin.model.tolerant_urdf import Fault, LinkFacts, UrdfFacts

HIDDEN_HARDWARE = 1.25
"""Maximum ratio of a link's radius of gyration to its `reach`: motors may sit inside the neighboring link."""


@dataclass(frozen=True)
class LinkRow:
    """Mass, inertia and size of one link.

    Attributes:
        name: The link.
        mass: Mass [kg].
        least_moment: Minimum principal moment of inertia [kg m^2]; nan without an inertia.
        triangle_margin: (sum of the two smaller principal moments - the largest) / the largest; at least 0
            for a real body.
        gyration: Radius of gyration about the center of mass, sqrt(tr(I) / 2m) [m].
        reach: Distance from the center of mass to the farthest corner of the box around the link's shapes
            [m], an upper bound of a real body's radius of gyration; nan for a link without shapes.
        status: "ok", "note" or "fault".
    """

    name: str
    mass: float
    least_moment: float
    triangle_margin: float
    gyration: float
    reach: float
    status: str

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        return (
            self.name, f"{self.mass:.5g}", f"{self.least_moment:.3g}", f"{self.triangle_margin:.3f}",
            f"{self.gyration:.4f}", f"{self.reach:.4f}", "" if self.status == "ok" else self.status,
        )  # fmt: skip


def audit_links(facts: UrdfFacts, faults: list[Fault]) -> tuple[list[LinkRow], list[Fault]]:
    """Return a row per link with mass and the notes; faults are appended to `faults`."""
    rows, notes = [], []
    for link in facts.links.values():
        where = f"link {link.name}"
        if link.mass is not None and link.mass < 0:
            faults.append(Fault("mass", where, f"its mass is negative: {link.mass:g} kg"))
        if link.mass == 0 and link.inertia is not None and np.abs(link.inertia).max() > 0:
            faults.append(Fault("mass", where, "an inertia without mass"))
        if link.mass is None or link.mass <= 0:
            continue
        own_faults, own_notes, row = _link(link, where)
        faults += own_faults
        notes += own_notes
        rows.append(row)
    if not rows and facts.links:
        faults.append(Fault("mass", "the robot", "no link has mass"))
    return rows, notes


def _link(link: LinkFacts, where: str) -> tuple[list[Fault], list[Fault], LinkRow]:
    """Return the faults, the notes and the row of one link that has mass."""
    faults: list[Fault] = []
    notes: list[Fault] = []
    mass, nan = float(link.mass or 0.0), float("nan")
    least = margin = gyration = reach = nan
    if link.inertia is not None:
        moments = np.linalg.eigvalsh(link.inertia)
        least = float(moments[0])
        margin = float((moments[0] + moments[1] - moments[2]) / moments[2]) if moments[2] > 0 else nan
        gyration = float(np.sqrt(max(np.trace(link.inertia), 0.0) / (2 * mass)))
        if message := impossible_inertia(moments):
            faults.append(Fault("inertia", where, message))
    box = link_extent(link)
    if box is not None:
        reach = float(np.linalg.norm(np.maximum(box[1] - link.center, link.center - box[0])))
        if gyration > HIDDEN_HARDWARE * reach:
            message = (
                f"radius of gyration {gyration:.4f} m, but no point of the link's shape is farther than "
                f"{reach:.4f} m from its center of mass"
            )
            faults.append(Fault("inertia", where, message))
        else:
            notes += _beyond_shape(link, mass, box, where)
    status = "fault" if faults else "note" if notes else "ok"
    return faults, notes, LinkRow(link.name, mass, least, margin, gyration, reach, status)


def _beyond_shape(link: LinkFacts, mass: float, box: np.ndarray, where: str) -> list[Fault]:
    """Return notes on mass that must lie outside the box around the link's shapes.

    The variance about c of mass inside [a, b] with its center at c is at most (b - c)(c - a) (Bhatia and
    Davis 2000); the variance along x is (Iyy + Izz - Ixx) / 2m.
    """
    outside = np.maximum(np.maximum(link.center - box[1], box[0] - link.center), 0.0)
    if outside.max() > 1e-6:
        message = f"its center of mass is {outside.max():.4f} m outside the box around its shapes"
        return [Fault("inertia", where, message)]
    if link.inertia is None:
        return []
    spread = (np.trace(link.inertia) / 2 - np.diag(link.inertia)) / mass
    allowed = (box[1] - link.center) * (link.center - box[0])
    axis = int(np.argmax(spread - allowed))
    if spread[axis] <= allowed[axis] * (1 + ROUNDING):
        return []
    message = (
        f"its mass spreads {np.sqrt(spread[axis]):.4f} m along {'xyz'[axis]}, the box around its shapes "
        f"allows {np.sqrt(allowed[axis]):.4f} m: part of it must sit inside a neighboring link"
    )
    return [Fault("inertia", where, message)]
