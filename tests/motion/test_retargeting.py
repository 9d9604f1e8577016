"""A person's motion on Pepper, made from motions of Pepper's own that are known."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.motion import KeyPoints, RetargetStatus, read_key_points, retarget
from pepper_kin.motion.key_points import SKELETONS
from pepper_kin.motion.retargeting import LIMBS

PEPPER = pk.load_pepper()
ARMS = [k for k, name in enumerate(PEPPER.joint_names) if name[1:].startswith(("Shoulder", "Elbow"))]
COLUMN = {name: k for k, name in enumerate(PEPPER.joint_names)}
PARTS = ("shoulder", "elbow", "wrist")


def rotation(yaw, tilt=0.0):
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(tilt), np.sin(tilt)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ turn


def wave(duration=4.0, sway=1.0):
    """Return a smooth motion of all joints but knee and wrists that touches nothing, over its own time."""
    stand = PEPPER.posture("Stand")
    wide = {"ShoulderPitch": 0.7, "ShoulderRoll": 0.7, "ElbowYaw": -1.0, "ElbowRoll": -0.9}
    keys = [{}, {}, {"HeadYaw": 0.5, "HeadPitch": -0.2, "HipPitch": -0.15 * sway, "HipRoll": 0.1 * sway}]
    for side, sign in (("L", 1), ("R", -1)):
        for name, value in wide.items():
            swap = 1 if name == "ShoulderPitch" else sign
            keys[1][side + name] = swap * value
            keys[2][side + name] = swap * (value + (0.35 if name == "ShoulderRoll" else -0.4 * (side == "L")))
    vectors = [np.where(np.arange(PEPPER.n) == COLUMN["KneePitch"], 0.0, stand)]
    vectors += [PEPPER.joint_vector({**key, "KneePitch": 0.0}) for key in keys[1:]]
    way = [vectors[0], vectors[1], vectors[2], vectors[1], vectors[2], vectors[0]]
    return pk.Trajectory.from_positions(PEPPER, np.linspace(0, duration, 6), way)


def person(motion, rate=30.0, size=(0.33, 0.27), turned=None):
    """Return key points: where Pepper's joints are, with the limbs of a person, walking and turned."""
    times = np.arange(round(motion.duration * rate) + 1) / rate
    q = motion(np.minimum(times, motion.duration)).position

    def pose(frame):
        return pk.kinematics.frame_pose(PEPPER, q, frame)

    torso, found = pose("torso"), {}
    for side, y in (("left", 1), ("right", -1)):
        letter = side[0].upper()
        found[f"{side}_hip"] = torso[:, :3, 3] + 0.1 * y * torso[:, :3, 1]
        found[f"{side}_shoulder"] = torso[:, :3, 3] + 0.19 * y * torso[:, :3, 1] + 0.5 * torso[:, :3, 2]
        chain = [pose(f"{letter}Shoulder"), pose(f"{letter}Elbow"), pose(f"{letter.lower()}_wrist")]
        for k in (0, 1):
            step = chain[k + 1][:, :3, 3] - chain[k][:, :3, 3]
            step *= size[k] / np.linalg.norm(step, axis=1, keepdims=True)
            found[f"{side}_{PARTS[k + 1]}"] = found[f"{side}_{PARTS[k]}"] + step
        head = pose("Head")
        found[f"{side}_ear"] = torso[:, :3, 3] + 0.7 * torso[:, :3, 2] + 0.08 * y * head[:, :3, 1]
    found["nose"] = 0.5 * (found["left_ear"] + found["right_ear"]) + 0.1 * head[:, :3, 0]
    points = np.stack(list(found.values()), axis=1)
    turn = np.eye(3) if turned is None else turned
    return KeyPoints(times, points @ turn.T + [0.3, 2.0, 1.0], tuple(found)), q


def limbs(q):
    """Return directions of the limbs in the torso from the places of joints, shape (T, 4, 3)."""
    torso, found = pk.kinematics.frame_pose(PEPPER, q, "torso")[:, :3, :3], []
    for letter in "LR":
        chain = [f"{letter}Shoulder", f"{letter}Elbow", f"{letter.lower()}_wrist"]
        place = [pk.kinematics.frame_pose(PEPPER, q, frame)[:, :3, 3] for frame in chain]
        found += [place[1] - place[0], place[2] - place[1]]
    directions = np.stack(found, axis=1) / np.linalg.norm(found, axis=2).T[:, :, None]
    return np.einsum("fji,fkj->fki", torso, directions)


