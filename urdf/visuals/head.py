"""The head with eyes, ears, mouth and skull cap, and the neck."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .decals import FLAT, Projector, Relief, ring, spot, strip
from .loft import Loft
from .measurements import features
from .mesh import Mesh, join
from .part import Part, measured_loft
from .solids import drum

Array = NDArray[np.float64]

# The ears widen these sections; the skull between them is an ellipse of this half width.
_EAR_SECTIONS = (0.0692, 0.0823, 0.0953, 0.1084, 0.1215, 0.1346, 0.1476, 0.1607)
_SKULL_HALF_WIDTH, _SKULL_HEIGHT, _SKULL_RISE, _SKULL_DROP = 0.0957, 0.115, 0.105, 0.092
_SOCKET_DEPTH, _SOCKET_RADIUS = 0.0085, 0.036
_MIDDLE = np.array([0.005, 0.0, 0.115])


def _sockets(points: Array) -> Array:
    """Press the two eye sockets into the face: x -= d (1 - r^3)^2 for r < 1, r = distance / socket radius.

    Args:
        points: Points of the head [m], shape (..., 3); those behind the face, x <= 0, stay.
    """
    _, y, z = features()["head"]["eyes"]["center_left"]
    carved = points.copy()
    distance = np.hypot(np.abs(points[..., 1]) - y, points[..., 2] - z) / _SOCKET_RADIUS
    dent = _SOCKET_DEPTH * (1.0 - np.clip(distance, 0.0, 1.0) ** 3) ** 2
    carved[..., 0] -= np.where(points[..., 0] > 0.0, dent, 0.0)
    return carved


def skull() -> Loft:
    """Return the head's surface without ears."""
    measured = measured_loft("Head")
    rows = measured.sections.copy()
    rise = rows[:, 0] - _SKULL_HEIGHT
    reach = np.where(rise > 0.0, _SKULL_RISE, _SKULL_DROP)
    ellipse = _SKULL_HALF_WIDTH * np.sqrt(np.maximum(1.0 - (rise / reach) ** 2, 0.0))
    beside_ears = np.isin(rows[:, 0], _EAR_SECTIONS)
    rows[:, 4] = np.where(beside_ears, ellipse, rows[:, 4])
    return replace(measured, sections=rows, carve=_sockets)


def _cap(surface: Loft, margin: float, relief: Relief) -> Mesh:
    """Return the skull cap: from the forehead over the top to the back of the head."""
    angle = np.linspace(np.radians(24.0) - margin / 0.1, np.radians(208.0) + margin / 0.1, 31)
    half = np.interp(
        np.degrees(angle), [24.0, 60.0, 110.0, 160.0, 208.0], [0.040, 0.054, 0.060, 0.066, 0.060]
    )
    way = np.linspace(-0.985, 0.985, len(angle))
    half *= (1.0 - way**6) ** (1.0 / 3.0)
    across = np.linspace(1.0, -1.0, 13)
    origins = np.broadcast_to(_MIDDLE, (len(angle), len(across), 3)).copy()
    origins[..., 1] = -(half + margin)[:, None] * across
    along = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    return strip(surface, origins, np.broadcast_to(along[:, None, :], origins.shape), relief=relief)


def _eyes(surface: Loft) -> list[Part]:
    eyes = features()["head"]["eyes"]
    _, y, z = eyes["center_left"]
    half = (0.5 * eyes["width_y"], 0.5 * eyes["height_z"])
    dark, glow = [], []
    for side in (1.0, -1.0):
        lens = Projector.toward([0.0, side * y, z], [1.0, 0.0, 0.0])
        rim = (half[0] + 0.0055, half[1] + 0.0055)
        dark.append(spot(surface, lens, rim, relief=Relief(lift=0.0012, edge=4.0)))
        glow.append(
            ring(surface, lens, (half[0] + 0.0035, half[1] + 0.0035), 0.0030, relief=Relief(0.0018, -0.0004))
        )
    return [
        Part("head_eyes", "pepper_black", join(dark)),
        Part("head_eye_rings", "pepper_led", join(glow)),
    ]


def _ears() -> list[Part]:
    ears = features()["head"]["ears"]
    x, _, z = ears["center_left"]
    outside, radius = 0.1061, ears["radius"]
    pod = drum("y", [0.0, 0.0, z + 0.002], (0.047, 0.047), (0.084, 0.1035), fillets=(0.0, 0.012))
    disc = drum("y", [x, 0.0, z], (radius, radius), (0.1, outside), fillets=(0.0, 0.004))
    halo = ring(
        pod,
        Projector.toward([x, 0.09, z], [0.0, 1.0, 0.0]),
        (radius + 0.004, radius + 0.004),
        0.0042,
        segments=44,
    )
    both = {
        "head_ear_pods": ("pepper_light_gray", pod.mesh(44, 6)),
        "head_ear_discs": ("pepper_white", disc.mesh(40, 5)),
        "head_ear_rings": ("pepper_led", halo),
    }
    return [Part(name, material, join([mesh, mesh.mirrored()])) for name, (material, mesh) in both.items()]


def _mouth_and_cameras(surface: Loft) -> list[Part]:
    mouth = features()["head"]["mouth"]
    size = (0.5 * mouth["width_y"], 0.5 * mouth["height_z"])
    slit = spot(
        surface,
        Projector.toward([0.0, 0.0, mouth["center"][2]], [1.0, 0.0, 0.0]),
        size,
        relief=FLAT,
        exponent=2.5,
    )
    camera = spot(
        surface, Projector.toward([0.0, 0.0, 0.1631], [1.0, 0.0, 0.0]), (0.0042, 0.0042), segments=24, rings=3
    )
    return [Part("head_mouth", "pepper_black", slit), Part("head_camera", "pepper_black", camera)]


def head() -> list[Part]:
    """Return the visuals of `Head`."""
    surface = skull()
    return [
        Part("head_shell", "pepper_white", surface.mesh(64, 36)),
        Part("head_cap_seam", "pepper_light_gray", _cap(surface, 0.0026, Relief(0.0007, 0.0006, edge=6.0))),
        Part("head_cap", "pepper_white", _cap(surface, 0.0, Relief(0.0014, -0.0003, edge=10.0))),
        *_eyes(surface),
        *_ears(),
        *_mouth_and_cameras(surface),
    ]


def neck() -> list[Part]:
    """Return the visuals of `Neck`."""
    column = measured_loft("Neck", round_ends=(False, False), fillets=(0.0, 0.004), skip=(0.0325,))
    return [Part("neck_column", "pepper_dark", column.mesh(36, 8))]
