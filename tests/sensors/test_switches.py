"""Pads: what is dismissed without a closer look is what coal finds too far away."""

import coal
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.solids import padding
from pepper_kin.model import Box, Capsule, Cylinder, Sphere
from pepper_kin.twin.sensors import SensorSuite, sensor_specifications


def shapes(rng):
    corners = rng.normal(size=(12, 3)) * 0.05
    return {
        "box": Box((0.1, 0.02, 0.3)),
        "ball": Sphere(0.07),
        "capsule": Capsule(0.03, 0.2),
        "can": Cylinder(0.05, 0.15),
        "half": pk.collision.HalfSpace(),
        "mesh": pk.collision.ConvexMesh(corners, padding=0.004),
        "cloud": pk.collision.PointCloud(corners, radius=0.01),
    }


@pytest.mark.parametrize("kind", ["box", "ball", "capsule", "can", "half", "mesh", "cloud"])
def test_a_pad_is_pressed_where_coal_says_so(kind):
    """Objects are put at random about the pad, most of them so that they nearly touch."""
    pepper, rng = pk.load_pepper(), np.random.default_rng(5)
    geometry, q = shapes(rng)[kind], pepper.joint_vector({"HeadYaw": 0.4, "HeadPitch": 0.2})
    name = "head_touch_front"
    about = sensor_specifications()[name]
    suite = SensorSuite(pepper, sensors=[name], noise=False)
    frame = pk.kinematics.frame_pose(pepper, q, about.frame)
    pad, place = coal.Box(*about.pad), coal.Transform3s(frame[:3, :3].copy(), frame[:3, 3].copy())
    pressed = 0
    for k in range(60):
        rpy = rng.uniform(-3, 3, 3)
        where = frame[:3, 3] + rng.normal(size=3) * rng.choice([0.03, 0.08, 0.2])
        scene = pk.Scene().add("thing", geometry, where, rpy)
        pose = scene.objects["thing"].transform_object_to_world
        other = coal.Transform3s(pose[:3, :3].copy(), pose[:3, 3].copy())
        gap = coal.distance(
            pad, place, coal_geometry(geometry), other, coal.DistanceRequest(), coal.DistanceResult()
        )
        truth = bool(suite.read(float(k), q, scene=scene)[name].truth)
        assert truth == (gap <= padding(geometry)), (k, gap)
        pressed += truth
    assert 5 < pressed < 55


def test_poses_of_many_frames_are_those_of_each():
    pepper = pk.load_pepper()
    q = pepper.neutral() + np.linspace(-0.1, 0.1, pepper.n)
    frames = [about.frame for about in sensor_specifications().values() if about.frame]
    each = [pk.kinematics.frame_pose(pepper, q, frame) for frame in frames]
    assert np.array_equal(pk.kinematics.frame_poses(pepper, q, frames), each)
