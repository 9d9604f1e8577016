"""No false free: what the surfaces' measured ranges say touches is reported, on and between their rows.

`tests/data/anti_collision_mesh.csv` holds the ranges as measured on each side of the body, joint 2 in steps
of 0.01 rad; `urdf/data/anti_collision.csv`, which the library reads, keeps the tighter side for both.
"""

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.dependent_ranges import dependent_ranges

MEASURED = Path(__file__).parents[1] / "data" / "anti_collision_mesh.csv"
STEP = 0.01


def measured():
    """Pair -> (joint 1, joint 2, rows of (position of joint 1, least free and greatest free of joint 2))."""
    tables = {}
    with MEASURED.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            low, high = row["joint_2_free_min_rad"], row["joint_2_free_max_rad"]
            none_free = low == ""
            values = (float(row["value_1_rad"]), np.inf if none_free else float(low),
                      -np.inf if none_free else float(high))  # fmt: skip
            pair = tuple(row["link_pair"].split("-"))
            tables.setdefault(pair, (row["joint_1"], row["joint_2"], []))[2].append(values)
    return tables


def posture_with(pepper, rng, **values):
    """A random posture with some joints set: only those of the pair matter."""
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits)
    for joint, value in values.items():
        q[pepper.joint_index(joint)] = value
    return q


@pytest.mark.parametrize("pair", measured())
def test_every_measured_contact_is_reported(pair):
    """On each row, all positions of joint 2 beyond its free interval, to the ends of its range."""
    pepper, rng = pk.load_pepper(), np.random.default_rng(0)
    first, second, rows = measured()[pair]
    k = pepper.joint_index(second)
    low_end, high_end = pepper.lower_limits[k], pepper.upper_limits[k]
    checked = 0
    for value, low, high in rows:
        grid = np.arange(low_end, high_end, STEP / 3)
        # The last free step is free; the first that touches lies one step beyond.
        touching = grid[(grid < low - STEP) | (grid > high + STEP)]
        if low <= low_end + STEP:
            touching = touching[touching > high]
        if high >= high_end - STEP:
            touching = touching[touching < low]
        if not len(touching):
            continue
        q = np.array([posture_with(pepper, rng, **{first: value, second: y}) for y in touching])
        assert pk.collision.in_collision(pepper, q).all(), (first, value)
        only_pair = next(t for t in dependent_ranges(pepper) if set(t.links) == set(pair))
        assert only_pair.violated(q).all(), (first, value)
        checked += len(q)
    assert checked > 100


@pytest.mark.parametrize("pair", measured())
def test_between_two_rows_what_either_forbids_is_forbidden(pair):
    pepper, rng = pk.load_pepper(), np.random.default_rng(1)
    first, second, rows = measured()[pair]
    k = pepper.joint_index(second)
    low_end, high_end = pepper.lower_limits[k], pepper.upper_limits[k]
    rows, checked = sorted(rows), 0
    for (x0, low0, high0), (x1, low1, high1) in pairwise(rows):
        for _ in range(60):
            x, y = rng.uniform(x0, x1), rng.uniform(low_end, high_end)
            beyond_low = any(y < low - STEP and low > low_end + STEP for low in (low0, low1))
            beyond_high = any(y > high + STEP and high < high_end - STEP for high in (high0, high1))
            if beyond_low or beyond_high:
                assert pk.collision.in_collision(pepper, posture_with(pepper, rng, **{first: x, second: y}))
                checked += 1
    assert checked > 20


@pytest.mark.parametrize("pair", measured())
def test_the_middle_of_the_free_interval_is_free(pair):
    """The tables do not simply forbid everything: well inside, the pair does not touch."""
    pepper, rng = pk.load_pepper(), np.random.default_rng(2)
    first, second, rows = measured()[pair]
    table = next(t for t in dependent_ranges(pepper) if set(t.links) == set(pair))
    free = 0
    for value, low, high in rows:
        if high - low > 0.3:
            q = posture_with(pepper, rng, **{first: value, second: (low + high) / 2})
            free += not table.violated(q)
    assert free >= 10


ALWAYS = {
    "Hip-torso", "Bicep-Elbow", "Elbow-ForeArm", "Shoulder-Bicep", "Neck-Head", "Pelvis-Hip", "Tibia-Pelvis",
    "torso-Bicep", "torso-Shoulder", "torso-Neck",
}  # fmt: skip
"""Neighbors whose measured surfaces overlap in all of 3000 random postures: one is inside the other."""
NEVER = {"ForeArm-wrist"}
"""Neighbors whose measured surfaces touched in none of them."""


def test_no_other_neighbor_can_be_decided_by_its_surface():
    """What is exempt without a table touches always or never: there is nothing that a table could decide."""
    pepper = pk.load_pepper()
    exempt = {}
    for pair, why in pepper.semantics.disabled_pairs.items():
        if any("Wheel" in link or "Finger" in link or "Thumb" in link for link in pair):
            continue
        exempt.setdefault(why, set()).add(pair)
    assert exempt["DependentRange"] == {tuple(sorted(pair)) for pair in measured()}

    def plain(link):
        return link.split("_")[-1] if "_" in link else link.removeprefix("L").removeprefix("R")

    known = {frozenset(names.split("-")) for names in ALWAYS | NEVER}
    assert {frozenset(map(plain, p)) for p in exempt["Adjacent"] | exempt.get("Always", set())} == known
