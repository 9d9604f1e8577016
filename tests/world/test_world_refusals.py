"""Errors of a world for misuse, and copies of its arguments."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin.world import ContactError, World

FLOOR = Scene().add_half_space("floor", (0, 0, 1))


def with_box(**options):
    world = World(None, FLOOR, **options)
    world.add_box("box", (0.1, 0.1, 0.1), 1.0, (0, 0, 0.3), velocity=(0.1, 0, 0, 0, 0, 0.5))
    return world


def test_misuse_is_refused_by_name():
    for act, words in [
        (lambda w: w.add_box("box", (1, 1, 1), 1.0, (0, 0, 0)), "body name: got 'box'"),
        (lambda w: w.add_ball("floor", 0.1, 1.0, (0, 0, 0)), "body name: got 'floor'"),
        (lambda w: w.add_ball("ball", 0.1, 0.0, (0, 0, 0)), "mass of 'ball'"),
        (lambda w: w.add_ball("ball", np.nan, 1.0, (0, 0, 0)), "radius of 'ball'"),
        (lambda w: w.add_ball("ball", 0.1, 1.0, (0, np.inf, 0)), "position of 'ball'"),
        (lambda w: w.add_box("b", (1, -1, 1), 1.0, (0, 0, 0)), "size of 'b'"),
        (lambda w: w.add_box("b", (1, 1, 1), 1.0, (0, 0, 0), velocity=(1, 2)), "velocity of 'b'"),
        (lambda w: w.add_box("b", (1, 1, 1), 1.0, (0, 0, 0), friction=-1), "friction of 'b'"),
        (
            lambda w: w.add_ball("b", 1e-8, 1.0, (0, 0, 0)),
            "radius of 'b': got 1e-08 m, .* from 5e-07 to 500 m",
        ),
        (lambda w: w.add_box("b", (1, 1, 2e3), 1.0, (0, 0, 0)), "size of 'b': got 2000 m, .* from 1e-06 to"),
        (lambda w: w.add_ball("b", 0.1, 1e9, (0, 0, 0)), r"mass of 'b': got 1e\+09 kg, .* to 1e\+06 kg"),
        (lambda w: w.add_ball("b", 0.1, 1e-20, (0, 0, 0)), "mass of 'b': got 1e-20 kg"),
        (
            lambda w: w.add_ball("b", 0.1, 1e-6, (0, 0, 1)),
            r"mass of 'b': got 1e-06 .* than 'box' \(1 kg\)",
        ),
        (lambda w: w.add_ball("b", 0.1, 1.0, (1e9, 0, 0)), "position of 'b': .* at most 100000 m"),
        (lambda w: w.place("box", velocity=(0, 0, 0, 0, 0, 1e7)), "velocity of 'box': .* at most 100000 m/s"),
        (lambda w: w.add_ball("b", 0.1, 1.0, (0, 0, 0), friction=1e9), "friction of 'b': .* from 0 to 100"),
        (lambda w: w.place("box", (0, 0, np.nan)), "position of 'box'"),
        (lambda w: w.advance_alone(0.0), "h: got 0.0 s"),
        (lambda w: w.advance_alone(0.2), r"h: got 0.2 s, expected a number in \(0, 0.05\] s"),
        (lambda w: w.advance_alone(np.nan), "h: got nan s"),
        (lambda w: w.advance_alone(0.001, np.zeros(15)), "where there is no robot"),
        (lambda w: w.advance(np.zeros(2), np.zeros(2), np.eye(2), np.zeros(2), 0.001), "no robot"),
    ]:
        world = with_box()
        with pytest.raises(InvalidValueError, match=words):
            act(world)
        assert list(world.bodies) == ["box"]
        assert world.bodies["box"].position[2] == 0.3


def test_unknown_bodies_solvers_and_frictions_are_refused():
    with pytest.raises(UnknownNameError, match="unknown free body 'cup'; available: box"):
        with_box().place("cup")
    with pytest.raises(InvalidValueError, match="solver"):
        World(None, solver="magic")
    with pytest.raises(InvalidValueError, match=r"friction: got -0\.1"):
        World(None, friction=-0.1)


def test_names_of_links_and_wrong_shapes_are_refused_with_a_robot():
    pepper = pk.load_pepper()
    world = World(pepper)
    with pytest.raises(InvalidValueError, match="body name: got 'Head'"):
        world.add_ball("Head", 0.1, 1.0, (1, 0, 1))
    with pytest.raises(InvalidValueError, match="15 joints"):
        world.advance(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3), 0.001)
    with pytest.raises(InvalidValueError, match="object name: got 'Head'"):
        World(pepper, Scene().add_sphere("Head", 0.1, (1, 0, 0)))


def test_an_attached_object_needs_a_robot():
    scene = Scene().add_sphere("cup", 0.03, (0, 0, 0)).attach("cup", "l_wrist", np.eye(4))
    with pytest.raises(InvalidValueError, match="cup attached, expected nothing attached"):
        World(None, scene)
    assert World(pk.load_pepper(), scene).scene is scene


def test_a_mass_matrix_that_is_none_stops_the_step_and_names_the_contact():
    pepper = pk.load_pepper()
    q = pepper.neutral()
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    world = World(pepper, Scene().add_box("wall", (0.1, 1, 1), hand + np.array([0.1, 0, 0])))
    world.add_ball("ball", 0.05, 1.0, (2, 0, 1))
    words = r"world stopped at step 1: the robot's mass matrix .* l_wrist on wall"
    with pytest.raises(ContactError, match=words):
        world.advance(q, 0 * q, -np.eye(pepper.n), 0 * q, 0.001)
    with pytest.raises(ContactError, match="NaN"):
        world.advance(q, np.full(pepper.n, 0.0), np.eye(pepper.n), np.full(pepper.n, np.nan), 0.001)
    assert world.bodies["ball"].velocity == pytest.approx(np.zeros(6))


def test_too_many_points_stop_the_step():
    world = World(None, FLOOR)
    for k in range(65):
        world.add_box(f"box {k}", (0.1, 0.1, 0.1), 1.0, (0.2 * k, 0, 0.05))
    with pytest.raises(ContactError, match="more than 256 points in contact"):
        world.advance_alone(0.001)


def test_reset_copy_and_place():
    world = with_box()
    start = world.bodies["box"]
    for _ in range(50):
        world.advance_alone(0.001)
    other = world.copy()
    now = world.bodies["box"]
    assert np.array_equal(other.bodies["box"].pose, now.pose)
    for _ in range(50):
        other.advance_alone(0.001)
    assert np.array_equal(world.bodies["box"].pose, now.pose)  # each goes its own way
    for _ in range(50):
        world.advance_alone(0.001)
    assert np.array_equal(world.bodies["box"].pose, other.bodies["box"].pose)  # the same one
    world.reset()
    assert np.array_equal(world.bodies["box"].pose, start.pose)
    assert np.array_equal(world.bodies["box"].velocity, start.velocity)
    world.place("box", (1, 2, 3))
    assert np.array_equal(world.bodies["box"].position, (1, 2, 3))
    assert np.array_equal(world.bodies["box"].velocity, start.velocity)


def test_bodies_are_values_and_the_scene_stays():
    world = with_box()
    body = world.bodies["box"]
    with pytest.raises(ValueError, match="read-only"):
        body.pose[0, 3] = 5.0
    with pytest.raises(TypeError):
        world.bodies["other"] = body
    scene = world.snapshot()
    assert scene.names == ("floor", "box")
    assert world.scene.names == ("floor",)
    assert scene.objects["box"].transform_object_to_world == pytest.approx(body.pose)


def test_what_the_scene_allows_to_touch_does_not_push():
    pepper = pk.load_pepper(base="planar")
    q = pepper.neutral()
    sunk = Scene().add_half_space("floor", (0, 0, 1), 0.001)
    rolling = sunk.allow("floor", "WheelB_link", "WheelFL_link", "WheelFR_link")
    for scene, touches in ((sunk, True), (rolling, False)):
        world = World(pepper, scene)
        world.advance(q, 0 * q, np.eye(pepper.n), 0 * q, 0.001)
        assert {contact.names[0][:5] for contact in world.contacts} == ({"Wheel"} if touches else set())


def test_what_hangs_on_the_robot_touches_and_pushes_its_joints():
    pepper = pk.load_pepper()
    q = pepper.neutral()
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    reach = np.array([0.15, 0, 0])
    scene = Scene().add_sphere("cup", 0.03, hand + reach).attach("cup", "l_wrist", pepper=pepper, q=q)
    world = World(pepper, scene.add_box("wall", (0.1, 1, 1), hand + reach + np.array([0.08, 0, 0])))
    force = np.zeros(pepper.n)
    force[pepper.joint_index("LShoulderPitch")] = -20.0  # forwards and up
    load = world.advance(q, 0 * q, 0.1 * np.eye(pepper.n), force, 0.001)
    assert [contact.names for contact in world.contacts] == [("cup", "wall")]
    (contact,) = world.contacts
    assert contact.force[0] < -1.0
    jacobian = pk.kinematics.frame_jacobian(pepper, q, "l_wrist")
    moment = np.cross(contact.point - hand, contact.force)
    assert load == pytest.approx(jacobian[:3].T @ contact.force + jacobian[3:].T @ moment, abs=1e-9)
