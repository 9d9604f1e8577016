"""Other robots as obstacles: coal on poses of Pinocchio, at every time, is the oracle."""

import pickle
import warnings

import coal
import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision import approach_speed, contacts, least_clearance
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Box
from pepper_kin.twin.world import World

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
FACING = pk.pose((0.75, 0.05, 0.0), rpy=(0, 0, np.pi))
MOTION = pk.retime(
    PEPPER, [STAND, PEPPER.joint_vector({"LShoulderPitch": 0.1, "LElbowRoll": -0.3, "HipPitch": -0.3})]
)


def placed(pepper, q, place):
    """Return coal's shapes of a robot and their poses by Pinocchio."""
    data = pepper.inner_model.createData()
    pinocchio.framesForwardKinematics(pepper.inner_model, data, pepper.to_full(q))
    for shape in pepper.collision_shapes:
        frame = data.oMf[pepper.inner_model.getFrameId(shape.link)]
        pose = pinocchio.SE3(place) * frame * pinocchio.SE3(shape.transform_shape_to_link)
        geometry = shape.geometry
        if isinstance(geometry, Box):
            made = coal.Box(*geometry.size)
        elif hasattr(geometry, "length"):
            kind = coal.Capsule if type(geometry).__name__ == "Capsule" else coal.Cylinder
            made = kind(geometry.radius, geometry.length)
        else:
            made = coal.Sphere(geometry.radius)
        yield made, coal.Transform3s(pose.rotation, pose.translation)


def distance_between(q, other, place):
    """Return the least distance of two Peppers by coal [m]."""
    mine, theirs = list(placed(PEPPER, q, np.eye(4))), list(placed(PEPPER, other, place))
    request, least = coal.DistanceRequest(), np.inf
    for first, at in mine:
        for second, there in theirs:
            least = min(least, coal.distance(first, at, second, there, request, coal.DistanceResult()))
    return least


def distance_of_scene(q, scene, time=None):
    """Return the least distance to what is in a scene [m], without those of the robot to itself."""
    if time is None:
        pairs = contacts(PEPPER, q, scene, within=1.0)
        return min(c.distance for c in pairs if any(name.startswith("other/") for name in c.names))
    return distance_of_scene(q, scene.at(time))


def test_a_robot_stands_where_its_kinematics_puts_it():
    for q in (STAND, MOTION.end):
        scene = pk.Scene().add_robot("other", PEPPER, q, FACING)
        assert len(scene.objects) == len(PEPPER.collision_shapes)
        assert distance_of_scene(STAND, scene) == pytest.approx(distance_between(STAND, q, FACING), abs=2e-6)
        assert scene.movers == ()


def test_a_robot_moves_along_its_trajectory():
    """Before it begins and after it ends it stands; `at` and `times` agree, and so does coal."""
    scene = pk.Scene().add_robot("other", PEPPER, MOTION, FACING, begin=-0.2)
    nearest = {}
    for time in (0.0, 0.1, 0.2 + 0.3 * MOTION.duration, 0.2 + 0.7 * MOTION.duration, 3.0):
        other = MOTION(np.clip(time - 0.2, 0.0, MOTION.duration)).position
        nearest[time] = distance_between(STAND, other, FACING)
        assert distance_of_scene(STAND, scene, time) == pytest.approx(nearest[time], abs=2e-6)
        assert distance_of_scene(STAND, scene.at(time / 2), time / 2) == pytest.approx(
            nearest[time], abs=2e-6
        )
    assert nearest[0.0] - min(nearest.values()) > 0.1


@pytest.mark.thorough
def test_certificates_and_verdicts_count_where_it_is_then():
    other = pk.retime(PEPPER, [STAND, PEPPER.joint_vector({"RShoulderPitch": 0.0, "RElbowRoll": 0.1})])
    near = pk.pose((0.72, 0.0, 0.0), rpy=(0, 0, np.pi))
    scene = pk.Scene().add_robot("other", PEPPER, other, near, begin=-1.0)
    reach = pk.retime(PEPPER, [STAND, PEPPER.joint_vector({"LShoulderPitch": 0.0, "LElbowRoll": -0.1})])
    rows = {begin: reach.check(PEPPER, scene, start_time=begin) for begin in (0.0, 2.0)}
    for begin, found in rows.items():
        times = np.linspace(0.0, reach.duration, 40)
        touched = pk.collision.in_collision(PEPPER, reach(times).position, scene, times=begin + times)
        theirs = [
            distance_between(
                reach(t).position, other(np.clip(begin + t - 1.0, 0, other.duration)).position, near
            )
            <= 0
            for t in times
        ]
        assert touched.tolist() == theirs
        assert found.obstacle_clearance.success == (not any(theirs))
    assert rows[0.0].obstacle_clearance.success
    assert not rows[2.0].obstacle_clearance.success


@pytest.mark.thorough
def test_speed_bounds_hold_for_every_point():
    """Centers of shapes by finite differences; distances do not fall faster than `approach_speed` says."""
    scene = pk.Scene().add_robot("other", PEPPER, MOTION, FACING)
    times = np.arange(0.0, MOTION.duration, 1e-3)
    fastest = 0.0
    for item in scene.movers:
        fastest = max(
            fastest, np.linalg.norm(np.diff(item.poses(times)[:, :3, 3], axis=0), axis=1).max() / 1e-3
        )
    assert 0.2 < fastest <= scene.movers[0].speed
    rows = [least_clearance(PEPPER, STAND[None], scene, t).distance for t in times[::20]]
    assert np.abs(np.diff(rows)).max() / 0.02 <= approach_speed(PEPPER, np.zeros((1, PEPPER.n)), scene)


def test_a_driving_base_and_another_kind_of_robot():
    base = pk.load_pepper(base="planar")
    drive = pk.retime(base, [base.posture("Stand"), base.joint_vector({"BaseX": 0.5})])
    scene = pk.Scene().add_robot("other", base, drive, pk.pose((2.0, 0.0, 0.0)))
    for item in scene.movers:
        moved = item.at(drive.duration).transform_object_to_world - item.transform_object_to_world
        np.testing.assert_allclose(moved[:3, 3], (0.5, 0.0, 0.0), atol=1e-9)


def test_pickled_scenes_are_the_same_and_what_cannot_follow_a_path_says_so(tmp_path):
    scene = pk.Scene().add_robot("other", PEPPER, MOTION, FACING)
    again = pickle.loads(pickle.dumps(scene))
    for a, b in zip(scene.at(0.3).objects.values(), again.at(0.3).objects.values(), strict=True):
        np.testing.assert_array_equal(a.transform_object_to_world, b.transform_object_to_world)
    with pytest.raises(InvalidValueError, match="along a trajectory"):
        scene.save(tmp_path / "scene.json")
    with pytest.raises(InvalidValueError, match="along a trajectory"):
        World(PEPPER, scene)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.at(1.0, enlarged=False).standing.save(tmp_path / "standing.json")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("other", PEPPER, STAND[:3]), "q of 'other'"),
        (("other", "pepper", STAND), "a PepperModel"),
        (("other", PEPPER, STAND, np.ones((4, 4))), "pose of 'other'.*not rigid"),
        (("", PEPPER, STAND), "object name"),
        (("other", pk.load_pepper(base="planar"), MOTION), "joints of the motion of 'other'"),
    ],
)
def test_misuse_is_refused(arguments, message):
    with pytest.raises(InvalidValueError, match=message):
        pk.Scene().add_robot(*arguments)
