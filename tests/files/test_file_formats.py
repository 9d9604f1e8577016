"""Every file format: round trips to 1e-9, what other programs see in it, and each way a file can be wrong."""

import functools
import json
import os
import runpy
import sys
import types

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.files import load, naoqi_arguments
from pepper_kin.files.formats import FORMATS
from pepper_kin.plugins import plugins
from pepper_kin.trajectory import Trajectory

save = functools.partial(pk.files.save, unchecked=True)  # the motions here are of no robot

SUFFIXES = (".csv", ".parquet", ".npz", ".json", ".yaml", ".py", ".mcap")
STEP = 0.013


def short():
    """Two joints, 0.02 s, values that need all digits, small ones among them."""
    coefficients = np.array([[[0.1, -1e-5], [1 / 3, 2e-7]], [[0.1 + 0.01 / 3, 1 / 7], [0.0, 1e-300]]])
    return Trajectory(("A", "B"), [0.0, 0.01, 0.02], coefficients)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_round_trip(pepper, trajectory, tmp_path, suffix):
    path = save(trajectory, tmp_path / f"motion{suffix}", dt=STEP)
    time = np.minimum(np.round(trajectory.sample(STEP).time, 9), trajectory.duration)
    for again in (load(path), load(path, pepper=pepper)):
        assert again.joint_names == trajectory.joint_names
        assert again.duration == pytest.approx(trajectory.duration, abs=1e-9)
        at = np.minimum(time, again.duration)
        ours, theirs = again(at), trajectory(np.minimum(at, trajectory.duration))
        np.testing.assert_allclose(ours.position, theirs.position, atol=1e-9)
        # At the end, which is rounded to a nanosecond, the velocity is zero.
        np.testing.assert_allclose(ours.velocity, theirs.velocity, atol=1e-8)
        if suffix in (".npz", ".json"):
            assert again == trajectory
            np.testing.assert_array_equal(again.coefficients, trajectory.coefficients)
    again = load(path, pepper=pepper)
    between = np.linspace(0, min(again.duration, trajectory.duration), 997)
    np.testing.assert_allclose(again(between).position, trajectory(between).position, atol=3e-4)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_small_and_awkward_numbers(tmp_path, suffix):
    saved = short()
    again = load(save(saved, tmp_path / f"motion{suffix}", dt=0.005))
    for t in (0.0, 0.005, 0.015, 0.02):
        np.testing.assert_allclose(again(t).position, saved(t).position, atol=1e-9, rtol=0)


@pytest.mark.parametrize("suffix", [".npz", ".json", ".yaml", ".mcap", ".csv"])
def test_meters_come_back_with_the_robot(tmp_path, suffix):
    pepper = pk.load_pepper(base="planar")
    q = pepper.posture("Stand")
    saved = Trajectory(pepper.joint_names, [0, 1], np.array([[q, 0.1 + 0 * q]]), pepper.joint_units)
    again = load(save(saved, tmp_path / f"motion{suffix}"), pepper=pepper)
    assert again == saved
    assert "m" in again.joint_units


def test_a_format_may_be_named(tmp_path):
    saved = short()
    path = save(saved, tmp_path / "motion.txt", format="json")
    assert load(path, format="json") == saved
    assert {*FORMATS, *plugins("formats")} == {"csv", "parquet", "npz", "json", "ros", "naoqi", "mcap"}


