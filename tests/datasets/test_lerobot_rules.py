"""LeRobot's rules for features, and what rows say of their world.

lerobot 0.6.1 makes `datasets.Value` of features of shape (1,) and lists of others, adds `timestamp`,
`frame_index`, `episode_index`, `index` and `task_index`, `NAME_is_pad` beside the windows of a feature, reads
two names as language, and refuses names with "/".
"""

import json
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pepper_kin import datasets
from pepper_kin.collision import Scene
from pepper_kin.datasets import Feature, LeRobotWriter
from pepper_kin.datasets.columns import Column
from pepper_kin.datasets.export import _to_lerobot
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatWarning, InvalidValueError

TABLE = {"name": "table", "kind": "box", "size": [0.4, 0.8, 0.03], "position": [0.47, 0.05, 0.715]}
TARGETS = {"hand": "left", "lower": (0.28, 0.05, 0.75), "upper": (0.45, 0.4, 1.0)}


def read(root):
    info = json.loads((root / "meta" / "info.json").read_text())
    return info, pq.read_table(next((root / "data").rglob("*.parquet")))


@pytest.mark.parametrize("size", [1, 2, 7])
def test_columns_have_the_types_that_their_shapes_ask_for(size, tmp_path):
    values = np.arange(10.0 * size).reshape(10, size)
    with LeRobotWriter(tmp_path / "set", fps=10, features={"action": Feature(size)}) as writer:
        writer.add("t", action=values)
    info, table = read(tmp_path / "set")
    for name, feature in info["features"].items():
        value, [length] = pa.type_for_alias(feature["dtype"]), feature["shape"]
        assert table.schema.field(name).type == (value if length == 1 else pa.list_(value, length))
    assert np.array(table["action"].to_pylist()).reshape(10, size).tolist() == values.tolist()
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())
    assert len(stats["action"]["mean"]) == size


@pytest.mark.parametrize(
    "name",
    [
        "timestamp", "frame_index", "episode_index", "index", "task_index", "task", "observation/state", "",
        "language_persistent", "language_events", "action_is_pad", "a\0",
    ],
)  # fmt: skip
def test_names_that_lerobot_has_or_refuses(name, tmp_path):
    with pytest.raises(InvalidValueError, match="feature: got"):
        LeRobotWriter(tmp_path / "set", fps=10, features={name: Feature(2), "action": Feature(2)})
    assert not (tmp_path / "set" / "meta").exists()


@pytest.mark.parametrize(
    ("feature", "reason"),
    [
        (Feature(2, ("a",)), "1 names of 2 numbers"),
        (Feature(2, ("a", "a")), "names that differ"),
        (Feature(), "numbers, or even height and width"),
        (Feature(picture=(3, 4)), "even height and width"),
    ],
)
def test_features_that_contradict_themselves_are_refused(feature, reason, tmp_path):
    with pytest.raises(InvalidValueError, match=reason):
        LeRobotWriter(tmp_path / "set", fps=10, features={"action": Feature(2), "other": feature})


@pytest.mark.parametrize("scale", [1e30, 3e38, 1e-30])
def test_statistics_of_numbers_whose_squares_leave_single_precision(scale, tmp_path):
    values = (scale * np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2))).astype(np.float32)
    with LeRobotWriter(tmp_path / "set", fps=10, features={"action": Feature(2)}) as writer:
        writer.add("t", action=values)
    found = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())["action"]["std"]
    np.testing.assert_allclose(found, values.astype(float).std(axis=0), rtol=1e-5)


def test_a_feature_may_be_named_self(tmp_path):
    with LeRobotWriter(tmp_path / "set", fps=10, features={"self": Feature(1)}) as writer:
        writer.add("t", **{"self": np.ones((3, 1))})
    assert read(tmp_path / "set")[1]["self"].to_pylist() == [1.0, 1.0, 1.0]


def test_rows_and_frames_say_where_shifted_objects_stood(tmp_path):
    """The plan of a row keeps clear of the table where the row says that it stood."""
    job = datasets.DatasetJob(
        kind="trajectories", rows=3, rows_per_shard=3, scenes=[{"objects": [TABLE]}], targets=TARGETS,
        randomization={"objects": {"table": [0.05, 0.05, 0.0]}}, format="lerobot", seed=3,
    )  # fmt: skip
    rows = datasets.make(job, tmp_path, workers=0)
    places = np.array([row["object.table"] for row in rows])
    assert len(np.unique(places, axis=0)) == 3
    assert (np.abs(places - TABLE["position"]) <= [0.05, 0.05, 0.0]).all()
    from pepper_kin import collision, load_pepper

    for row in rows:
        world = Scene().add_box("table", size=TABLE["size"], position=row["object.table"])
        if row["status"] == "solved":
            assert not collision.in_collision(load_pepper(), row["position"], world).any()
    info, table = read(tmp_path / "lerobot")
    assert info["features"]["observation.environment_state"]["names"] == ["table.x", "table.y", "table.z"]
    told = np.unique(np.array(table["observation.environment_state"].to_pylist()), axis=0)
    assert all(np.abs(places - one).max(axis=1).min() < 1e-6 for one in told)


class Rows:
    """Replays of two logs, of which one lacks a joint."""

    job = SimpleNamespace(kind="replays", targets={}, name="logs")
    columns = tuple(
        Column(name, "float64", (2,), True, "rad", ("HeadYaw", "HeadPitch"))
        for name in ("measured", "command")
    )

    def __iter__(self):
        time = np.array([0.0, 0.02, 0.2])
        for lacking in (False, True):
            values = np.column_stack([time, np.full(3, np.nan if lacking else 0.3)])
            yield {"status": "solved", "time": time, "measured": values, "command": values}


def test_joints_that_a_log_lacks_are_left_out_and_not_zero(tmp_path):
    with pytest.warns(FileFormatWarning) as caught:
        _to_lerobot(Rows(), Store(tmp_path))
    told = " ".join(str(w.message) for w in caught)
    assert "left out: HeadPitch" in told
    assert "their times differ by up to" in told
    info, table = read(tmp_path / "lerobot")
    assert info["features"]["action"]["names"] == ["HeadYaw"]
    assert table["observation.state"].to_pylist() == pytest.approx([0.0, 0.02, 0.2] * 2)
