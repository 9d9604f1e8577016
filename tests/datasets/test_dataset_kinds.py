"""Each kind of dataset at small size: its rows are held against laws, and read by others."""

import re

import numpy as np
import pyarrow.dataset
import pyarrow.parquet as pq
import pytest
from small_jobs import small_job

import pepper_kin as pk
from pepper_kin import datasets
from pepper_kin.datasets.shard import kind_of, rows_of
from pepper_kin.identification import read_log, replay
from pepper_kin.learning import PepperVectorEnv


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a function that makes the small dataset of a kind, once."""
    found = {}

    def make(kind):
        if kind not in found:
            folder = tmp_path_factory.mktemp(kind)
            found[kind] = datasets.make(small_job(kind, folder), folder / "data set", workers=0)
        return found[kind]

    return make


@pytest.mark.thorough
@pytest.mark.parametrize("kind", datasets.KINDS)
def test_rows_are_there_once_and_the_same_when_computed_alone(made, kind):
    """By pyarrow's own readers; a row alone, out of the middle of a shard, has the same bits."""
    dataset = made(kind)
    assert sum(dataset.statuses.values()) == len(dataset)
    assert datasets.check(dataset.store.place, sample=4).success
    read = pyarrow.dataset.dataset(str(dataset.store.local / "data"), format="parquet").to_table()
    assert sorted(read["row"].to_pylist()) == list(range(len(dataset)))
    assert read.schema.names == [column.name for column in dataset.columns]
    batch = next(rows_of(dataset.job, 1, 2))
    assert batch.to_pylist()[0].keys() == dataset[1].keys()
    for name, value in dataset[1].items():
        alone = np.asarray(batch[name].to_pylist()[0])
        np.testing.assert_array_equal(np.ravel(alone), np.ravel(value), err_msg=name)
    if kind not in ("ik",):
        for shard in dataset.shards:
            assert pq.read_metadata(dataset.store.path(shard["name"])).num_row_groups == shard["rows"]


def test_shards_of_another_size_hold_the_same_rows(made, tmp_path):
    """A row depends on its number alone; with another seed it is another one."""
    rows = made("ik").numpy()
    other = datasets.make(small_job("ik", tmp_path, rows_per_shard=13), tmp_path / "a", workers=0).numpy()
    for name, value in rows.items():
        np.testing.assert_array_equal(value, other[name])
    changed = datasets.run_shard(small_job("ik", tmp_path, rows=13), 0)
    np.testing.assert_array_equal(changed["row"].to_numpy(), np.arange(13))


def test_ik_rows_by_forward_kinematics_and_collision_checks(made):
    dataset, pepper = made("ik"), pk.load_pepper()
    rows = dataset.numpy()
    solved = np.array(rows["status"]) == "solved"
    assert solved.sum() > 80
    for q, target in zip(rows["q"][solved], rows["target"][solved], strict=True):
        hand = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
        assert np.linalg.norm(hand - target) < 1e-3
    scene = pk.collision.scene_file.scene_from_dict(dataset.job.scenes[0], "job", pk.Scene)
    assert not pk.collision.in_collision(pepper, rows["q"][solved], scene).any()
    frame = dataset.pandas(["row", "error"])
    assert dataset.polars(["error"])["error"].to_list() == frame["error"].tolist()
    assert frame["error"].mean() == pytest.approx(dataset.statistics["error"]["mean"][0], rel=1e-12)
    np.testing.assert_allclose(dataset.statistics["q"]["std"], rows["q"].std(axis=0), rtol=1e-12)


def test_maps_are_those_of_one_call(made):
    """Counts by `reach_map` itself, with the row's seed."""
    dataset = made("reach_maps")
    recipe = kind_of(dataset.job).recipe
    for number, row in enumerate(dataset):
        options = {"samples": 3000, "resolution": 0.1, "seed": recipe.seed_of(number)}
        one = pk.kinematics.reach_map(pk.load_pepper(), "LArm_effector", **options)
        np.testing.assert_array_equal(row["center"], one.centers)
        assert row["count"].sum() == row["samples"] == 3000
    assert not np.array_equal(dataset[0]["count"], dataset[1]["count"])


def test_plans_lead_through_free_space_in_their_own_worlds(made):
    dataset, pepper = made("plans"), pk.load_pepper()
    solved = [row for row in dataset if row["status"] == "solved"]
    assert len(solved) >= 2
    for row in solved:
        np.testing.assert_allclose(row["path"][0], row["start"], atol=1e-12)
        hand = pk.kinematics.frame_pose(pepper, row["path"][-1], "LArm_effector")[:3, 3]
        assert np.linalg.norm(hand - row["target"]) < 1e-3
        assert not pk.collision.in_collision(pepper, row["path"]).any()