def off(found, q, rate=30.0):
    """Return angles between limbs of a motion that was not slowed down and the true ones [degrees]."""
    times = np.arange(len(q)) / rate + found.times[1]
    attained = limbs(found.trajectory(times).position)
    return np.degrees(np.arccos(np.clip(np.sum(attained * limbs(q), axis=2), -1, 1)))


@pytest.mark.parametrize(("turn", "up"), [(rotation(0.0), (0, 0, 1)), (rotation(2.0, np.pi / 2), (0, -1, 0))])
def test_a_motion_of_the_robot_comes_back(turn, up):
    """The person is larger and stands elsewhere, in a world of which another axis is up."""
    motion = wave()
    points, q = person(motion, turned=turn)
    found = retarget(PEPPER, points, up=turn @ (0, 0, 1.0))
    np.testing.assert_allclose(turn @ (0, 0, 1.0), up, atol=1e-12)
    assert found.status is RetargetStatus.DONE, found.report()
    assert found.speed.min() > 0.99
    assert found.moved.max() == 0
    assert found.trajectory.check(PEPPER, pk.Scene()).success
    assert off(found, q).max() < 1.5
    attained = found.trajectory(np.arange(len(q)) / 30.0 + found.times[1]).position
    assert np.degrees(np.abs(attained - q)[:, ARMS]).max() < 4.0
    for name in ("HeadYaw", "HeadPitch", "HipPitch", "HipRoll"):
        np.testing.assert_allclose(attained[:, COLUMN[name]], q[:, COLUMN[name]], atol=0.02, err_msg=name)


def test_noise_and_points_that_are_not_seen_are_survived():
    points, q = person(wave())
    generator = np.random.default_rng(0)
    place = points.points + generator.normal(0.0, 0.01, points.points.shape)
    place[generator.random(place.shape[:2]) < 0.2] = np.nan
    place[60:75, points.names.index("left_wrist")] = np.nan  # half a second at once
    found = retarget(PEPPER, place, points.times, points.names, smoothing=0.08)
    assert found.success, found.report()
    assert 0.19 < found.filled < 0.25
    assert "not seen, and filled in" in found.report()
    at = found.times[1] + np.interp(np.arange(len(q)) / 30.0, found.times, np.concatenate([[0], np.cumsum(
        np.diff(found.times) / (0.5 * (found.speed[1:] + found.speed[:-1])))]))  # fmt: skip
    attained = limbs(found.trajectory(np.minimum(at, found.trajectory.duration)).position)
    error = np.degrees(np.arccos(np.clip(np.sum(attained * limbs(q), axis=2), -1, 1)))
    assert np.median(error) < 3.0
    assert np.quantile(error, 0.95) < 12.0
    assert np.isnan(found.errors[:, LIMBS.index("left_forearm")]).sum() > 20


def test_a_motion_too_fast_is_slowed_down_where_it_is_too_fast():
    slow, _ = person(wave())
    fast = KeyPoints(slow.times / 4, slow.points, slow.names)
    found = retarget(PEPPER, fast, smoothing=0)
    assert found.success, found.report()
    assert found.trajectory.duration > 1.1 * fast.times[-1]
    assert 0.1 < found.speed.min() < 0.9
    assert "slowed down to" in found.report()
    shares = np.abs(found.trajectory.sample(0.002).velocity) / PEPPER.velocity_limits
    assert shares.max() <= 1.0


def test_what_no_joint_can_do_is_clipped_and_named():
    """An arm that points backwards and up, for a second."""
    points, _ = person(wave(sway=0.0))
    place = points.points.copy()
    k = {name: points.names.index(name) for name in ("left_shoulder", "left_elbow", "left_wrist")}
    direction = np.array([-0.6, -0.5, 0.6]) / np.linalg.norm([-0.6, -0.5, 0.6])
    place[45:75, k["left_elbow"]] = place[45:75, k["left_shoulder"]] + 0.33 * direction
    place[45:75, k["left_wrist"]] = place[45:75, k["left_elbow"]] + 0.27 * direction
    found = retarget(PEPPER, place, points.times, points.names)
    assert found.success, found.report()
    bad = found.clipped[:, 0]
    assert bad[(found.times > 1.6) & (found.times < 2.4)].all()
    assert not bad[(found.times < 1.0) | (found.times > 3.2)].any()
    assert not found.clipped[:, 2:].any()
    assert "left upper arm" in found.report()
    assert "over 5 from 1." in found.report()
    assert np.all(found.trajectory.sample(0.01).position <= PEPPER.upper_limits + 1e-9)


