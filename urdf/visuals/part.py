"""Visual geometry of a link: meshes, each with one material."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .loft import Loft
from .measurements import link_shape
from .mesh import Mesh

MATERIALS: dict[str, tuple[float, float, float, float]] = {
    "pepper_white": (0.94, 0.94, 0.95, 1.0),
    "pepper_light_gray": (0.72, 0.73, 0.75, 1.0),
    "pepper_gray": (0.42, 0.43, 0.46, 1.0),
    "pepper_dark": (0.19, 0.20, 0.22, 1.0),
    "pepper_black": (0.03, 0.03, 0.04, 1.0),
    "pepper_screen": (0.09, 0.10, 0.12, 1.0),
    "pepper_led": (0.45, 0.78, 0.98, 1.0),
}
"""Red, green, blue, opacity of every material, each from 0 to 1."""

_ROUNDEST, _SQUAREST = 2.0, 4.5


@dataclass(frozen=True, eq=False)
class Part:
    """One visual of a link.

    Attributes:
        name: Name of its mesh file, without ending.
        material: A key of `MATERIALS`.
        mesh: Its shape in the link's frame [m].
    """

    name: str
    material: str
    mesh: Mesh

    def mirrored(self) -> Part:
        """Return the part of the other side: `left_*` becomes `right_*`."""
        return replace(self, name=self.name.replace("left_", "right_", 1), mesh=self.mesh.mirrored())


def measured_loft(
    link: str,
    *,
    round_ends: tuple[bool, bool] = (True, True),
    fillets: tuple[float, float] = (0.0, 0.0),
    skip: tuple[float, ...] = (),
) -> Loft:
    """Return the surface through a link's measured sections.

    Exponents below 2 come from sections that no superellipse describes (they would put a crease on the axes),
    so they are raised to the ellipse.

    Args:
        link: Name of the measured link.
        round_ends: See `Loft`.
        fillets: See `Loft`.
        skip: Positions s of sections to leave out [m].
    """
    shape = link_shape(link)
    rows = shape.sections.copy()
    rows = rows[~np.isin(rows[:, 0], skip)]
    rows[:, 5] = np.clip(rows[:, 5], _ROUNDEST, _SQUAREST)
    return Loft(shape.axis, rows, shape.start, shape.end, round_ends, fillets)