def test_trajectories_keep_limits_and_come_to_rest(made):
    dataset, pepper = made("trajectories"), pk.load_pepper()
    solved = [row for row in dataset if row["status"] == "solved"]
    assert len(solved) >= 2
    for row in dataset:
        assert bool(row["reason"]) == (row["status"] != "solved")
        assert not re.search(r"\d m?s\b", row["reason"])  # it would be another one in the next call
    for row in solved:
        np.testing.assert_allclose(np.diff(row["time"]), 0.02, atol=1e-12)
        assert (np.abs(row["velocity"]) <= pepper.velocity_limits + 1e-6).all()
        middle = np.gradient(row["position"], row["time"], axis=0)[2:-2]
        # The mean velocity around a time differs from the one at it by h/2 of the acceleration at most.
        most = 0.02 / 2 * 1.2 * np.abs(row["acceleration"]).max(axis=0) + 1e-6
        assert (np.abs(middle - row["velocity"][2:-2]) <= most).all()
        assert not row["velocity"][[0, -1]].any()


@pytest.mark.thorough
def test_runs_are_of_twins_that_differ_with_sensors_and_pictures(made):
    dataset = made("runs")
    for row in dataset:
        assert row["status"] == "solved", row["reason"]
        assert len(row["camera_top"]) == len(row["camera_top.time"]) > 1
        assert row["camera_top"].std() > 5
        newest = np.searchsorted(row["joint_encoders.time"], row["time"] + 1e-9, side="right") - 1
        assert np.abs(row["joint_encoders"][newest] - row["position"]).max() < 0.1
    assert "camera_top" not in dataset.statistics


def test_demonstrations_come_out_again_when_their_actions_are_done(made):
    """In an environment with one robot: the same observations, to the bit."""
    dataset = made("demonstrations")
    env = PepperVectorEnv(1, "Reach")
    for number in (0, 3):
        row = dataset[number]
        observation, _ = env.reset(seed=[kind_of(dataset.job).recipe.seed_of(number)])
        for seen, action in zip(row["observation"], row["action"], strict=True):
            np.testing.assert_array_equal(observation[0], seen)
            observation, *_ = env.step(action[None])
    assert dataset.statuses == {"solved": 5}


def test_demonstrations_are_the_same_bits_however_rows_are_grouped(tmp_path):
    """Rows of one shard, more than are computed one by one, beside the same rows alone and in threes."""
    job = small_job("demonstrations", tmp_path, rows=26, rows_per_shard=26)
    whole = datasets.run_shard(job, 0)
    for begin, end in ((0, 1), (25, 26), (11, 14)):
        apart = [batch.to_pylist() for batch in rows_of(job, begin, end)]
        assert [row for rows in apart for row in rows] == whole.slice(begin, end - begin).to_pylist()


def test_replays_are_those_of_the_logs(made):
    dataset = made("replays")
    log = read_log(dataset.job.targets["logs"][1]["path"])
    expected, column = replay(pk.load_pepper(), log), pk.load_pepper().joint_index("LElbowRoll")
    np.testing.assert_array_equal(dataset[1]["twin"][:, column], expected.twin[:, 0])
    assert np.isnan(dataset[1]["twin"][:, column - 1]).all()
    assert dataset.statistics["twin"]["mean"][pk.load_pepper().joint_index("RElbowRoll")] is None


def test_randomized_demonstrations_differ_and_their_shards_do_not_matter(tmp_path):
    ranges = {"randomization": {"twin": {"stiffness": [0.5, 1.5]}}}
    job = small_job("demonstrations", tmp_path, rows=3, **ranges)
    plain = datasets.run_shard(small_job("demonstrations", tmp_path, rows=3), 0)
    varied = datasets.run_shard(job, 0)
    assert plain["observation"].to_pylist() != varied["observation"].to_pylist()
    assert next(rows_of(job, 1, 2)).to_pylist() == varied.slice(1, 1).to_pylist()


def test_the_card_has_a_picture_seeds_hashes_versions_and_the_license(made):
    dataset = made("trajectories")
    card = dataset.store.read_text("README.md")
    for text in (
        dataset.job.hash,
        pk.__version__,
        "seed 7",
        "license: CC-BY-4.0",
        "| solved |",
        "picture.png",
    ):
        assert text in card
    assert (dataset.store.local / "picture.png").read_bytes().startswith(b"\x89PNG")