def test_unknown_formats_are_refused(tmp_path):
    with pytest.raises(
        UnknownNameError, match=r"unknown suffix '.xls'; available: .csv, .parquet, .npz, .json"
    ):
        save(short(), tmp_path / "motion.xls")
    with pytest.raises(UnknownNameError, match="unknown format 'xls'; available: csv, parquet"):
        load(tmp_path / "motion.csv", format="xls")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_files_and_folders(tmp_path, suffix):
    with pytest.raises(FileFormatError, match="cannot be read: No such file"):
        load(tmp_path / f"none{suffix}")
    with pytest.raises(FileFormatError, match="cannot be written"):
        save(short(), tmp_path / "no" / f"folder{suffix}")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_writing_is_whole_or_not_at_all(tmp_path, suffix, monkeypatch):
    path = save(short(), tmp_path / f"motion{suffix}")
    before = path.read_bytes()

    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(FileFormatError, match="No space left"):
        save(short(), path, dt=0.002)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir() if p.suffix == ".part"] == []


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_truncation_is_refused(tmp_path, suffix):
    path = save(short(), tmp_path / f"motion{suffix}")
    whole = path.read_bytes()
    if suffix == ".py":  # what follows the lists is no part of the motion
        whole = whole[: whole.index(b"\n]\n\n\ndef keys") + 3]
    cut = tmp_path / f"cut{suffix}"
    places = np.unique(np.linspace(0, len(whole) - 2, 60).astype(int))
    for place in places:
        cut.write_bytes(whole[:place])
        with pytest.raises(FileFormatError) as caught:
            load(cut)
        assert str(cut) in str(caught.value)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_foreign_files_are_refused(tmp_path, suffix):
    path = tmp_path / f"foreign{suffix}"
    for content in (b"", b"hello\n", bytes(range(256)), b"[1, 2]\n", b"{}\n"):
        path.write_bytes(content)
        with pytest.raises(FileFormatError):
            load(path)


@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_damaged_bytes_are_refused_or_harmless(tmp_path, suffix):
    path = save(short(), tmp_path / f"motion{suffix}")
    saved = load(path)
    whole = bytearray(path.read_bytes())
    rng = np.random.default_rng(0)
    refused = 0
    for place in rng.choice(len(whole), 60, replace=False):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        try:
            again = load(path)
        except FileFormatError:
            refused += 1
        else:
            assert again(0.005).position == pytest.approx(saved(0.005).position, abs=1e-9)
    assert refused > 10


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_other_joints_are_named(pepper, trajectory, tmp_path, suffix):
    swapped = list(trajectory.joint_names)
    swapped[0], swapped[1] = swapped[1], swapped[0]
    cases = [
        (tuple(swapped), "in another order: 'HipPitch' where 'KneePitch'"),
        (("Tail", *trajectory.joint_names[1:]), "Tail"),
    ]
    for names, message in cases:
        other = Trajectory(names, trajectory.breaks, trajectory.coefficients)
        path = save(other, tmp_path / f"other{suffix}", dt=0.1)
        with pytest.raises(FileFormatError) as caught:
            load(path, pepper=pepper)
        wanted = (
            "HipPitch.position' where 'KneePitch.position'"
            if suffix in (".csv", ".parquet") and "Hip" in message
            else message
        )
        assert wanted in str(caught.value)
    fewer = Trajectory(trajectory.joint_names[:-1], trajectory.breaks, trajectory.coefficients[..., :-1])
    path = save(fewer, tmp_path / f"fewer{suffix}", dt=0.1)
    with pytest.raises(FileFormatError, match=r"RWristYaw.* is missing|RWristYaw.*missing"):
        load(path, pepper=pepper)


def refused(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))
    with pytest.raises(FileFormatError) as caught:
        load(path)
    return caught.value


