"""The commands `pepper-kin dataset ...`."""

import json

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from pepper_kin.cli import app

JOB = """\
job: pepper_kin data set job
version: 1
kind: ik
rows: 50
rows_per_shard: 20
targets: {lower: [0.3, 0.0, 0.78], upper: [0.45, 0.3, 0.95]}
planner: {collisions: false}
"""


@pytest.fixture
def run():
    return lambda *words: CliRunner().invoke(app, ["dataset", *map(str, words)])


@pytest.fixture
def made(run, tmp_path):
    (tmp_path / "mine.yaml").write_text(JOB)
    done = run("make", tmp_path / "mine.yaml", "-o", tmp_path / "data", "--workers", 0)
    assert done.exit_code == 0, done.output
    assert "50 rows in" in done.stdout
    assert "50 of 50 rows" in done.stderr
    return tmp_path / "data"


def test_made_checked_shown_and_resumed(run, made):
    assert "No row is missing" in run("check", made).stdout
    about = json.loads(run("show", made, "--json").stdout)
    assert (about["rows"], about["statuses"]) == (50, {"solved": 50})
    assert json.loads(run("show", made, "--row", -1, "--json").stdout)["row"] == 49
    assert "status: solved" in run("show", made, "--row", 3).stdout
    first = sorted((made / "data").iterdir())[0]
    content = first.read_bytes()
    first.unlink()
    done = run("check", made, "--json")
    assert done.exit_code == 1
    assert "is missing" in json.loads(done.stdout)["faults"][0]
    assert run("resume", made, "--workers", 0).exit_code == 0
    assert first.read_bytes() == content
    assert pq.read_table(first).num_rows == 20


def test_refused_in_a_line(run, made, tmp_path):
    for words, text in (
        (("show", made, "--row", 50), "row: got 50"),
        (("show", tmp_path), "holds no dataset"),
        (("resume", tmp_path / "nothing"), "no dataset that was begun"),
        (("make", tmp_path / "gone.yaml"), r"gone.yaml: cannot be read"),
        (("make", tmp_path / "mine.yaml", "-o", made, "--workers", -1), "workers: got -1"),
    ):
        done = run(*words)
        assert done.exit_code != 0
        assert text in str(done.exception)
