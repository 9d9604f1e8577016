import inspect
import sys

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import kinematics
from pepper_kin.collision.fast import FastChecker
from pepper_kin.exceptions import FileFormatError, InvalidValueError, MissingDependencyError, UnknownNameError
from pepper_kin.kinematics.reach_map import CHUNK, ReachMap, reach_map
from pepper_kin.kinematics.reach_picture import save_reach_picture

LEFT, RIGHT = "LArm_effector", "RArm_effector"


@pytest.fixture(scope="module")
def arm_map(pepper):
    return reach_map(pepper, LEFT, joints="left_arm", samples=200_000, resolution=0.1)


def postures(pepper, joints, count, seed):
    q = np.tile(pepper.neutral(), (count, 1))
    columns = [pepper.joint_index(name) for name in joints]
    rng = np.random.default_rng(seed)
    q[:, columns] = rng.uniform(
        pepper.lower_limits[columns], pepper.upper_limits[columns], (count, len(columns))
    )
    return q


def test_every_sample_is_counted_where_forward_kinematics_puts_it(pepper):
    """The map's own postures, drawn again, and counted by another way."""
    arm = pepper.joint_group("left_arm")
    found = reach_map(pepper, LEFT, joints=arm, samples=300, resolution=0.07, seed=5)
    points = kinematics.frame_poses(pepper, postures(pepper, arm, 300, 5), (LEFT,))[:, 0, :3, 3]
    assert found.contains(points).all()
    edges = [found.origin[k] + 0.07 * np.arange(found.counts.shape[k] + 1) for k in range(3)]
    counts, _ = np.histogramdd(points, bins=edges)
    np.testing.assert_array_equal(found.counts, counts)
    assert found.counts.sum() == found.samples == 300
    for face in range(3):
        assert found.counts.take(0, face).any()
        assert found.counts.take(-1, face).any()


def test_best_is_the_largest_manipulability(pepper):
    arm = pepper.joint_group("left_arm")
    found = reach_map(pepper, LEFT, joints=arm, samples=50, resolution=10.0, seed=1)
    q = postures(pepper, arm, 50, 1)
    expected = kinematics.manipulability(pepper, q, LEFT, joints=arm)
    points = kinematics.frame_pose(pepper, q, LEFT)[:, :3, 3]
    for corner in np.argwhere(found.counts > 0):
        here = (np.floor(points / 10.0) == corner + np.round(found.origin / 10)).all(axis=1)
        assert found.best[tuple(corner)] == pytest.approx(expected[here].max(), rel=1e-5)


def test_targets_of_other_postures_are_contained(pepper, arm_map):
    points = kinematics.frame_pose(pepper, postures(pepper, arm_map.joints, 5000, 99), LEFT)[:, :3, 3]
    assert arm_map.contains(points).mean() > 0.999
    assert not arm_map.contains(points + np.array([2.0, 0, 0])).any()
    assert not arm_map.contains(points - [0, 0, 5.0]).any()
    assert arm_map.contains(points[0]).shape == ()
    assert arm_map.contains(points.reshape(50, 100, 3)).shape == (50, 100)
    assert arm_map.contains(np.zeros((0, 3))).shape == (0,)


def test_left_and_right_reach_alike(pepper, arm_map):
    other = reach_map(pepper, RIGHT, joints="right_arm", samples=200_000, resolution=0.1)
    assert other.volume == pytest.approx(arm_map.volume, rel=0.05)
    mirrored = arm_map.centers * [1, -1, 1]
    assert other.contains(mirrored).mean() > 0.9


def test_the_torso_adds_reach(pepper, arm_map):
    joints = (*pepper.joint_group("torso"), *pepper.joint_group("left_arm"))
    more = reach_map(pepper, LEFT, joints=joints, samples=200_000, resolution=0.1)
    assert more.contains(arm_map.centers).mean() > 0.97
    assert more.volume > 2 * arm_map.volume


