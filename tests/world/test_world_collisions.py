"""What holds in every collision: momentum, energy, Coulomb's cone, nothing pulls."""

import numpy as np
import pytest

from pepper_kin.collision import Scene
from pepper_kin.twin.world import World


def crowd(seed, solver="compiled"):
    """Bodies apart that fly towards one point."""
    rng = np.random.default_rng(seed)
    world = World(None, gravity=(0, 0, 0), friction=0.3, solver=solver)
    for k in range(6):
        place = np.array([0.3 * (k % 3), 0.3 * (k // 3), 0.0]) + rng.uniform(-0.05, 0.05, 3)
        velocity = np.concatenate([-4.0 * (place - [0.3, 0.15, 0.0]), rng.normal(size=3)])
        if k % 2:
            world.add_ball(f"ball {k}", 0.06, 0.1 + 0.1 * k, place, velocity=velocity)
        else:
            world.add_box(f"box {k}", (0.1, 0.12, 0.14), 0.3, place, rng.normal(size=3), velocity=velocity)
    return world


@pytest.mark.parametrize("seed", range(3))
def test_collisions_of_free_bodies_keep_momentum_and_never_add_energy(seed):
    world = crowd(seed)
    momentum = sum(body.momentum for body in world.bodies.values())
    energy = [sum(body.kinetic_energy for body in world.bodies.values())]
    met = 0
    for _ in range(400):
        world.advance_alone(1e-3)
        met += bool(world.contacts)
        energy.append(sum(body.kinetic_energy for body in world.bodies.values()))
        after = sum(body.momentum for body in world.bodies.values())
        assert after == pytest.approx(momentum, abs=1e-13)
    assert met > 20
    assert energy[-1] < 0.8 * energy[0]
    assert np.diff(energy).max() < 1e-4 * energy[0]  # overlaps of hundredths of a millimeter are taken back


def test_two_balls_that_meet_head_on_go_on_together():
    world = World(None, gravity=(0, 0, 0))
    world.add_ball("heavy", 0.05, 0.3, (0, 0, 0), velocity=(1, 0, 0, 0, 0, 0))
    world.add_ball("light", 0.05, 0.1, (0.2, 0, 0), velocity=(-1, 0, 0, 0, 0, 0))
    for _ in range(200):
        world.advance_alone(1e-3)
    for body in world.bodies.values():  # no bounce: (0.3 - 0.1) / 0.4
        assert body.velocity == pytest.approx([0.5, 0, 0, 0, 0, 0], abs=1e-4)


def tumble(steps, h=1e-3, seed=3):
    """Boxes fall on a table and a post; yields the world after every step."""
    rng = np.random.default_rng(seed)
    scene = Scene().add_half_space("floor", (0, 0, 1)).add_box("table", (0.5, 0.5, 0.1), (0, 0, 0.05))
    world = World(None, scene.add_cylinder("post", 0.1, 0.3, (0.2, 0.2, 0.25)), friction=0.5)
    for k in range(5):
        place = (*rng.uniform(-0.2, 0.2, 2), 0.35 + 0.2 * k)
        world.add_box(f"box {k}", (0.1, 0.08, 0.12), 0.2, place, rng.normal(size=3))
    for _ in range(steps):
        world.advance_alone(h)
        yield world


def test_a_tumble_obeys_the_laws_of_contact_in_every_step():
    energy, deepest, points = [], 0.0, 0
    for world in tumble(900):
        energy.append(sum(b.kinetic_energy + b.mass * 9.81 * b.position[2] for b in world.bodies.values()))
        for contact in world.contacts:
            normal = contact.force @ contact.normal
            tangent = np.linalg.norm(contact.force - normal * contact.normal)
            assert normal >= 0.0
            assert tangent <= 0.5 * normal * (1 + 1e-9) + 1e-9
            deepest = min(deepest, contact.gap)
            points += 1
    assert points > 3000
    assert deepest > -2e-3
    assert np.diff(energy).max() < 1e-4 * energy[0]
    assert energy[-1] < 0.5 * energy[0]


def test_the_same_run_twice_gives_the_same_bits():
    for first, second in zip(tumble(300), tumble(300), strict=True):
        for a, b in zip(first.bodies.values(), second.bodies.values(), strict=True):
            assert np.array_equal(a.pose, b.pose)
            assert np.array_equal(a.velocity, b.velocity)


def test_both_solvers_take_the_same_steps():
    solved = 0
    for k, world in enumerate(tumble(700)):
        if k % 10 or k < 200:
            continue
        first, second = world.copy(), world.copy()
        second.solver = "proxsuite"
        first.advance_alone(1e-3)
        second.advance_alone(1e-3)
        ways = (first.last_solution, second.last_solution)
        if ways[0] is None or max(way.problems for way in ways) > 5:
            continue  # nothing touches, or a collision whose friction iterations do not converge
        assert tuple(way.solver for way in ways) == ("compiled", "proxsuite")
        solved += 1
        for a, b in zip(first.bodies.values(), second.bodies.values(), strict=True):
            assert b.velocity[:3] == pytest.approx(a.velocity[:3], abs=1e-4)
            assert b.velocity[3:] == pytest.approx(a.velocity[3:], abs=2e-3)  # 1e-4 m/s, half a box away
    assert solved > 30