def test_wrong_json(tmp_path):
    for old, new, line, message in [
        ("1e-300", "NaN", 9, "holds NaN, expected finite numbers"),
        ("1e-300", "1e999", 9, "holds 1e999"),
        ("0.01, 0.02]", "0.02, 0.01]", None, "breaks: got"),
        ('"A", "B"', '"A", "A"', 4, "joint 'A' occurs twice"),
        ('"A", "B"', '"A", 3', 4, "joint name 2 is 3, expected a text"),
        ('"A", "B"', "", 4, "contains no joint name"),
        ('"version": 1', '"version": 2', None, "version is 2, expected 1"),
        ("pepper_kin.trajectory", "other", 1, 'it lacks "format"'),
        ('"breaks"', '"broken"', None, "field 'breaks' is missing"),
        ('"version": 1', '"version": 1, "color": 2', 3, "unknown field 'color'"),
        ('"version": 1', '"version": 1, "version": 1', 3, "field 'version' occurs twice"),
        ("1e-300", "1e-300,", 9, "is not complete JSON"),
        ("1e-300]", "1e-300, 0]", None, "coefficients: got"),
        ("1e-300", '"x"', None, "coefficients: got"),
        ('["rad", "rad"]', '["rad", "inch"]', None, "joint_units"),
        ('["rad", "rad"]', "7", 5, "joint_units is not a list"),
    ]:
        error = refused(save(short(), tmp_path / "motion.json"), old, new)
        assert message in str(error)
        assert error.line == line


def test_wrong_yaml(tmp_path):
    for old, new, line, message in [
        ("nanosec: 10000000", "nanosec: 0", 13, "time 0.0 s does not come after 0.0 s of the point before"),
        (
            "time_from_start: {sec: 0, nanosec: 0}",
            "time_from_start: {sec: 0, nanosec: 5}",
            8,
            "begins at 5e-09",
        ),
        ("positions: [0.1,", "positions: [.nan,", 8, "positions has '.nan', expected a finite number"),
        ("positions: [0.1,", "positions: [.inf,", 8, "positions has '.inf'"),
        ("positions: [0.1,", "positions: ['0.1',", 8, "expected a finite number"),
        ("positions: [0.1,", "positions: [1e-5,", 8, "positions has '1e-5', expected a finite number"),
        ("positions: [0.1,", "positions: [0.1, 0.1,", 8, "3 positions for 2 joints"),
        ("- 'B'", "- 'A'", 5, "joint 'A' occurs twice"),
        ("effort:", "color:", 11, "unknown field 'color' of point"),
        ("effort: []", "effort: []\n  effort: []", 12, "field 'effort' of point occurs twice"),
        ("  time_from_start: {sec: 0, nanosec: 0}\n", "", 8, "field 'time_from_start' of point is missing"),
        ("nanosec: 10000000", "nanosec: -1", 17, "nanosec is '-1', expected a whole number"),
        ("points:", "points: 3\nother:", 8, "unknown field 'other' of JointTrajectory"),
        ("positions: [0.1,", "positions: {0.1,", 8, "is not complete YAML"),
        ("joint_names:\n- 'A'\n- 'B'", "joint_names: A", 4, "joint_names is not a list"),
    ]:
        error = refused(save(short(), tmp_path / "motion.yaml"), old, new)
        assert message in str(error)
        assert error.line == line


def test_wrong_naoqi_scripts(tmp_path):
    for old, new, line, message in [
        ("NAMES = ['A', 'B']", "NAMES = ['A', 'A']", 8, "joint 'A' occurs twice"),
        ("NAMES = ['A', 'B']", "NAMES = ['A', None]", 8, "joint name 2 is None"),
        ("START = [0.1,", "START = [float('nan'),", 9, "START is not a list of plain values"),
        ("START = [0.1,", "START = [1e999,", 9, "START: got inf, expected finite numbers"),
        ("START = [0.1,", "START = [", 9, "START has 1 values for 2 joints"),
        ("TIMES = [0.005, 0.01,", "TIMES = [0.01,", 13, "A has 4 angles and 3 times"),
        ("VELOCITIES = [\n    [", "VELOCITIES = [\n    [0.0, ", 17, "A has 5 velocities and 4 times"),
        ("TIMES = [0.005, 0.01,", "TIMES = [0.01, 0.01,", 11, "time 0.01 s does not come after 0.01 s"),
        ("TIMES = [", "TIME = [", None, "has no list TIMES"),
        ("START = ", "START = NAMES\nSTART = ", 9, "START is not a list"),
        ("START = ", "NAMES = []\nSTART = ", 9, "NAMES occurs twice"),
        ("ANGLES = [", "ANGLES = [[],", 12, "3 lists for 2 joints"),
        ("ANGLES = [", "ANGLES = [(", None, "is not a complete Python script"),
    ]:
        error = refused(save(short(), tmp_path / "motion.py", dt=0.005), old, new)
        assert message in str(error)
        assert error.line == line or message == "is not a complete Python script"