def test_hands_through_the_body_are_moved_clear():
    points, _ = person(wave(sway=0.0))
    place = points.points.copy()
    middle = 0.5 * (place[:, 0] + place[:, points.names.index("right_hip")])
    for name in ("left_wrist", "right_wrist"):
        j = points.names.index(name)
        place[50:80, j] = middle[50:80] + np.array([0.0, 0.0, 0.3])  # inside of the chest
    found = retarget(PEPPER, place, points.times, points.names)
    assert found.success, found.report()
    assert found.moved.max() > 0.1
    assert found.moved[found.times < 0.8].max() == 0
    assert "moved clear of contact" in found.report()
    assert not pk.collision.in_collision(PEPPER, found.trajectory.sample(0.01).position).any()


def test_reasons_where_there_is_no_motion():
    points, _ = person(wave())
    place = points.points.copy()
    place[:, points.names.index("left_elbow")] = np.nan
    found = retarget(PEPPER, place, points.times, points.names)
    assert found.status is RetargetStatus.NOT_SEEN
    assert "left_elbow is seen in 0 %" in found.report()
    wall = pk.Scene().add_box("wall", (0.5, 2.0, 0.1), (0.0, 0.0, 1.1))
    found = retarget(PEPPER, points, scene=wall)
    assert found.status is RetargetStatus.IN_COLLISION
    assert found.trajectory is None


def test_misuse_is_refused_by_name():
    points, _ = person(wave())
    with pytest.raises(InvalidValueError, match="times and names"):
        retarget(PEPPER, points.points)
    with pytest.raises(InvalidValueError, match="up"):
        retarget(PEPPER, points, up=(0, 0, 0))
    with pytest.raises(UnknownNameError, match="coco, human36m, mediapipe"):
        KeyPoints(30.0, points.points, "smpl")
    with pytest.raises(UnknownNameError, match="unknown key point"):
        retarget(PEPPER, KeyPoints(30.0, points.points[:, :2], ("left_hip", "nose")))
    with pytest.raises(InvalidValueError, match="times"):
        KeyPoints(points.times[::-1], points.points, points.names)
    with pytest.raises(InvalidValueError, match="17 different names"):
        KeyPoints(30.0, np.zeros((3, 17, 3)), ("nose",))


def test_files_are_read_as_they_were_written(tmp_path):
    points, _ = person(wave())
    place = points.points.copy()
    place[3, 2] = np.nan
    np.savez(tmp_path / "a.npz", points=place, names=np.array(points.names), times=points.times)
    columns = [f"{name}.{axis}" for name in points.names for axis in "xyz"]
    rows = np.column_stack([points.times, place.reshape(len(place), -1)])
    lines = [",".join(["time", *columns]), *(",".join(map(repr, row.tolist())) for row in rows)]
    (tmp_path / "a.csv").write_text("\n".join(lines).replace("nan", "") + "\n")
    for name in ("a.npz", "a.csv"):
        read = read_key_points(tmp_path / name)
        np.testing.assert_array_equal(read.points, place)
        np.testing.assert_array_equal(read.times, points.times)
        assert read.names == points.names
    np.savez(tmp_path / "b.npz", points=np.zeros((4, 17, 3)))
    read = read_key_points(tmp_path / "b.npz", names="coco", rate=50.0)
    assert read.names == SKELETONS["coco"]
    assert read.times[-1] == pytest.approx(0.06)
    with pytest.raises(FileFormatError, match="has no names"):
        read_key_points(tmp_path / "b.npz")
    (tmp_path / "c.csv").write_text("time,nose.x,nose.y\n0,1,2\n1,1,2\n")
    with pytest.raises(FileFormatError, match="x, y and z of each point"):
        read_key_points(tmp_path / "c.csv")


@pytest.mark.parametrize(
    ("written", "plain"),
    [
        ("LShoulder", "left_shoulder"),
        ("RIGHT_WRIST", "right_wrist"),
        ("left elbow", "left_elbow"),
        ("Nose", "nose"),
    ],
)
def test_names_are_known_however_they_are_written(written, plain):
    assert KeyPoints(30.0, np.zeros((2, 1, 3)), (written,)).names == (plain,)


def test_the_motion_is_exported(tmp_path):
    found = retarget(PEPPER, person(wave())[0])
    for ending in ("csv", "npz", "json"):
        path = tmp_path / f"motion.{ending}"
        pk.files.save(found.trajectory, path, pepper=PEPPER)
        assert pk.files.load(path).duration == pytest.approx(found.trajectory.duration, abs=0.02)
