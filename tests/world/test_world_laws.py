"""Free flight, sliding, rolling and stacks against their closed forms."""

import numpy as np
import pytest

from pepper_kin.collision import Scene
from pepper_kin.twin.world import World

G = 9.81
FLOOR = Scene().add_half_space("floor", (0, 0, 1))


def run(world, steps, h=1e-3):
    for _ in range(steps):
        world.advance_alone(h)


@pytest.mark.parametrize("h", [0.001, 0.005])
def test_a_box_falls_as_the_scheme_says_and_rests_at_its_half_height(h):
    world = World(None, FLOOR)
    world.add_box("box", (0.2, 0.3, 0.1), 2.0, (0.1, 0.2, 0.5))
    steps = round(0.2 / h)
    run(world, steps, h)
    box = world.bodies["box"]
    assert box.velocity == pytest.approx([0, 0, -G * 0.2, 0, 0, 0], abs=1e-12)
    # Semi-implicit Euler: z = z0 - g h^2 k (k + 1) / 2, which is g t^2 / 2 and a term of first order in h.
    assert box.position[2] == pytest.approx(0.5 - G * h * h * steps * (steps + 1) / 2, abs=1e-12)
    assert box.position[2] == pytest.approx(0.5 - G * 0.2**2 / 2, abs=1.01 * G * 0.2 * h / 2)
    assert world.contacts == ()
    run(world, round(0.5 / h), h)
    box = world.bodies["box"]
    assert box.position == pytest.approx([0.1, 0.2, 0.05], abs=1e-7)
    assert np.abs(box.velocity).max() < 1e-8
    total = sum(contact.force for contact in world.contacts)
    assert total == pytest.approx([0, 0, 2.0 * G], abs=1e-5)
    assert {contact.names for contact in world.contacts} == {("box", "floor")}


def test_it_lands_when_free_fall_says_so():
    world = World(None, FLOOR)
    world.add_ball("ball", 0.05, 0.1, (0, 0, 0.55))
    run(world, 318)  # sqrt(2 0.5 / g) = 0.3193 s
    assert world.bodies["ball"].velocity[2] < -3.0
    run(world, 3)
    assert world.bodies["ball"].velocity[2] == pytest.approx(0.0, abs=1e-3)
    assert world.bodies["ball"].position[2] == pytest.approx(0.05, abs=1e-5)


def slope(angle, yaw=0.0):
    """A plane that falls along x by an angle; the unit vectors across it and down it."""
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    return Scene().add_half_space("slope", normal), normal, np.array([np.cos(angle), 0.0, -np.sin(angle)])


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_block_sticks_below_the_friction_angle(yaw):
    mu = 0.5
    angle = np.arctan(mu) - 0.01
    scene, normal, _ = slope(angle)
    world = World(None, scene, friction=mu)
    world.add_box("block", (0.2, 0.2, 0.05), 1.0, 0.025 * normal, (0, angle, 0))
    turn_about(world, "block", normal, yaw)
    start = world.bodies["block"].position
    run(world, 1000)
    assert np.linalg.norm(world.bodies["block"].position - start) < 1e-5
    force = sum(contact.force for contact in world.contacts)
    assert force == pytest.approx([0, 0, G], abs=1e-4)  # it carries the weight, friction included


