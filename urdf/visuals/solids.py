"""Simple closed shapes, all of them lofts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .loft import Loft

_ORDER = {"x": [1, 2], "y": [2, 0], "z": [0, 1]}
_MAIN = {"x": 0, "y": 1, "z": 2}


def ellipsoid(center: ArrayLike, radii: ArrayLike, axis: str = "z") -> Loft:
    """Return an ellipsoid.

    Args:
        center: Its center [m], shape (3,).
        radii: Half axes along x, y, z [m], shape (3,).
        axis: Axis through its two poles.
    """
    middle, half = np.asarray(center, dtype=float), np.asarray(radii, dtype=float)
    one, two = _ORDER[axis]
    reach = half[_MAIN[axis]]
    # Half widths are interpolated by their squares, 1 - t^2: dense sections make that parabola exact enough.
    t = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 25))[1:-1]
    scale = np.sqrt(1.0 - t**2)
    rows = [
        [middle[_MAIN[axis]] + reach * a, middle[one], middle[two], half[one] * b, half[two] * b, 2.0]
        for a, b in zip(t, scale, strict=True)
    ]
    start = middle[_MAIN[axis]] - reach
    return Loft(axis, np.array(rows), float(start), float(start + 2.0 * reach))


def drum(
    axis: str,
    center: ArrayLike,
    radii: tuple[float, float],
    span: tuple[float, float],
    *,
    fillets: tuple[float, float] = (0.0, 0.0),
    exponent: float = 2.0,
) -> Loft:
    """Return a straight body of constant section with rounded edges: cylinder, disc or rounded box.

    Args:
        axis: Its axis, "x", "y" or "z".
        center: A point of the axis [m], shape (3,); its coordinate along the axis is not used.
        radii: Half widths along the two next axes (cyclic) [m].
        span: Where it begins and ends along the axis [m].
        fillets: Radius [m] of the edges at begin and end.
        exponent: 2 for an ellipse, more for a rounded rectangle.
    """
    middle = np.asarray(center, dtype=float)
    one, two = _ORDER[axis]
    rows = [[s, middle[one], middle[two], radii[0], radii[1], exponent] for s in span]
    return Loft(axis, np.array(rows), span[0], span[1], (False, False), fillets)