def test_a_turning_base_makes_a_ring():
    """All around the vertical axis there is reach alike: each half of the map holds half of the samples."""
    planar = pk.load_pepper(base="planar")
    found = reach_map(planar, LEFT, joints=("BaseYaw", "LShoulderPitch"), samples=40_000, resolution=0.1)
    x, y = (found.centers[:, k] for k in range(2))
    counts = found.counts[found.counts > 0]
    for side in (x > 0, x < 0, y > 0, y < 0):
        assert counts[side].sum() == pytest.approx(20_000, rel=0.05)


def test_seeds_and_chunks(pepper):
    calls = []
    arguments = {"joints": "left_arm", "samples": 2 * CHUNK + 10, "resolution": 0.1}
    one = reach_map(pepper, LEFT, seed=3, progress=calls.append, **arguments)
    same = reach_map(pepper, LEFT, seed=3, **arguments)
    other = reach_map(pepper, LEFT, seed=4, **arguments)
    np.testing.assert_array_equal(one.counts, same.counts)
    np.testing.assert_array_equal(one.best, same.best)
    assert one.counts.shape != other.counts.shape or (one.counts != other.counts).any()
    assert one.counts.sum() == 2 * CHUNK + 10
    assert calls == sorted(calls)
    assert len(calls) == 3
    assert calls[-1] == 1.0


def test_a_map_survives_its_file(arm_map, tmp_path):
    path = arm_map.save(tmp_path / "map.npz")
    read = ReachMap.load(path)
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]
    for field in ReachMap.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(read, field), getattr(arm_map, field))
    assert read.volume == arm_map.volume
    with pytest.raises(ValueError, match="read-only"):
        read.counts[0, 0, 0] = 1


