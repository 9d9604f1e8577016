"""Obstacles that move: coal, asked about each scene as it is at its time, is the oracle."""

import dataclasses
import pickle

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker, approach_speed, in_collision, least_clearance
from pepper_kin.collision.movers import movers_of
from pepper_kin.exceptions import InvalidValueError

GOAL = {"LShoulderPitch": 0.2, "LElbowRoll": -1.0, "RShoulderRoll": -0.4, "HeadYaw": -0.5}


def crossing(rng, uncertainties, **more):
    """A scene of boxes, balls and bars in front of the robot, each on its way, over a floor."""
    floor = ("Tibia", "WheelB_link", "WheelFL_link", "WheelFR_link")
    scene = pk.Scene().add_half_space("floor", (0, 0, 1)).allow("floor", *floor)
    for k, uncertainty in enumerate(uncertainties):
        place, turn = rng.uniform((0.3, -0.6, 0.4), (0.9, 0.6, 1.3)), rng.normal(size=3)
        motion = {"velocity": rng.uniform(-0.4, 0.4, 3), "uncertainty": uncertainty}
        size = rng.uniform(0.08, 0.24, 3)
        match k % 4:
            case 0:
                scene = scene.add_box(f"mover {k}", size, place, turn, **motion)
            case 1:
                scene = scene.add_sphere(f"mover {k}", size[0] / 2, place, **motion)
            case 2:
                scene = scene.add_capsule(f"mover {k}", size[0] / 2, size[1], place, turn, **motion)
            case 3:
                scene = scene.add_point_cloud(
                    f"mover {k}", rng.normal(0, 0.1, (200, 3)), 0.02, place, **motion
                )
    return scene


@pytest.mark.thorough
@pytest.mark.parametrize("robot", ["fixed", "planar"])
def test_verdicts_at_times_are_coals_of_the_scene_then(robot):
    pepper, rng, touching = pk.load_pepper(base=robot), np.random.default_rng(0), 0
    low, high = np.maximum(0.3 * pepper.lower_limits, -0.3), np.minimum(0.3 * pepper.upper_limits, 0.3)
    for _ in range(6):
        scene, times = crossing(rng, np.zeros(8)), rng.uniform(0.0, 2.0, 40)
        q = rng.uniform(low, high, (40, pepper.n))
        coal = [CollisionChecker(pepper, scene.at(t)).in_collision(x) for x, t in zip(q, times, strict=True)]
        assert in_collision(pepper, q, scene, times).tolist() == np.array(coal).tolist()
        assert in_collision(pepper, q[0], scene, times[0]) == coal[0]
        assert (
            in_collision(pepper, q, scene).tolist()
            == CollisionChecker(pepper, scene).in_collision(q).tolist()
        )
        touching += sum(coal)
        walled = scene.add_box("wall", (1.0, 1.0, 1.0), (0.0, 0.0, 0.8))
        assert in_collision(pepper, q, walled, times).all()
    assert 40 < touching < 200
    assert in_collision(pepper, q[:0], scene, 1.0).shape == (0,)


def distance_kept(pepper, q, scene, time):
    """The least distance by coal, less what each obstacle's uncertainty has grown by, and to what stands."""
    least = float(pk.collision.clearance(pepper, q, scene.standing))
    for item in scene.movers:
        there = dataclasses.replace(item, uncertainty=0.0).at(time)
        alone = pk.Scene({item.name: dataclasses.replace(there, velocity=np.zeros(3))})
        pairs = pk.collision.near_pairs(pepper, q, 5.0, alone)
        apart = [d for d, names in zip(pairs.distances, pairs.names, strict=True) if item.name in names]
        least = min(least, min(apart) - item.uncertainty * time)
    return least


@pytest.mark.thorough
@pytest.mark.parametrize("uncertainties", [np.full(4, 0.1), np.array([0.0, 0.3, 0.1, 0.2])])
def test_distances_lose_what_uncertainty_has_grown_by(pepper, uncertainties):
    rng = np.random.default_rng(1)
    motion = pk.retime(pepper, [pepper.posture("Stand"), pepper.joint_vector(GOAL)])
    times = np.linspace(0.0, motion.duration, 40)
    q = motion(times).position
    for _ in range(3):
        scene = crossing(rng, uncertainties)
        wanted = np.array([distance_kept(pepper, x, scene, t) for x, t in zip(q, times, strict=True)])
        found = least_clearance(pepper, q, scene, times)
        assert found.distance == pytest.approx(wanted.min(), abs=1e-5)
        assert wanted[found.index] == pytest.approx(wanted.min(), abs=1e-5)
        sure = np.abs(wanted) > 1e-5
        assert (in_collision(pepper, q, scene, times) == (wanted < 0))[sure].all()
        speed = approach_speed(pepper, np.abs(motion(times).velocity), scene)
        assert np.abs(np.diff(wanted)).max() <= speed * times[1] + 1e-5