def test_reading_a_script_does_not_run_it(tmp_path):
    path = save(short(), tmp_path / "motion.py")
    path.write_text(path.read_text() + f"\nopen({str(tmp_path / 'ran')!r}, 'w')\n")
    load(path)
    assert not (tmp_path / "ran").exists()


def wrong_npz(tmp_path, **changes):
    path = save(short(), tmp_path / "motion.npz")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays.update(changes)
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(FileFormatError) as caught:
        load(path)
    return str(caught.value)


def test_wrong_npz(tmp_path):
    for changes, message in [
        ({"breaks": np.array([0.0, 0.02, 0.01])}, "breaks: got [0. 0.02 0.01]"),
        ({"breaks": np.array([0.0, np.nan, 0.02])}, "breaks: got nan"),
        ({"coefficients": np.full((2, 2, 2), np.inf)}, "coefficients: got inf"),
        ({"coefficients": np.zeros((3, 2, 2))}, "coefficients: got shape (3, 2, 2)"),
        ({"breaks": None}, "expected breaks, coefficients"),
        ({"color": np.zeros(1)}, "holds breaks, coefficients, color"),
        ({"format": np.array("other")}, "expected 'pepper_kin.trajectory'"),
        ({"version": np.array(2)}, "expected 1"),
        ({"joint_names": np.array([1, 2])}, "joint_names is int64"),
        ({"joint_names": np.array(["A", "A"])}, "joint 'A' occurs twice"),
        ({"joint_names": np.array([object(), None])}, "is not a complete NumPy archive"),
    ]:
        assert message in wrong_npz(tmp_path, **changes)


def test_yaml_is_what_ros_takes(trajectory, tmp_path):
    """Parsed as `ros2 topic pub` parses it, and encoded with the message definitions of ROS 2."""
    import yaml
    from mcap_ros2._dynamic import serialize_dynamic

    from pepper_kin.ros_messages import message_type
    from pepper_kin.ros_messages.schemas import schema_text

    kind = "trajectory_msgs/msg/JointTrajectory"
    text = schema_text(message_type(kind))

    for saved in (trajectory, short()):
        message = yaml.safe_load(save(saved, tmp_path / "motion.yaml").read_text())
        assert list(message) == ["header", "joint_names", "points"]
        for point in message["points"]:
            for name in ("positions", "velocities", "accelerations"):
                assert all(type(value) is float for value in point[name])
        assert len(serialize_dynamic(kind, text)[kind](message)) > 100


def test_yaml_of_others_may_lack_accelerations(tmp_path):
    path = tmp_path / "foreign.yaml"
    path.write_text(
        "joint_names: [A]\npoints:\n"
        "- {positions: [0], velocities: [0], time_from_start: {sec: 0, nanosec: 0}}\n"
        "- {positions: [1], velocities: [0], time_from_start: {sec: 2, nanosec: 0}}\n"
    )
    cubic = load(path)
    assert cubic(1.0).position == pytest.approx([0.5])
    assert cubic(1.0).velocity == pytest.approx([0.75])
    path.write_text(path.read_text().replace(" velocities: [0],", ""))
    assert load(path)(1.0).velocity == pytest.approx([0.75])  # a spline of one piece from rest to rest
    path.write_text(path.read_text().replace("[1],", "[1], velocities: [0],"))
    with pytest.raises(FileFormatError, match="0 velocities for 1 joints") as caught:
        load(path)
    assert caught.value.line == 3


