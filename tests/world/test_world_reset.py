"""A reset of the twin leaves the world as it is; both together begin again."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin import Twin
from pepper_kin.twin.world import World


@pytest.fixture(scope="module")
def falling():
    """A twin that stands still before a parcel falling on a table, and its reference."""
    pepper = pk.load_pepper()
    scene = pk.Scene().add_box("table", size=(0.5, 1.2, 0.04), position=(0.60, 0.0, 0.68))
    world = World(pepper, scene, friction=0.5)
    world.add_box("parcel", size=(0.12, 0.16, 0.14), mass=0.4, position=(0.45, 0.18, 0.78))
    return Twin(pepper, world=world), np.tile(pepper.neutral(), (150, 1))


def test_a_reset_of_the_twin_leaves_the_world(falling):
    twin, way = falling
    twin.follow(way)
    fallen = twin.world.bodies["parcel"].position
    assert fallen[2] < 0.775  # it was added a centimeter above the table
    twin.reset()
    np.testing.assert_array_equal(twin.world.bodies["parcel"].position, fallen)
    twin.world.reset()
    np.testing.assert_allclose(twin.world.bodies["parcel"].position, [0.45, 0.18, 0.78], atol=1e-15)


def test_both_resets_give_the_same_run_again(falling):
    twin, way = falling
    ends = []
    for _ in range(2):
        twin.reset()
        twin.world.reset()
        run = twin.follow(way)
        ends.append((run.position, run.torque, twin.world.bodies["parcel"].pose))
    for first, second in zip(*ends, strict=True):
        np.testing.assert_array_equal(first, second)