def test_a_certificate_looks_at_its_own_times(pepper):
    stand = pepper.posture("Stand")
    motion = pk.retime(pepper, [stand, pepper.joint_vector(GOAL)])
    scene = pk.Scene().add_sphere("ball", 0.1, (2.0, 0.0, 0.9), velocity=(-1.0, 0.0, 0.0))
    assert motion.check(pepper, scene).success
    late = motion.check(pepper, scene, start_time=1.6)
    assert set(late.failures) == {"obstacle_clearance"}
    assert "ball" in late.report()
    assert motion.check(pepper, scene.at(1.6)).obstacle_clearance.value == pytest.approx(
        late.obstacle_clearance.value
    )
    with pytest.raises(InvalidValueError, match="start_time"):
        motion.check(pepper, scene, start_time=-1.0)


def test_what_a_hand_holds_is_met_too(pepper):
    q = pepper.posture("Stand")
    hand = pk.kinematics.frame_pose(pepper, q, "r_gripper")
    scene = pk.Scene().add_box("stick", (0.6, 0.02, 0.02), hand[:3, 3])
    scene = scene.attach("stick", "r_gripper", pepper=pepper, q=q, touch_links=pepper.link_names)
    beside = hand[:3, 3] + np.array([0.28, -1.0, 0.0])
    scene = scene.add_sphere("ball", 0.03, beside, velocity=(0.0, 1.0, 0.0))
    assert in_collision(pepper, np.tile(q, (3, 1)), scene, [0.0, 1.0, 2.0]).tolist() == [False, True, False]
    assert not in_collision(pepper, q, scene.allow("ball", "stick"), 1.0)


def test_scenes_later_moved_and_stored(tmp_path):
    scene = crossing(np.random.default_rng(2), np.array([0.0, 0.1, 0.0, 0.2]))
    later = scene.at(2.0)
    for item, then in zip(scene.movers, later.movers, strict=True):
        assert then.transform_object_to_world[:3, 3] == pytest.approx(
            item.transform_object_to_world[:3, 3] + 2.0 * item.velocity
        )
    assert later.objects["mover 1"].geometry.radius == scene.objects["mover 1"].geometry.radius + 0.2
    scene.save(tmp_path / "scene.json")
    assert pk.Scene.load(tmp_path / "scene.json").equals(scene)
    assert pickle.loads(pickle.dumps(scene)).equals(scene)
    assert scene.standing.names == ("floor",)
    there = scene.moved(
        {"mover 0": (1.0, 0.0, 1.0)}, {"mover 0": (0.0, 0.1, 0.0), "mover 1": (0.0, 0.0, 0.0)}
    )
    assert there.objects["mover 0"].velocity.tolist() == [0.0, 0.1, 0.0]
    assert there.standing is scene.standing


def test_a_hundred_obstacles_are_compared_as_few_are(pepper):
    rng, q = np.random.default_rng(3), pepper.posture("Stand")
    scene, times = crossing(rng, np.zeros(100)), np.array([0.0, 1.0, 3.0])
    far = scene.moved({item.name: (0.0, 0.0, 5.0 + k) for k, item in enumerate(scene.movers)})
    last = far.movers[-1].name
    for world in (scene, far.moved({last: (0.3, -1.0, 0.8)}, {last: (0.0, 0.5, 0.0)})):
        coal = [CollisionChecker(pepper, world.at(t)).in_collision(q) for t in times]
        assert in_collision(pepper, np.tile(q, (3, 1)), world, times).tolist() == np.array(coal).tolist()
        apart = [float(pk.collision.clearance(pepper, q, world.at(t), to="obstacles")) for t in times]
        found = least_clearance(pepper, np.tile(q, (3, 1)), world, times, to="obstacles")
        assert found.distance == pytest.approx(min(apart), abs=1e-5)
    assert last in found.pair.names


def test_memory_grows_with_the_number_of_obstacles_and_not_with_its_powers(pepper):
    rng, sizes = np.random.default_rng(4), {}
    for count in (24, 240):
        groups = movers_of(pepper, crossing(rng, np.zeros(count)))
        assert [item.name for group in groups for item in group.items] == [f"mover {k}" for k in range(count)]
        assert max(group.columns.size for group in groups) < 5 * pepper.n
        sizes[count] = sum(group.robot.pinocchio_model.nv**3 for group in groups)
    assert sizes[240] == 10 * sizes[24]


def test_what_is_refused(pepper):
    q = pepper.posture("Stand")
    scene = pk.Scene().add_sphere("ball", 0.1, (2.0, 0.0, 0.9), velocity=(-1.0, 0.0, 0.0))
    with pytest.raises(InvalidValueError, match="velocity of 'ball'"):
        pk.Scene().add_sphere("ball", 0.1, (2.0, 0.0, 0.9), velocity=(np.nan, 0.0, 0.0))
    with pytest.raises(InvalidValueError, match="uncertainty of 'ball'"):
        pk.Scene().add_sphere("ball", 0.1, (2.0, 0.0, 0.9), uncertainty=-0.1)
    with pytest.raises(InvalidValueError, match="a half-space"):
        pk.Scene().add("wall", pk.collision.HalfSpace(), velocity=(1.0, 0.0, 0.0))
    with pytest.raises(InvalidValueError, match="times"):
        in_collision(pepper, q, scene, -0.1)
    for time in (-1.0, np.inf, 1e12):
        with pytest.raises(InvalidValueError):
            scene.at(time)
