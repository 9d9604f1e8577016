"""No false free: what the surfaces' measured ranges say touches is reported, on and between their rows.

`tests/data/anti_collision_mesh.csv` holds the ranges as measured on each side of the body, joint 2 in steps
of 0.01 rad; `urdf/data/anti_collision.csv`, which the library reads, keeps the tighter side for both.

The head's range beyond a yaw of 45 degrees, and its lower end everywhere, are those of a robot; the surfaces,
with errors of a few millimeters, say otherwise there.
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
HEAD = ("torso", "Head")
STOPS = {
    51: 22.9, 57: 21.8, 63: 20.7, 69: 19.4, 75: 17.7, 81: 16.3, 87: 14.8, 93: 14.1, 99: 13.8, 105: 13.8,
    112: 13.8, 119: 13.8,
}  # fmt: skip
"""|yaw| -> where a robot's pitch stopped when more was commanded [deg], from 5,067 settled postures published
with PepperKinematics (RO-MAN 2021).  Up to 45 degrees it reached 25.5, and -39 to -40.4 at every yaw."""


def measured():
    """Pair -> (joint 1, joint 2, rows of (position of joint 1, least free and greatest free of joint 2))."""
    tables, head_yaw = {}, np.radians(45.0)
    with MEASURED.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            low, high = row["joint_2_free_min_rad"], row["joint_2_free_max_rad"]
            none_free = low == ""
            values = (float(row["value_1_rad"]), np.inf if none_free else float(low),
                      -np.inf if none_free else float(high))  # fmt: skip
            pair = tuple(row["link_pair"].split("-"))
            if pair == HEAD:  # what a robot reached is no contact
                if abs(values[0]) > head_yaw:
                    continue
                values = (values[0], -np.inf, values[2])
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
    assert checked > (10 if pair == HEAD else 100)


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
    assert checked > (5 if pair == HEAD else 20)


@pytest.mark.parametrize("pair", measured())
def test_the_middle_of_the_free_interval_is_free(pair):
    """The tables do not simply forbid everything: well inside, the pair does not touch."""
    pepper, rng = pk.load_pepper(), np.random.default_rng(2)
    first, second, rows = measured()[pair]
    table = next(t for t in dependent_ranges(pepper) if set(t.links) == set(pair))
    k, free = pepper.joint_index(second), 0
    for value, low, high in rows:
        low, high = max(low, pepper.lower_limits[k]), min(high, pepper.upper_limits[k])
        if high - low > 0.3:
            q = posture_with(pepper, rng, **{first: value, second: (low + high) / 2})
            free += not table.violated(q)
    assert free >= (9 if pair == HEAD else 10)


def heads(pepper, yaws, pitches):
    """Stand with the head at these yaws and pitches [deg], shape (k, n)."""
    pairs = [
        pepper.joint_vector({"HeadYaw": np.radians(yaw), "HeadPitch": np.radians(pitch)})
        for yaw in yaws
        for pitch in pitches
    ]
    return np.array(pairs)


@pytest.mark.parametrize("side", [-1, 1])
def test_the_head_reaches_what_a_robot_reached_and_is_refused_what_it_refused(side):
    """Beyond the stops by one degree and more is refused; below them, by what sensors tell apart, nothing."""
    pepper = pk.load_pepper()
    for yaw, stop in STOPS.items():
        reached = heads(pepper, [side * yaw], [*np.arange(-40.4, stop, 0.5), stop, stop + 0.28])
        assert not pk.collision.in_collision(pepper, reached).any(), yaw
        refused = heads(pepper, [side * yaw], np.arange(stop + 1.0, 36.0, 0.5))
        assert pk.collision.in_collision(pepper, refused).all(), yaw
    ahead = heads(pepper, side * np.arange(0.0, 45.1, 1.0), [-40.4, -20.0, 0.0, 20.0, 25.5])
    assert not pk.collision.in_collision(pepper, ahead).any()
    straight = heads(pepper, [0.0], [25.6, 30.0, 36.4])
    assert not pk.collision.in_collision(pepper, straight).any(), "the limits of the URDF are the joint's own"


def test_between_the_yaws_of_two_stops_the_head_stops_on_their_line_or_a_little_above():
    pepper = pk.load_pepper()
    yaws, (known, stops) = np.arange(51.0, 119.0, 0.1), zip(*STOPS.items(), strict=True)
    table = next(t for t in dependent_ranges(pepper) if t.links == HEAD)
    for side in (-1, 1):
        above = np.degrees(table.interval(np.radians(side * yaws))[1]) - np.interp(yaws, known, stops)
        assert above.min() > 0.28, "median of |sensed - sent|"
        assert above.max() < 0.9
    assert set(table.sources) == {"surfaces", "robot"}
    assert all(
        (np.radians(45.0) - 1e-4 > abs(x)) == (s == "surfaces")
        for x, s in zip(table.positions, table.sources, strict=True)
    )


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
