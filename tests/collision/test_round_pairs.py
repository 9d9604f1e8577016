"""Depths and normals of round shapes that overlap: moving by the depth parts them, and less does not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.twin.world import World

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)


def carrier(shape):
    """Return a robot of one link, with a shape at its origin."""
    return pk.load_robot(
        f'<robot name="r"><link name="base"/><link name="a">{INERTIAL}<collision><geometry>{shape}</geometry>'
        '</collision></link><joint name="x" type="prismatic"><parent link="base"/><child link="a"/>'
        '<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="99" velocity="1"/></joint></robot>',
        acceleration_limits=1.0,
    )


BALL = carrier('<sphere radius="0.05"/>')
CAPSULE = carrier('<capsule radius="0.05" length="0.3"/>')


def test_the_depth_of_a_ball_in_a_cylinder_is_the_least():
    rng, size = np.random.default_rng(0), (0.1, 0.2)
    deep = 0
    for _ in range(60):
        rotation = Rotation.random(random_state=rng).as_matrix()
        local = rng.uniform([-0.12, -0.12, -0.13], [0.12, 0.12, 0.13])
        place = -rotation @ local
        rpy = Rotation.from_matrix(rotation).as_euler("xyz")
        scene = pk.Scene().add_cylinder("s", *size, place, rpy)
        out, up = np.hypot(*local[:2]) - 0.1, abs(local[2]) - 0.1
        expected = max(out, up) if max(out, up) < 0 else np.hypot(max(out, 0.0), max(up, 0.0))
        found = pk.collision.contacts(BALL, np.zeros(1), scene, within=1.0)[0]
        assert found.distance == pytest.approx(expected - 0.05, abs=2e-6)
        assert np.linalg.norm(found.normal) == pytest.approx(1.0)
        deep += found.distance < -0.05
        if found.distance > -1e-3:
            continue
        sign = 1.0 if found.names[1] == "s" else -1.0
        for share, apart in ((1.001, True), (0.98, False)):
            moved = place + sign * share * found.depth * found.normal
            other = pk.Scene().add_cylinder("s", *size, moved, rpy)
            assert pk.collision.in_collision(BALL, np.zeros(1), other) != apart
    assert deep >= 10


AXES = {
    "ball on the axis of a capsule": (BALL, "capsule", np.eye(3), (0.0, 0.0, 0.04)),
    "ball in a ball": (BALL, "sphere", np.eye(3), (0.0, 0.0, 0.0)),
    "capsules along one line": (CAPSULE, "capsule", np.eye(3), (0.0, 0.0, 0.1)),
    "capsules that cross": (CAPSULE, "capsule", Rotation.from_euler("x", 1.0).as_matrix(), (0.0, 0.0, 0.03)),
    "ball on the axis of a cylinder": (BALL, "cylinder", np.eye(3), (0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("name", AXES)
def test_where_axes_meet_the_normal_is_a_unit_vector_along_which_the_depth_parts(name):
    robot, kind, rotation, place = AXES[name]
    size = {"capsule": (0.2, 0.6), "sphere": (0.2,), "cylinder": (0.2, 1.0)}[kind]

    def scene(shift):
        turned = () if kind == "sphere" else (Rotation.from_matrix(rotation).as_euler("xyz"),)
        return getattr(pk.Scene(), f"add_{kind}")("s", *size, np.add(place, shift), *turned)

    (found,) = pk.collision.contacts(robot, np.zeros(1), scene(np.zeros(3)))
    assert np.linalg.norm(found.normal) == pytest.approx(1.0)
    assert found.distance == pytest.approx(-0.25, abs=1e-5)
    sign = 1.0 if found.names[1] == "s" else -1.0
    assert not pk.collision.in_collision(robot, np.zeros(1), scene(sign * 1.001 * found.depth * found.normal))
    assert pk.collision.in_collision(robot, np.zeros(1), scene(sign * 0.98 * found.depth * found.normal))


@pytest.mark.parametrize("kind", ["cylinder", "capsule", "sphere"])
def test_the_twin_pushes_out_what_stands_on_an_axis(kind):
    size = {"capsule": (0.2, 1.0), "sphere": (0.2,), "cylinder": (0.2, 1.0)}[kind]
    world = World(None, getattr(pk.Scene(), f"add_{kind}")("s", *size, (0, 0, 0)), gravity=(0, 0, 0))
    world.add_ball("ball", 0.1, 1.0, (0.0, 0.0, 0.0))
    for _ in range(1000):
        world.advance_alone(0.002)
    assert np.linalg.norm(world.bodies["ball"].position) > 0.05
