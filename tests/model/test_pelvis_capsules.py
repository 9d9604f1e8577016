"""The capsules of the pelvis hold its measured body."""

import json
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.model.shapes import rotation_rpy
from pepper_kin.urdf.visuals.measurements import link_shape

DATA = Path(__file__).parents[1] / "data"
FITS = json.loads((DATA / "pelvis_fits.json").read_text())
GROWN = 0.006


def outside(points, solid):
    """Distances outside a solid of the file, below zero inside."""
    if solid["type"] == "box":
        local = np.abs((points - solid["center"]) @ rotation_rpy(*solid["rpy"])) - np.array(solid["size"]) / 2
        return local.max(axis=1)
    return outside_capsule(points, np.array(solid["p0"]), np.array(solid["p1"]), solid["radius"])


def outside_capsule(points, start, end, radius):
    axis = end - start
    along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * axis, axis=1) - radius


def in_all_fits(points):
    """Whether points lie where the surface can lie: within its bounds and within every set around it."""
    kept = np.all((points >= FITS["bounds_min"]) & (points <= FITS["bounds_max"]), axis=1)
    for solids in FITS["sets"].values():
        kept &= np.min([outside(points, s) for s in solids], axis=0) <= 0
    return kept


def near_sections(points, grown):
    """Whether points lie in the measured sections, superellipses, grown by a length."""
    rows = link_shape("Pelvis").sections
    z = np.clip(points[:, 2], rows[0, 0], rows[-1, 0])
    center, half_x, half_y, power = (np.interp(z, rows[:, 0], rows[:, i]) for i in (1, 3, 4, 5))
    across = (np.abs(points[:, 0] - center) / (half_x + grown)) ** power
    return across + (np.abs(points[:, 1]) / (half_y + grown)) ** power <= 1


def grid(step):
    low, high = np.array(FITS["bounds_min"]), np.array(FITS["bounds_max"])
    low[1] = 0.0  # left and right are alike
    axes = [np.append(np.arange(a, b, step), b) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def capsules():
    for shape in pk.load_pepper().collision_shapes:
        if shape.link == "Pelvis":
            pose, half = shape.transform_shape_to_link, shape.geometry.length / 2
            ends = (pose[:3, 3] - half * pose[:3, 2], pose[:3, 3] + half * pose[:3, 2])
            yield *ends, shape.geometry.radius


def left_out(points, thinner=0.0):
    """Return the points that are in none of the capsules, each thinned by a length."""
    gaps = np.min([outside_capsule(points, start, end, r - thinner) for start, end, r in capsules()], axis=0)
    return points[gaps > 0]


def test_they_hold_the_measured_body_and_6_mm_around_it():
    """All that every set of solids around the surface shares, within 6 mm of the sections."""
    points = grid(0.0025)
    points = points[near_sections(points, GROWN)]
    assert len(points) > 200_000
    free = left_out(points)
    assert not in_all_fits(free).any()
    free = left_out(points, thinner=0.002)
    assert in_all_fits(free).any()  # two millimeters less would not do


def test_what_they_leave_out_is_far_from_the_sections():
    """They are tighter than all sets together, so they are no mere copy of one of them."""
    free = left_out(grid(0.005))
    free = free[in_all_fits(free)]
    assert len(free) > 0
    assert not near_sections(free, GROWN).any()


def test_they_are_mirror_images_of_themselves():
    for start, end, _ in capsules():
        assert start == pytest.approx(end * [1, -1, 1], abs=1e-12)
