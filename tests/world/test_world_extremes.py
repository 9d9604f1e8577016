"""Free bodies of extreme sizes, masses, ratios and speeds, against closed forms and conservation laws."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import Scene
from pepper_kin.twin.world import World

FLOORS = {
    "half-space": Scene().add_half_space("floor", (0, 0, 1)),
    "box": Scene().add_box("floor", (1e3, 1e3, 0.1), (0, 0, -0.05)),
}
G = 9.81


def put(world, shape, name, size, mass, height, **options):
    if shape == "ball":
        world.add_ball(name, size / 2, mass, (0, 0, height), **options)
    else:
        world.add_box(name, (size,) * 3, mass, (0, 0, height), **options)


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("shape", ["ball", "box"])
@pytest.mark.parametrize("size", [1e-6, 1e-5, 1e-3, 1.0, 1e3])
def test_bodies_of_every_size_and_mass_fall_and_come_to_rest_on_the_floor(floor, shape, size):
    """They fall half their size freely, and stay on the floor: 10 um sank through it."""
    for mass in (1e-15, 1e-9, 1.0, 1e6):
        world = World(None, FLOORS[floor])
        put(world, shape, "body", size, mass, size)
        for _ in range(300):
            world.advance_alone(0.001)
        fallen = min(0.5 * G * 0.3 * 0.301, 0.5 * size)  # semi-implicit Euler: g t (t + h) / 2
        expected = size - fallen
        assert world.bodies["body"].position[2] == pytest.approx(expected, abs=0.01 * size), mass


@pytest.mark.parametrize("ratio", [1e-5, 1e-2, 1e2, 1e5])
def test_stacks_of_any_ratio_of_masses_carry_their_weight(ratio):
    world = World(None, FLOORS["half-space"])
    put(world, "box", "lower", 0.1, 1e-3, 0.05)
    put(world, "box", "upper", 0.1, 1e-3 * ratio, 0.15)
    for _ in range(300):
        world.advance_alone(0.002)
    force = dict.fromkeys([("lower", "floor"), ("upper", "lower")], 0.0)
    for contact in world.contacts:
        force[contact.names] = force.get(contact.names, 0.0) + contact.force[2]
    assert force["lower", "floor"] == pytest.approx(1e-3 * (1 + ratio) * G, rel=1e-3)
    between = abs(force["upper", "lower"]) + abs(force.get(("lower", "upper"), 0.0))
    assert between == pytest.approx(1e-3 * ratio * G, rel=1e-3, abs=1e-9 * G)
    assert world.bodies["upper"].position[2] == pytest.approx(0.15, abs=2e-4)


@pytest.mark.parametrize("speed", [10.0, 1e3, 9e4])
@pytest.mark.parametrize("shape", ["ball", "box"])
def test_fast_bodies_do_not_pass_a_thin_wall(speed, shape):
    scene = Scene().add_box("wall", (10.0, 10.0, 0.001), (0, 0, 0))
    world = World(None, scene, gravity=(0, 0, 0))
    put(world, shape, "body", 0.02, 0.1, 5.0, velocity=(0, 0, -speed, 0, 0, 0))
    for _ in range(600):
        world.advance_alone(0.001)
    assert world.bodies["body"].position[2] > 0.0


@pytest.mark.parametrize("rate", [1.0, 300.0, 1e4, 9e4])
def test_fast_turning_keeps_energy_and_momentum(rate):
    world = World(None, gravity=(0, 0, 0))
    world.add_box("body", (0.1, 0.2, 0.35), 2.0, (0, 0, 1), velocity=(0, 0, 0, rate, 0.7 * rate, -0.4 * rate))
    before = world.bodies["body"]
    for _ in range(50):
        world.advance_alone(0.01)
    after = world.bodies["body"]
    assert after.kinetic_energy == pytest.approx(before.kinetic_energy, rel=1e-6)
    momentum = before.momentum
    np.testing.assert_allclose(after.momentum, momentum, rtol=1e-6, atol=1e-6 * np.abs(momentum).max())
    np.testing.assert_allclose(after.pose[:3, :3] @ after.pose[:3, :3].T, np.eye(3), atol=1e-12)


def test_a_robot_carries_bodies_of_every_mass():
    pepper = pk.load_pepper()
    for mass in (3e-4, 3e-2, 3.0):
        world = World(pepper)
        world.add_ball("ball", 0.02, mass, (0.0, 0.0, 1.3))
        run = pk.Twin(pepper, 0.002, world=world).follow(np.tile(pepper.neutral(), (60, 1)))
        assert run.success
        assert world.bodies["ball"].position[2] > 1.15