def test_mcap_without_its_package_says_how_to_install_it(tmp_path, monkeypatch):
    for name in ("mcap", "mcap.writer", "mcap.reader"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "b.mcap").write_bytes(b"")
    for act in (lambda: save(short(), tmp_path / "a.mcap"), lambda: load(tmp_path / "b.mcap")):
        with pytest.raises(pk.exceptions.MissingDependencyError, match=r"pip install \"pepper_kin\[mcap\]\""):
            act()


def test_naoqi_script_gives_the_robot_what_it_takes(trajectory, tmp_path, monkeypatch):
    """The script is run against a recorder in place of the robot's `qi` package."""
    calls = []

    class Service:
        def __getattr__(self, name):
            return lambda *saved: calls.append((name, saved))

    class Session:
        def connect(self, address):
            calls.append(("connect", (address,)))

        def service(self, name):
            calls.append(("service", (name,)))
            return Service()

    monkeypatch.setitem(sys.modules, "qi", types.SimpleNamespace(Session=Session))
    monkeypatch.setattr(sys, "argv", ["motion.py", "--ip", "10.0.0.7"])
    path = save(trajectory, tmp_path / "motion.py", dt=0.1)
    runpy.run_path(str(path), run_name="__main__")
    assert [name for name, _ in calls] == [
        "connect", "service", "angleInterpolationWithSpeed", "angleInterpolationBezier",
    ]  # fmt: skip
    assert calls[0][1] == ("tcp://10.0.0.7:9559",)
    _, start, speed = calls[2][1]
    np.testing.assert_allclose(start, trajectory.start, atol=1e-12)
    assert 0 < speed <= 1
    assert calls[3][1] == naoqi_arguments(trajectory, 0.1, unchecked=True)[:3]
    assert tuple(calls[3][1][0]) == trajectory.joint_names
    assert naoqi_arguments(trajectory, 0.1, unchecked=True).start == list(start)


def test_what_naoqi_makes_of_the_keys_is_what_is_read_back(pepper, trajectory, tmp_path):
    """By de Casteljau's construction on the control points of each key, in time and angle."""
    _, times, keys, start = naoqi_arguments(trajectory, 0.1, unchecked=True)
    again = load(save(trajectory, tmp_path / "motion.py", dt=0.1), pepper=pepper)
    for joint, (at, points) in enumerate(zip(times, keys, strict=True)):
        assert np.all(np.diff([0.0, *at]) > 0)
        ends = [(0.0, start[joint]), *((t, key[0]) for t, key in zip(at, points, strict=True))]
        leave = [(at[0] / 3, 0.0), *(key[2][1:] for key in points)]  # at rest before the first key
        for i, key in enumerate(points):
            handles = np.array([leave[i], key[1][1:]])
            control = np.array([ends[i], ends[i] + handles[0], ends[i + 1] + handles[1], ends[i + 1]])
            for u in (0.2, 0.5, 0.9):
                level = control
                while len(level) > 1:
                    level = (1 - u) * level[:-1] + u * level[1:]
                assert again(level[0, 0]).position[joint] == pytest.approx(level[0, 1], abs=1e-12)


def test_naoqi_arguments_are_plain_lists(trajectory):
    arguments = naoqi_arguments(trajectory, 0.1, unchecked=True)
    assert json.loads(json.dumps(arguments)) == list(arguments)
    slide = Trajectory(("BaseX", "A"), [0, 1], np.ones((1, 1, 2)), ("m", "rad"))
    with pytest.raises(InvalidValueError, match="joints in meters: BaseX"):
        naoqi_arguments(slide)


@pytest.mark.parametrize("suffix", [".csv", ".yaml", ".py", ".mcap"])
def test_steps_are_checked(tmp_path, suffix):
    for dt in (0.0, -1.0, np.nan, 1e-12):
        with pytest.raises(InvalidValueError, match="dt: got"):
            save(short(), tmp_path / f"motion{suffix}", dt=dt)
    assert list(tmp_path.iterdir()) == []
