"""Hip, pelvis, and the leg with its skirt and wheels."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .decals import Projector, Relief, band, ring, spot
from .loft import Loft, superellipse
from .measurements import features, link_shape
from .mesh import join
from .part import Part, measured_loft
from .solids import drum, ellipsoid

Array = NDArray[np.float64]

_HARMONICS = 24
_SKIRT, _SHIN = -0.215, -0.105
_BUMPER_TOP, _SHELL_BOTTOM, _SHELL_TOP = -0.266, -0.2625, -0.0126
_HIP_AXIS = 0.268
_KNEE_STEP = np.array([0.0, 0.0, 0.0, 0.002, 0.003, 0.0])


def _cross(one: Array, two: Array) -> Array:
    """Return the z component of the cross product of plane vectors, shape (..., 2)."""
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


@functools.cache
def _footprint_harmonics() -> Array:
    """Return cosine coefficients of the footprint's outline rho(phi) in coordinates scaled to [-1, 1]."""
    hull = np.array(features()["footprint_hull_xy"])
    low, high = hull.min(axis=0), hull.max(axis=0)
    scaled = (hull - 0.5 * (low + high)) / (0.5 * (high - low))
    phi = np.arange(1440) * (2.0 * np.pi / 1440)
    rays = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    begin, edge = scaled, np.roll(scaled, -1, axis=0) - scaled
    keep = np.linalg.norm(edge, axis=1) > 1e-9
    begin, edge = begin[keep], edge[keep]
    # Distance to each edge's line, t = (b x e) / (d x e); the hull is convex: the nearest line ahead counts.
    ahead = _cross(rays[:, None], edge[None])
    with np.errstate(divide="ignore"):
        distance = np.where(ahead > 1e-12, _cross(begin, edge)[None] / ahead, np.inf)
    outline = distance.min(axis=1)
    order = np.arange(_HARMONICS + 1)
    weight = np.where(order == 0, 1.0, 2.0) * np.exp(-((order / 18.0) ** 4))
    return np.asarray(weight * (np.cos(order[:, None] * phi) @ outline) / len(phi))


def _skirt_radial(phi: Array, s: Array) -> Array:
    """Return rho(phi, s): three-lobed footprint below, ellipse at the shin, rounded box at the knee.

    Args:
        phi: Polar angle in the scaled section [rad], shape (...).
        s: Position along the axis [m], broadcast with `phi`.
    """
    order = np.arange(_HARMONICS + 1)
    angle, position = np.broadcast_arrays(np.asarray(phi, dtype=float), np.asarray(s, dtype=float))
    lobes = np.cos(angle[..., None] * order) @ _footprint_harmonics()
    way = np.clip((position - _SKIRT) / (_SHIN - _SKIRT), 0.0, 1.0)
    blend = way * way * (3.0 - 2.0 * way)
    exponent = np.interp(position, [-0.06, -0.01], [2.0, 3.0])
    return np.asarray((1.0 - blend) * lobes + blend * superellipse(angle, exponent))


def leg() -> Loft:
    """Return the surface of the lower leg and its skirt."""
    return replace(measured_loft("Tibia", round_ends=(False, True)), radial=_skirt_radial)


def tibia() -> list[Part]:
    """Return the visuals of `Tibia`: skirt, bumper, knee drum, windows of lasers and sonars."""
    whole = leg()
    shell = whole.between(_SHELL_BOTTOM, _SHELL_TOP, (0.003, 0.006), knots=24)
    bumper = whole.between(-0.3071, _BUMPER_TOP, (0.006, 0.003))
    gap = whole.between(_BUMPER_TOP - 0.006, _SHELL_BOTTOM + 0.006)
    gap = replace(gap, sections=gap.sections - np.array([0.0, 0.0, 0.0, 0.004, 0.004, 0.0]))
    knee = whole.between(_SHELL_TOP - 0.008, 0.0394)
    knee = replace(knee, end=whole.end, round_ends=(False, True), sections=knee.sections - _KNEE_STEP)
    front = Projector.toward([-0.01, 0.0, -0.0692], [1.0, 0.0, 0.0])
    window = spot(shell, front, (0.046, 0.0115), exponent=2.6, relief=Relief(0.0008), rings=3)
    sides = [
        spot(
            shell,
            Projector.toward([-0.018, 0.0, -0.0759], [0.0, y, 0.0]),
            (0.030, 0.0105),
            exponent=2.6,
            relief=Relief(0.0008),
            rings=3,
        )
        for y in (1.0, -1.0)
    ]
    sonars = [
        spot(shell, Projector.toward([0.0, 0.0, z], [x, 0.0, 0.0]), (0.013, 0.013), segments=28, rings=2)
        for x, z in ((1.0, -0.1023), (-1.0, -0.0534))
    ]
    return [
        Part("tibia_shell", "pepper_white", shell.mesh(72, 24)),
        Part("tibia_bumper", "pepper_light_gray", bumper.mesh(72, 6)),
        Part("tibia_gap", "pepper_dark", gap.mesh(72, 3)),
        Part("tibia_knee", "pepper_dark", knee.mesh(44, 8)),
        Part("tibia_windows", "pepper_black", join([window, *sides])),
        Part("tibia_sonars", "pepper_gray", join(sonars)),
    ]


def pelvis() -> list[Part]:
    """Return the visuals of `Pelvis`: shell and the hubs of knee and hip pitch."""
    surface = measured_loft("Pelvis", round_ends=(False, True), fillets=(0.010, 0.0))
    hubs = [
        ring(surface, Projector.toward([0.0, 0.0, _HIP_AXIS], [0.0, y, 0.0]), (0.034, 0.034), 0.004)
        for y in (1.0, -1.0)
    ]
    seam = band(surface, 0.0600, 0.0622, relief=Relief(0.0003, 0.0003))
    return [
        Part("pelvis_shell", "pepper_white", surface.mesh(56, 24)),
        Part("pelvis_hubs", "pepper_light_gray", join(hubs)),
        Part("pelvis_seam", "pepper_light_gray", seam),
    ]


def hip() -> list[Part]:
    """Return the visuals of `Hip`: a drum about the pitch axis, and the waist above it."""
    measured = measured_loft("Hip")
    radius = -float(link_shape("Hip").bounds[0, 2])
    drum_ = drum("y", [0.0, 0.0, 0.0], (radius, radius), (-0.0485, 0.0485), fillets=(0.008, 0.008))
    rows = measured.sections[measured.sections[:, 0] > 0.04]
    waist = Loft("z", rows, float(rows[0, 0]), measured.end, (False, True))
    return [
        Part("hip_drum", "pepper_light_gray", drum_.mesh(56, 8)),
        Part("hip_waist", "pepper_dark", waist.mesh(40, 9)),
    ]


def wheel() -> list[Part]:
    """Return the visuals of every wheel: a sphere of two rolling halves, split by a dark groove."""
    ball = ellipsoid([0.0, 0.0, 0.0], [0.0695, 0.0695, 0.0695], "y")
    groove = band(ball, -0.004, 0.004, relief=Relief(0.0005, 0.0004), segments=40)
    return [
        Part("wheel_ball", "pepper_light_gray", ball.mesh(32, 16)),
        Part("wheel_groove", "pepper_dark", groove),
    ]
