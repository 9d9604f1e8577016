"""LeRobotDataset v3.0: its files as pandas, pyarrow and PyAV read them, its statistics against NumPy's."""

import json
import shutil

import av
import mcap.reader
import numpy as np
import pandas
import pyarrow.parquet as pq
import pytest
from small_jobs import pepper, small_job

from pepper_kin import datasets, kinematics
from pepper_kin.datasets import Feature, LeRobotWriter
from pepper_kin.exceptions import InvalidValueError


@pytest.fixture
def episodes():
    rng = np.random.default_rng(0)
    return [rng.normal(size=(length, 5)).astype(np.float32).cumsum(axis=0) for length in (1, 7, 40, 500)]


@pytest.fixture
def written(tmp_path, episodes):
    features = {"observation.state": Feature(3, ("a", "b", "c")), "action": Feature(2)}
    with LeRobotWriter(tmp_path / "set", 50, features, frames_per_file=45) as writer:
        for k, rows in enumerate(episodes):
            writer.add(
                "look" if k % 2 else "reach", **{"observation.state": rows[:, :3], "action": rows[:, 3:]}
            )
    return tmp_path / "set"


def test_frames_and_episodes_are_where_the_metadata_say(written, episodes):
    """A row group for each episode; tasks by pandas' index."""
    info = json.loads((written / "meta/info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == ("v3.0", 4, 548)
    about = pandas.read_parquet(written / "meta/episodes/chunk-000/file-000.parquet")
    tasks = pandas.read_parquet(written / "meta/tasks.parquet")
    assert tasks.loc["look", "task_index"] == 1
    for k, rows in enumerate(episodes):
        place = info["data_path"].format(
            chunk_index=about["data/chunk_index"][k], file_index=about["data/file_index"][k]
        )
        frames = pandas.read_parquet(written / place)
        frames = frames[frames["episode_index"] == k]
        np.testing.assert_array_equal(np.stack(frames["observation.state"]), rows[:, :3])
        np.testing.assert_array_equal(np.stack(frames["action"]), rows[:, 3:])
        np.testing.assert_allclose(frames["timestamp"], np.arange(len(rows)) / 50, rtol=1e-6)
        expected = np.arange(about["dataset_from_index"][k], about["dataset_to_index"][k])
        np.testing.assert_array_equal(frames["index"], expected)
        assert list(about["tasks"][k]) == ["look" if k % 2 else "reach"]
    groups = [pq.read_metadata(path).num_row_groups for path in sorted((written / "data").rglob("*.parquet"))]
    assert groups == [2, 1, 1]


def test_statistics_are_those_of_numpy(written, episodes):
    about = pandas.read_parquet(written / "meta/episodes/chunk-000/file-000.parquet")
    for k, rows in enumerate(episodes):
        exact = rows[:, :3].astype(float)
        found = {
            word: np.array(about[f"stats/observation.state/{word}"][k]) for word in ("mean", "std", "count")
        }
        np.testing.assert_allclose(found["mean"], exact.mean(axis=0), rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(found["std"], exact.std(axis=0), rtol=1e-5, atol=1e-6)
        assert found["count"].tolist() == [len(rows)]
        for word, share in (
            ("min", 0),
            ("q01", 0.01),
            ("q10", 0.1),
            ("q50", 0.5),
            ("q90", 0.9),
            ("q99", 0.99),
        ):
            value = about[f"stats/observation.state/{word}"][k]
            np.testing.assert_allclose(value, np.quantile(exact, share, axis=0), rtol=1e-6, atol=1e-6)
        index = np.arange(len(rows)) + about["dataset_from_index"][k]
        assert about["stats/index/std"][k][0] == pytest.approx(index.std(), abs=1e-9)
        assert about["stats/index/q90"][k][0] == pytest.approx(np.quantile(index, 0.9))
        assert about["stats/episode_index/max"][k][0] == k
    whole = json.loads((written / "meta/stats.json").read_text())
    joined = np.concatenate(episodes)[:, 3:].astype(float)
    np.testing.assert_allclose(whole["action"]["mean"], joined.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(whole["action"]["std"], joined.std(axis=0), rtol=1e-6)
    assert whole["action"]["count"] == [548]


def test_what_cannot_be_written_is_refused_and_nothing_complete_is_left(tmp_path):
    features = {"observation.state": Feature(2)}
    with pytest.raises(InvalidValueError, match="whole number"):
        LeRobotWriter(tmp_path / "a", 12.5, features)
    bad = {"observation.state": [[0, 1], [np.nan, 1]]}
    refused = pytest.raises(InvalidValueError, match=r"observation\.state: got NaN")
    with refused, LeRobotWriter(tmp_path / "b", 50, features) as writer:
        writer.add("x", **bad)
    assert not (tmp_path / "b/meta").exists()
    with LeRobotWriter(tmp_path / "c", 50, features) as writer:
        with pytest.raises(InvalidValueError, match="shape"):
            writer.add("x", **{"observation.state": [[0, 1, 2]]})
        writer.add("x", **{"observation.state": [[0, 1]]})
    with pytest.raises(InvalidValueError, match="an empty folder"):
        LeRobotWriter(tmp_path / "c", 50, features)


@pytest.mark.thorough
def test_a_run_of_the_twin_becomes_frames_and_a_film(tmp_path):
    """PyAV shows the camera's pictures at their times; the frames are those of the rows."""
    job = small_job("runs", tmp_path, rows=1, format="lerobot")
    made = datasets.make(job, tmp_path / "data", workers=0)
    row, place = made[0], tmp_path / "data/lerobot"
    frames = pandas.read_parquet(place / "data/chunk-000/file-000.parquet")
    np.testing.assert_allclose(np.stack(frames["observation.state"]), row["position"], atol=1e-6)
    np.testing.assert_allclose(np.stack(frames["action"]), row["reference_position"], atol=1e-6)
    film = place / "videos/observation.images.camera_top/chunk-000/file-000.mp4"
    with av.open(str(film)) as container:
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(pictures) == len(row["time"])
    newest = np.searchsorted(row["camera_top.time"], row["time"][-1] + 1e-9, side="right") - 1
    assert np.abs(pictures[-1].astype(int) - row["camera_top"][newest]).mean() < 6
    stats = json.loads((place / "meta/stats.json").read_text())["observation.images.camera_top"]
    np.testing.assert_allclose(
        np.ravel(stats["mean"]), row["camera_top"].mean(axis=(0, 1, 2)) / 255, atol=0.02
    )
    assert np.shape(stats["q99"]) == (3, 1, 1)


@pytest.mark.parametrize("kind", ["trajectories", "runs", "demonstrations", "replays"])
def test_mcap_files_are_read_by_the_package_mcap(kind, tmp_path):
    more = {} if kind == "replays" else {"rows": 1, "rows_per_shard": 1}
    made = datasets.make(small_job(kind, tmp_path, format="mcap", **more), tmp_path / "data", workers=0)
    solved = [row["row"] for row in made if row["status"] == "solved"]
    files = sorted((tmp_path / "data/mcap").iterdir())
    assert [path.name for path in files] == [f"row-{row:06d}.mcap" for row in solved]
    with open(files[0], "rb") as stream:
        reader = mcap.reader.make_reader(stream, validate_crcs=True)
        counts = {}
        for _, channel, _ in reader.iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert counts["/joint_states"] == len(made[solved[0]]["time"])
    if kind == "runs":
        assert counts["/sensors/joint_encoders"] == len(made[0]["joint_encoders"])


@pytest.mark.parametrize("format", ["lerobot", "mcap"])
def test_files_of_other_formats_that_are_lost_or_changed_are_named(format, tmp_path):
    """Each file has its digest; the set is whole again after what the words say."""
    folder, size = tmp_path / "data", {"rows": 3, "rows_per_shard": 3}
    datasets.make(small_job("trajectories", tmp_path, format=format, **size), folder, workers=0)
    assert datasets.check(folder, sample=0).success
    first, *others = sorted(path for path in (folder / format).rglob("*") if path.is_file())
    first.unlink()
    others[-1].write_bytes(others[-1].read_bytes()[:-1])
    (folder / format / "other").write_text("x")
    missing, strange, damaged = datasets.check(folder, sample=0).faults
    assert first.name in missing
    assert "is missing" in missing
    assert "no file of this dataset" in strange
    assert others[-1].name in damaged
    assert "SHA-256" in damaged
    (folder / f"{format}.json").write_text("{")
    (unread,) = datasets.check(folder, sample=0).faults
    assert f"{format}.json: is damaged" in unread
    shutil.rmtree(folder / format)
    (folder / f"{format}.json").unlink()
    (folder / "manifest.json").unlink()
    datasets.resume(folder, workers=0)
    assert datasets.check(folder, sample=0).success


def test_the_numbers_of_a_demonstration_have_names(tmp_path):
    """The dataset's JSON says which number is what: by the positions of the rows, and by kinematics."""
    job = small_job("demonstrations", tmp_path, rows=1, format="lerobot")
    made = datasets.make(job, tmp_path / "data", workers=0)
    place, row, robot = tmp_path / "data/lerobot", made[0], pepper()
    features = json.loads((place / "meta/info.json").read_text())["features"]
    frames = pandas.read_parquet(place / "data/chunk-000/file-000.parquet")["observation.state"]
    found = dict(zip(features["observation.state"]["names"], np.stack(frames).T, strict=True))
    for joint in features["action"]["names"]:
        j = robot.joint_index(joint)
        middle, half = np.array([[0.5, 0.5], [-0.5, 0.5]]) @ (robot.lower_limits[j], robot.upper_limits[j])
        angle = middle + half * found[f"{joint}.position"]
        np.testing.assert_allclose(angle, row["position"][:, j], atol=1e-5)
        assert np.abs(found[f"{joint}.velocity"]).max() <= 1.0
    hand = kinematics.frame_pose(robot, row["position"], "LArm_effector")[:, :3, 3]
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(found[f"place.0.{axis}"], hand[:, k], atol=1e-6)
        goal = found[f"place.0.{axis}"] + found[f"way_to_goal.0.{axis}"]
        assert np.ptp(goal) < 1e-6
