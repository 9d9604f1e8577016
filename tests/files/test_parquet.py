"""Motions and runs as Parquet: other readers find the same numbers; what is no table is refused."""

import json

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet as pq
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, MissingDependencyError
from pepper_kin.files import load, save


@pytest.fixture(scope="module")
def nod(pepper):
    return pk.motion.gesture(pepper, "nod")


def test_pandas_and_polars_read_what_the_csv_has(pepper, nod, tmp_path):
    path = save(nod, tmp_path / "nod.parquet")
    save(nod, tmp_path / "nod.csv")
    expected = pandas.read_csv(tmp_path / "nod.csv")
    pandas.testing.assert_frame_equal(pandas.read_parquet(path), expected, check_exact=True)
    import polars  # which changes how this process handles signals

    assert polars.read_parquet(path).columns == list(expected.columns)
    assert load(path, pepper=pepper) == load(tmp_path / "nod.csv", pepper=pepper)
    assert load(path).joint_names == pepper.joint_names
    assert load(path, pepper=pepper).check(pepper).success


def test_units_are_in_the_schema_and_come_back(tmp_path):
    driving = pk.load_pepper(base="planar")
    ends = np.array([driving.posture("Stand")] * 2)
    ends[1, 0] = 0.3
    path = save(pk.retime(driving, ends), tmp_path / "drive.parquet", pepper=driving)
    field = pq.read_schema(path).field("BaseX.velocity")
    assert json.loads(field.metadata[b"pepper_kin"]) == {
        "unit": "m/s",
        "quantity": "velocity",
        "joint": "BaseX",
    }
    assert load(path).joint_units == driving.joint_units


def test_a_run_comes_back(pepper, nod, tmp_path):
    run = pk.Twin(pepper, timestep=0.005).execute(nod)
    path = run.save(tmp_path / "run.parquet")
    again = pk.twin.load_run(pepper, path)
    for name in ("time", "position", "velocity", "torque", "reference_position", "external_wrench"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    assert isinstance(pk.jobs.load_motion(pepper, path), pk.twin.Run)
    assert isinstance(pk.jobs.load_motion(pepper, save(nod, tmp_path / "a.parquet")), pk.Trajectory)
    assert path.stat().st_size < 0.7 * run.save(tmp_path / "run.csv").stat().st_size


def columns(**changes):
    return {"time": [0.0, 0.1, 0.2], "a.position": [0.0] * 3, "a.velocity": [0.0] * 3} | changes


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"a.position": [0.0], "time": [0.0]}, "its first column is not 'time'"),
        (columns(time=[0.0, 0.2, 0.2]), "times do not increase"),
        (columns(**{"a.velocity": [0.0, np.nan, 0.0]}), "a.velocity holds what is no finite number"),
        (columns(**{"a.velocity": [0.0, None, 0.0]}), "a.velocity holds what is no finite number"),
        (columns(**{"a.velocity": ["x", "y", "z"]}), "column a.velocity is string, expected floats"),
        (columns(**{"a.power": [0.0] * 3}), "unknown column 'a.power'"),
        ({"time": pyarrow.array([], pyarrow.float64())}, "has no row of numbers"),
        ({"time": [0.0, 0.1], "a.position": [0.0] * 2}, "column 'a.velocity' is missing"),
        ({"time": [0.0], "a.position": [0.0], "a.velocity": [0.0]}, "expected at least 2"),
    ],
)
def test_what_is_no_motion_is_refused_by_name(table, words, tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pyarrow.table(table), path)
    with pytest.raises(FileFormatError, match=words) as caught:
        load(path)
    assert caught.value.path == str(path)


def test_damaged_and_huge_files_are_refused(nod, tmp_path):
    path = save(nod, tmp_path / "nod.parquet")
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    with pytest.raises(FileFormatError, match="is not a complete Parquet file"):
        load(path)
    zeros = pyarrow.array(np.zeros(40_000_000))
    pq.write_table(pyarrow.table({"time": zeros, "a.position": zeros}), path, compression="zstd")
    assert path.stat().st_size < 1_000_000
    with pytest.raises(FileFormatError, match="announces 40000000 rows of 2 columns: too much"):
        load(path)


def test_the_suffix_and_the_format_go_together(nod, tmp_path):
    for name, format in (("a.parquet", "csv"), ("a.csv", "parquet")):
        with pytest.raises(InvalidValueError, match="for that format, and no other"):
            save(nod, tmp_path / name, format=format)


def test_without_pyarrow_it_says_what_to_install(nod, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "pepper_kin\[datasets\]"'):
        save(nod, tmp_path / "a.parquet")