def turn_about(world, name, axis, angle):
    """Turn a body about an axis through its center."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_rotvec(angle * axis) * Rotation.from_matrix(world.bodies[name].pose[:3, :3])
    world.place(name, rpy=turned.as_euler("xyz"))


@pytest.mark.parametrize("yaw", [0.0, 0.5])
@pytest.mark.parametrize("mu", [0.0, 0.3, 0.6])
def test_a_block_slides_above_it_with_g_sin_less_mu_g_cos(mu, yaw):
    angle = np.arctan(mu) + 0.15
    scene, normal, down = slope(angle)
    world = World(None, scene, friction=mu)
    world.add_box("block", (0.2, 0.2, 0.05), 1.0, 0.025 * normal, (0, angle, 0))
    turn_about(world, "block", normal, yaw)
    run(world, 500)
    block = world.bodies["block"]
    speed = G * (np.sin(angle) - mu * np.cos(angle)) * 0.5
    assert block.velocity[:3] == pytest.approx(speed * down, abs=2e-4)
    assert block.position @ normal == pytest.approx(0.025, abs=1e-5)  # no lift


@pytest.mark.parametrize("direction", [0.0, 0.4, np.pi / 4])
def test_it_stops_after_v_squared_over_two_mu_g_whatever_the_direction(direction):
    mu, v, h = 0.4, 1.0, 1e-3
    way = np.array([np.cos(direction), np.sin(direction), 0.0])
    world = World(None, FLOOR, friction=mu)
    world.add_box("puck", (0.2, 0.2, 0.02), 1.0, (0, 0, 0.01), velocity=(*(v * way), 0, 0, 0))
    highest = 0.0
    for _ in range(400):
        world.advance_alone(h)
        highest = max(highest, world.bodies["puck"].position[2])
    puck = world.bodies["puck"]
    # Semi-implicit steps fall short of v^2 / (2 mu g) by v h / 2.
    assert puck.position[:2] @ way[:2] == pytest.approx(v * v / (2 * mu * G) - v * h / 2, abs=2e-4)
    assert abs(np.cross(way, puck.position)[2]) < 1e-4
    assert np.abs(puck.velocity).max() < 1e-5
    assert highest < 0.01 + 1e-5


def test_a_sliding_ball_ends_up_rolling_with_five_sevenths_of_its_speed():
    world = World(None, FLOOR, friction=0.5)
    world.add_ball("ball", 0.05, 0.1, (0, 0, 0.05), velocity=(1, 0, 0, 0, 0, 0))
    run(world, 500)
    ball = world.bodies["ball"]
    assert ball.velocity == pytest.approx([5 / 7, 0, 0, 0, 5 / 7 / 0.05, 0], abs=1e-4)
    before = ball.velocity
    run(world, 500)  # no rolling resistance
    assert world.bodies["ball"].velocity == pytest.approx(before, abs=1e-4)


def test_a_ball_rolls_down_a_slope_with_five_sevenths_of_g_sin():
    scene, normal, down = slope(0.3)
    world = World(None, scene, friction=0.8)
    world.add_ball("ball", 0.05, 0.1, 0.05 * normal)
    run(world, 500)
    assert world.bodies["ball"].velocity[:3] == pytest.approx(5 / 7 * G * np.sin(0.3) * 0.5 * down, abs=1e-5)


def test_a_stack_of_boxes_stays():
    world = World(None, FLOOR)
    for level in range(5):
        place = (0.004 * level, 0, 0.05 + 0.1 * level)
        world.add_box(f"box {level}", (0.1, 0.1, 0.1), 0.2, place, (0, 0, 0.2 * level))
    start = {name: body.pose for name, body in world.bodies.items()}
    run(world, 2000)
    for name, body in world.bodies.items():
        assert np.abs(body.pose - start[name]).max() < 1e-5
        assert np.abs(body.velocity).max() < 1e-6
    for level in range(5):
        above = 0.2 * G * (5 - level)
        below = "floor" if level == 0 else f"box {level - 1}"
        pair = {f"box {level}", below}
        held = [contact for contact in world.contacts if set(contact.names) == pair]
        assert sum(abs(contact.force[2]) for contact in held) == pytest.approx(above, rel=1e-4)


def test_a_tower_topples_when_its_center_is_past_the_edge():
    table = Scene().add_box("table", (1.0, 1.0, 0.1), (0, 0, 0.45))
    for over, falls in ((-0.005, False), (0.005, True)):
        world = World(None, table)
        world.add_box("box", (0.1, 0.1, 0.2), 1.0, (0.5 + over, 0, 0.6))
        run(world, 1500)
        assert (world.bodies["box"].position[2] < 0.5) == falls


def test_free_turning_keeps_momentum_and_energy():
    world = World(None, gravity=(0, 0, 0))
    world.add_box("box", (0.1, 0.2, 0.4), 1.0, (0, 0, 0), velocity=(0, 0, 0, 0.3, 8.0, 0.2))
    box = world.bodies["box"]
    momentum, energy = box.momentum, box.kinetic_energy
    tilted = 0.0
    for _ in range(3000):
        world.advance_alone(1e-3)
        tilted = max(tilted, abs(world.bodies["box"].velocity[3]))
    box = world.bodies["box"]
    assert tilted > 1.0  # it tumbles: turning about the middle axis is unstable
    assert box.momentum == pytest.approx(momentum, abs=1e-11)
    assert box.kinetic_energy == pytest.approx(energy, rel=1e-11)
    rotation = box.pose[:3, :3]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-14


def test_free_turning_follows_eulers_equations():
    """Against an integration of 100 times finer steps by scipy: the order is two."""
    from scipy.integrate import solve_ivp

    start = np.array([2.0, 3.0, 1.0])
    errors = []
    for h in (0.004, 0.002):
        world = World(None, gravity=(0, 0, 0))
        world.add_box("box", (0.1, 0.2, 0.4), 1.0, (0, 0, 0), velocity=(0, 0, 0, *start))
        moments = world.bodies["box"].inertia
        run(world, round(0.4 / h), h)
        box = world.bodies["box"]
        exact = solve_ivp(
            lambda _, w, i=moments: -np.cross(w, i * w) / i, (0, 0.4), start, rtol=1e-11, atol=1e-12
        ).y[:, -1]
        errors.append(np.abs(box.pose[:3, :3].T @ box.velocity[3:] - exact).max())
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
