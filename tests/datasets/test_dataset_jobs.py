"""Jobs: their files, their hashes, and what is refused by name."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from small_jobs import BOX, TABLE, small_job

import pepper_kin as pk
from pepper_kin import datasets
from pepper_kin.datasets import DatasetJob
from pepper_kin.exceptions import PepperKinError

HEAD = "job: pepper_kin data set job\nversion: 1\n"


@pytest.mark.parametrize("kind", datasets.KINDS)
def test_a_job_comes_back_from_its_file(kind, tmp_path):
    job = small_job(kind, tmp_path)
    again = datasets.load_job(job.save(tmp_path / "job.yaml"))
    assert again == job
    assert again.hash == job.hash


def test_the_hash_is_of_all_that_changes_rows_and_of_nothing_else():
    job = DatasetJob("ik", 10, targets=BOX)
    same = [replace(job, name="another"), replace(job, license="MIT"), replace(job, rows_per_shard=3)]
    assert {other.hash for other in same} == {job.hash}
    changed = [
        replace(job, seed=1), replace(job, rows=11), replace(job, scenes=(TABLE,)),
        replace(job, targets={**BOX, "look": True}), replace(job, robot={"hands": "mimic"}),
    ]  # fmt: skip
    assert len({job.hash, *(other.hash for other in changed)}) == len(changed) + 1


def test_scenes_are_taken_from_values_and_files_beside_the_job(tmp_path):
    scene = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
    scene.save(tmp_path / "table.json")
    text = HEAD + "kind: ik\nrows: 5\nscenes: [table.json]\ntargets: {by: postures}\n"
    (tmp_path / "job.yaml").write_text(text)
    job = datasets.load_job(tmp_path / "job.yaml")
    assert job.scenes == DatasetJob("ik", 5, scenes=[scene], targets={"by": "postures"}).scenes
    (tmp_path / "table.json").unlink()  # the value holds it
    assert datasets.run_shard(job, 0).num_rows == 5


REFUSED = {
    "kind: ikk\nrows: 5\n": "unknown kind of dataset 'ikk'.*available: ik",
    "kind: ik\nrows: 0\n": "rows: got 0",
    "kind: ik\nrows: 5\nrow: 3\n": "unknown field 'row'.*did you mean",
    "kind: ik\n": "lacks 'rows'",
    "kind: ik\nrows: 5\ntargets: {uper: [1, 1, 1]}\n": "targets for ik 'uper'.*did you mean 'upper'",
    "kind: ik\nrows: 5\ntwin: {timestep: 0.1}\n": "unknown option of twin for ik",
    "kind: ik\nrows: 5\nformat: lerobot\n": "format: got lerobot, expected parquet for ik",
    "kind: ik\nrows: 5\nformat: hdf5\n": "format.*parquet",
    "kind: ik\nrows: 5\nseed: .nan\n": "seed: got nan",
    "kind: ik\nrows: 5\ntargets: {lower: [.inf, 0, 0]}\n": "targets.*inf",
    "kind: ik\nrows: 5\nscenes: [gone.json]\n": "gone.json: .*",
    "kind: ik\nrows: 5\nscenes: [{objects: [{name: a, kind: bax}]}]\n": r"scenes\[0\].*kind is 'bax'",
    "kind: ik\nrows: 5\nsensors: [camera_top]\n": "sensors: .*none for ik",
    "kind: replays\nrows: 1\n": "logs of targets",
    "kind: ik\nrows: 5\ntargets: &a {look: true}\nrobot: *a\n": r"job.yaml:6: has an alias \(\*\)",
    "kind: [\n": "is not YAML",
}


@pytest.mark.parametrize("text", REFUSED)
def test_wrong_job_files_are_refused_by_name(text, tmp_path):
    path = tmp_path / "job.yaml"
    path.write_text(HEAD + text)
    with pytest.raises(PepperKinError, match=re.compile(REFUSED[text], re.DOTALL)):
        datasets.load_job(path)


LATE = [
    (dict(kind="ik", targets={}), "lower and upper"),
    (dict(kind="ik", targets={"lower": [0, 0, 1], "upper": [0, 0, 0]}), "lower"),
    (dict(kind="ik", targets={**BOX, "hand": "third"}), "hand"),
    (dict(kind="ik", targets=BOX, robot={"base": "round"}), "base"),
    (dict(kind="ik", targets=BOX, randomization={"objects": {"lamp": [0, 0, 0]}}), "object to shift 'lamp'"),
    (dict(kind="plans", targets={**BOX, "start": "Headstand"}), "Headstand"),
    (dict(kind="runs", targets=BOX, sensors=["nose"]), "sensor 'nose'"),
    (dict(kind="runs", targets=BOX, twin={"timestep": 7}), "timestep"),
    (dict(kind="runs", targets=BOX, randomization={"twin": {"mass": [0.9, 1.1]}}), "mass"),
    (dict(kind="demonstrations", targets={"task": "Fly"}), "task 'Fly'"),
    (dict(kind="reach_maps", targets={"frame": "tail"}), "tail"),
]  # fmt: skip


@pytest.mark.parametrize("options", LATE, ids=lambda case: case[1])
def test_what_the_robot_cannot_take_is_refused_before_anything_is_written(options, tmp_path):
    with pytest.raises(PepperKinError, match=options[1]):
        datasets.make(DatasetJob(rows=3, **options[0]), tmp_path / "data", workers=1)
    assert not (tmp_path / "data").exists()


def test_a_log_that_has_changed_is_refused(tmp_path):
    job = small_job("replays", tmp_path)
    path = Path(job.targets["logs"][0]["path"])
    path.write_text(path.read_text() + "13.0,0,0\n")
    with pytest.raises(PepperKinError, match=r"log0\.csv: has changed"):
        DatasetJob(**job.as_dict())
