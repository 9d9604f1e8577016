"""The base of the adapter: places are reached, limits kept, obstacles not touched."""

import math

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.qibullet import PepperVirtual, SimulationError, UnsimulatedError


@pytest.mark.thorough
def test_moves_end_where_they_should(pepper):
    pepper.moveTo(0.6, -0.4, 1.0, frame=PepperVirtual.FRAME_WORLD)
    np.testing.assert_allclose(pepper.getPosition(), [0.6, -0.4, 1.0], atol=0.02)
    pepper.moveTo(0.3, 0.2, -0.5)
    x = 0.6 + 0.3 * math.cos(1.0) - 0.2 * math.sin(1.0)
    y = -0.4 + 0.3 * math.sin(1.0) + 0.2 * math.cos(1.0)
    np.testing.assert_allclose(pepper.getPosition(), [x, y, 0.5], atol=0.03)


def test_a_robot_is_put_where_it_is_spawned(manager, client):
    half = 0.5 * 2.2
    pepper = manager.spawnPepper(client, [1.0, -2.0, 0.0], [0.0, 0.0, math.sin(half), math.cos(half)])
    np.testing.assert_allclose(pepper.getPosition(), [1.0, -2.0, 2.2], atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("speed", [0.15, 0.35])
def test_the_speed_of_a_way_is_kept(manager, client, pepper, speed):
    pepper.moveTo(1.0, 0.0, 0.0, speed=speed, _async=True)
    fastest = 0.0
    while pepper.base_controller.isAlive():
        manager.stepSimulation(client)
        fastest = max(fastest, float(np.hypot(*pepper.body.controller.twist[:2])))
    assert fastest == pytest.approx(speed, rel=0.01)
    np.testing.assert_allclose(pepper.getPosition(), [1.0, 0.0, 0.0], atol=0.02)


@pytest.mark.thorough
def test_an_asynchronous_goal_can_be_changed_and_bars_a_synchronous_one(pepper, steps):
    pepper.moveTo(1.0, 0.0, 0.0, frame=PepperVirtual.FRAME_WORLD, _async=True)
    steps(0.5)
    with pytest.raises(SimulationError, match="stopMove ends it"):
        pepper.moveTo(0.0, 0.0, 0.0)
    pepper.moveTo(0.0, 0.5, 0.0, frame=PepperVirtual.FRAME_WORLD, _async=True)
    steps(8.0)
    np.testing.assert_allclose(pepper.getPosition(), [0.0, 0.5, 0.0], atol=0.02)
    assert not pepper.base_controller.isAlive()


@pytest.mark.thorough
def test_a_velocity_goes_on_until_it_is_stopped(pepper, steps):
    pepper.move(0.2, 0.0, 0.0)
    steps(4.0)
    x = pepper.getPosition()[0]
    assert 0.6 < x < 0.8
    steps(1.0)
    assert pepper.getPosition()[0] - x == pytest.approx(0.2, abs=0.01)
    pepper.stopMove()
    steps(2.0)
    stopped = pepper.getPosition()
    steps(1.0)
    assert pepper.getPosition() == pytest.approx(stopped, abs=1e-3)


@pytest.mark.thorough
def test_velocities_are_cut_to_those_of_the_robot(pepper, steps):
    pepper.move(-33, 0, 0)
    steps(4.0)
    assert -0.55 <= pepper.body.controller.twist[0] < -0.45  # the wheels end at 0.5 along x
    pepper.move(0, 0, 67)
    steps(8.0)
    assert 1.5 < pepper.body.controller.twist[2] <= 2.0
    base = pepper.base_controller
    base.setLinearVelocity(9.0)
    assert base.linear_velocity == base.MAX_LINEAR_VELOCITY == 0.55
    base.setLinearVelocity(0.0)
    assert base.linear_velocity == base.MIN_LINEAR_VELOCITY == 0.1


@pytest.mark.thorough
def test_the_base_stops_before_a_wall_and_not_far_from_it(manager, client, pepper):
    wall = pk.Scene().add_box("wall", size=(0.1, 2.0, 1.5), position=(1.5, 0.0, 0.75))
    manager.setScene(client, wall)
    pepper.moveTo(2.0, 0.0, 0.0)
    model, q = pepper.body.pepper, pepper.body.configuration(True)
    near = pk.collision.near_pairs(model, q, 0.5, wall)
    clearance = min(d for d, names in zip(near.distances, near.names, strict=True) if "wall" in names)
    assert 0.0 < clearance < 0.06


def test_a_robot_off_the_floor_is_refused_by_name(manager, client):
    for place, words in [
        (((0, 0, 0.5), (0, 0, 0, 1)), "z = 0.5"),
        (((0, 0, 0), (0, 0.1, 0, 1)), "quaternion"),
    ]:
        with pytest.raises(UnsimulatedError, match=words):
            manager.spawnPepper(client, *place)


def test_wrong_goals_are_refused(pepper):
    for call, words in (
        (lambda: pepper.moveTo(0, 0, 0, frame=3), "frame: got 3"),
        (lambda: pepper.moveTo(float("inf"), 0, 0), "x: got inf"),
        (lambda: pepper.move("a", 0, 0), "x: got 'a'"),
    ):
        with pytest.raises(SimulationError, match=words):
            call()
    assert pepper.getPosition() == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
