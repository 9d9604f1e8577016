"""Obstacles of the scene that move, in the twin's world: they go on by themselves and push what yields."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.base_placement.obstacles import obstacle_clearance
from pepper_kin.twin import Twin
from pepper_kin.twin.world import World

FLOOR = ("Tibia", "WheelB_link", "WheelFL_link", "WheelFR_link")


def crossing(**shapes):
    """A floor, which movers pass through, and what else there is."""
    scene = pk.Scene().add_half_space("floor", (0, 0, 1)).allow("floor", *FLOOR)
    for name, (position, velocity) in shapes.items():
        scene = scene.add_sphere(name, 0.1, position, velocity=velocity)
    return scene


def place(world, name):
    return world.snapshot().objects[name].transform_object_to_world[:3, 3]


def test_movers_go_on_through_all_that_stands():
    """Not pulled down, not held by the floor or by one another; the colors and names stay theirs."""
    scene = crossing(down=((2.0, 0.0, 0.5), (0.0, 0.0, -1.0)), up=((2.0, 0.0, -0.5), (0.0, 0.0, 1.0)))
    world = World(None, scene)
    assert world.bodies == {}
    for _ in range(500):
        world.advance_alone(0.002)
    assert place(world, "down") == pytest.approx([2.0, 0.0, -0.5], abs=1e-12)
    assert place(world, "up") == pytest.approx([2.0, 0.0, 0.5], abs=1e-12)
    assert place(world.copy(), "up") == pytest.approx(place(world, "up"), abs=0.0)
    world.add_ball("late", 0.1, 1.0, (0.0, 0.0, 1.0))
    assert place(world, "up") == pytest.approx([2.0, 0.0, 0.5], abs=1e-12)
    world.reset()
    assert place(world, "up") == pytest.approx([2.0, 0.0, -0.5], abs=0.0)
    assert set(world.bodies) == {"late"}


def test_a_free_ball_is_pushed_at_the_velocity_of_the_mover():
    """A central push without friction: after it the lighter ball is at least as fast as what pushed it."""
    scene = pk.Scene().add_sphere("mover", 0.1, (0.0, 0.0, 1.0), velocity=(0.5, 0.0, 0.0))
    world = World(None, scene, gravity=(0.0, 0.0, 0.0), friction=0.0)
    world.add_ball("ball", 0.1, 1.0, (0.3, 0.0, 1.0))
    for _ in range(500):
        world.advance_alone(0.002)
    assert world.bodies["ball"].velocity[0] >= 0.5 - 1e-6
    assert place(world, "ball")[0] - place(world, "mover")[0] > 0.2 - 1e-3
    assert place(world, "mover") == pytest.approx([0.5, 0.0, 1.0], abs=1e-8)


@pytest.mark.parametrize("shape", ["sphere", "box", "capsule", "cylinder", "cloud"])
def test_an_arm_is_pushed_aside(shape):
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    wrist = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    start, motion = wrist + np.array([0.2, 0.0, 0.0]), {"velocity": (-0.15, 0.0, 0.0)}
    scene = pk.Scene()
    match shape:
        case "sphere":
            scene = scene.add_sphere("mover", 0.08, start, **motion)
        case "box":
            scene = scene.add_box("mover", (0.1, 0.1, 0.1), start, **motion)
        case "capsule":
            scene = scene.add_capsule("mover", 0.05, 0.1, start, **motion)
        case "cylinder":
            scene = scene.add_cylinder("mover", 0.05, 0.1, start, **motion)
        case "cloud":
            points = np.random.default_rng(0).uniform(-0.05, 0.05, (60, 3))
            scene = scene.add_point_cloud("mover", points, 0.02, start, voxel=None, **motion)
    world = World(pepper, scene)
    twin = Twin(pepper, world=world)
    twin.reset(q)
    run = twin.execute(pk.Trajectory.from_positions(pepper, [0.0, 1.0], [q, q]))
    arm = [pepper.joint_index(f"L{name}") for name in ("ShoulderPitch", "ShoulderRoll", "ElbowRoll")]
    assert np.abs(run.position[0, arm] - q[arm]).max() < 0.01
    assert np.abs(run.position[-1, arm] - q[arm]).max() > 0.03
    assert place(world, "mover") - start == pytest.approx([-0.15 * run.duration, 0.0, 0.0], abs=1e-5)
    assert obstacle_clearance(pepper, run.position[-1][None, None], world.snapshot())[0] > -0.005