def test_files_that_are_none_are_refused(arm_map, tmp_path):
    good = arm_map.save(tmp_path / "good.npz").read_bytes()
    (tmp_path / "text.npz").write_text("no map")
    (tmp_path / "cut.npz").write_bytes(good[: len(good) // 2])
    (tmp_path / "empty.npz").write_bytes(b"")
    np.savez(tmp_path / "other.npz", counts=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    for name in ("text.npz", "cut.npz", "empty.npz", "other.npz", "array.npy", "missing.npz"):
        with pytest.raises(FileFormatError) as caught:
            ReachMap.load(tmp_path / name)
        assert name in str(caught.value)
    with pytest.raises(FileFormatError, match="cannot be written"):
        arm_map.save(tmp_path / "no folder" / "map.npz")


def test_misuse_is_named(pepper):
    for arguments, error, message in [
        ({"frame": "nose"}, UnknownNameError, "unknown frame 'nose'"),
        ({"joints": "tail"}, UnknownNameError, "unknown joint or group 'tail'"),
        ({"joints": ("LElbowRoll", "tail")}, UnknownNameError, "unknown joint or group 'tail'"),
        ({"joints": ()}, InvalidValueError, "joints: got .*at least one moving joint"),
        ({"samples": 0}, InvalidValueError, "samples: got 0, expected an integer of at least 1"),
        ({"samples": 1e6}, InvalidValueError, "samples: got 1000000.0, expected an integer"),
        ({"seed": -1}, InvalidValueError, "seed: got -1"),
        ({"resolution": 0.0}, InvalidValueError, "resolution: got 0.0, expected a finite number above 0 m"),
        ({"resolution": np.nan}, InvalidValueError, "resolution: got nan"),
    ]:
        with pytest.raises(error, match=message):
            reach_map(pepper, **{"frame": LEFT, "samples": 10, **arguments})


def test_only_postures_free_of_collisions_count(pepper):
    """By the fast checker as the docstring has it; the oracle is coal on the same postures, counted apart."""
    scene = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.45, 0.1, 0.8))
    checker = FastChecker(pepper, scene)
    found = pk.kinematics.reach_map(
        pepper, LEFT, joints="left_arm", samples=2000, resolution=0.1, seed=4,
        valid=lambda q: ~checker.in_collision(q),
    )  # fmt: skip
    q = postures(pepper, pepper.joint_group("left_arm"), 2000, 4)
    free = ~pk.collision.in_collision(pepper, q, scene)
    assert 100 < free.sum() < 1900
    points = kinematics.frame_pose(pepper, q[free], LEFT)[:, :3, 3]
    edges = [found.origin[k] + 0.1 * np.arange(found.counts.shape[k] + 1) for k in range(3)]
    np.testing.assert_array_equal(found.counts, np.histogramdd(points, bins=edges)[0])
    assert found.counts.sum() == free.sum()
    assert found.samples == 2000
    assert f"{free.sum()} of 2000 postures counted" in found.report()
    assert "left out" not in found.report()


def test_a_report_says_that_postures_which_touch_count(arm_map):
    assert "no posture was left out: without valid= those in self-collision" in arm_map.report()


def test_what_valid_may_not_answer(pepper):
    for valid in (lambda q: np.ones(3, dtype=bool), lambda q: np.ones(len(q)), lambda q: True):
        with pytest.raises(InvalidValueError, match=r"result of valid: got .*booleans of shape \(10,\)"):
            reach_map(pepper, LEFT, samples=10, valid=valid)
    with pytest.raises(InvalidValueError, match="valid: got none of 10 postures"):
        reach_map(pepper, LEFT, samples=10, valid=lambda q: np.zeros(len(q), dtype=bool))


@pytest.mark.parametrize("resolution", [1e-3, 1e-6, 1e-12, 1e-300])
def test_a_grid_that_no_memory_holds_is_refused_with_one_that_fits(pepper, resolution, monkeypatch):
    words = r"resolution: got .* {} voxels, such as 0\.0\d+ m"
    with pytest.raises(InvalidValueError, match=words.format(40_000_000)):
        reach_map(pepper, LEFT, samples=1000, resolution=resolution)
    # The one that fits takes 0.5 GB with so many voxels: here fewer are allowed.
    monkeypatch.setattr(inspect.getmodule(reach_map), "MOST_VOXELS", 400_000)
    with pytest.raises(InvalidValueError, match=words.format(400_000)) as error:
        reach_map(pepper, LEFT, samples=1000, resolution=resolution)
    enough = float(str(error.value).split()[-2])
    assert 40_000 < reach_map(pepper, LEFT, samples=1000, resolution=enough).counts.size <= 400_000


def test_the_name_is_the_functions_however_it_is_imported():
    import pepper_kin.kinematics.reach_map  # noqa: F401

    assert pk.kinematics.reach_map is reach_map
    assert pk.kinematics.ReachMap is ReachMap


def test_points_that_are_none_are_refused(arm_map):
    for points in [1.0, [1, 2], "abc", [np.nan, 0, 0], None]:
        with pytest.raises(InvalidValueError, match="points: got"):
            arm_map.contains(points)


@pytest.mark.thorough
def test_the_picture_is_a_png(arm_map, tmp_path):
    path = save_reach_picture({"left": arm_map, "again": arm_map}, tmp_path / "reach.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 10_000
    with pytest.raises(InvalidValueError, match=r"maps: got \{\}, expected at least one map"):
        save_reach_picture({}, path)


def test_a_map_draws_and_reports_itself(arm_map, tmp_path):
    path = arm_map.plot(tmp_path / "one.png", "arm alone")
    assert path.read_bytes().startswith(b"\x89PNG")
    text = arm_map.report()
    low = arm_map.centers.min(axis=0)
    assert f"x {low[0]:.2f} to" in text
    assert f"{arm_map.volume:.3g} m^3" in text
    assert f"{arm_map.counts.sum()} of {arm_map.samples} postures" in text
    best = arm_map.centers[np.argmax(arm_map.best[arm_map.counts > 0])]
    assert f"at ({best[0]:.2f}, {best[1]:.2f}, {best[2]:.2f})" in text


def test_without_matplotlib_the_command_is_named(arm_map, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "pepper_kin\[plot\]"'):
        arm_map.plot(tmp_path / "reach.png")
