"""The published twin's validation, made again."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
import pytest
from typer.testing import CliRunner

from pepper_kin.cli import app
from pepper_kin.paper import PaperCheck, check_paper, save_paper_check
from pepper_kin.paper.check import ITERATIONS, TRACKING_LIMIT


class Run(NamedTuple):
    """One run of the command: how it ended, where its files are, what the job told and gave back."""

    exit_code: int
    stdout: str
    folder: Path
    calls: list[tuple[int, int]]
    found: PaperCheck


@pytest.fixture(scope="module")
def run_of_command(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The job takes long: what the command makes is kept on its way, for all tests to look at."""
    folder, calls, kept = tmp_path_factory.mktemp("paper") / "validation", [], []

    def kept_check(*, progress: Callable[[int, int], None], **options: object) -> PaperCheck:
        def tell(done: int, total: int) -> None:
            calls.append((done, total))
            progress(done, total)

        kept.append(check_paper(progress=tell, **options))
        return kept[-1]

    with mock.patch("pepper_kin.paper.check_paper", kept_check):
        ended = CliRunner().invoke(app, ["check", "paper", "--json", "-o", str(folder)])
    return Run(ended.exit_code, ended.stdout, folder, calls, *kept)


@pytest.fixture(scope="module")
def found(run_of_command: Run) -> PaperCheck:
    return run_of_command.found


@pytest.mark.thorough
def test_every_movement_is_tracked_to_a_tenth_of_the_papers_error(found):
    assert found.success
    assert [m.name for m in found.movements] == ["left-arm", "right-arm", "head"]
    for movement in found.movements:
        time, commanded, measured = movement.iterations()
        assert len(time) == ITERATIONS
        again = np.sqrt(np.mean((measured - commanded) ** 2, axis=0))
        assert again.max() < TRACKING_LIMIT
        assert again == pytest.approx(movement.tracking[1], rel=0.1, abs=1e-8)
        # At the paper's pace and in minimum time alike, the keyframes are met to a tenth of its columns.
        for report in (movement.fast, movement.calm):
            assert report.mean_absolute_error.max() < TRACKING_LIMIT
            assert report.gesture.paper_error("gazebo").max() >= 0.008


@pytest.mark.thorough
def test_report_holds_the_numbers_it_speaks_of(found):
    text = found.report()
    for title in ("Table 4", "Table 5", "Figures 6 and 7", "Section 3.3"):
        assert f"== {title}" in text
    for movement in found.movements:
        for j, joint in enumerate(movement.tilt.joint_names):
            assert joint in text
            assert f"{movement.tilt.formulas_error[j]:.4f}" in text
    assert "cannot see a turn about the vertical" in text
    assert f"{found.worst_tracking:.2e}" in text


@pytest.mark.thorough
def test_files_are_whole_and_agree(found, tmp_path):
    files = save_paper_check(found, tmp_path / "new")
    numbers = json.loads(files["numbers"].read_text())
    assert numbers["success"] is True
    assert numbers["table_4"]["mean_error"] == found.limits.mean_error
    for movement in found.movements:
        rows = list(csv.DictReader(files[f"figure_{movement.name}.csv"].read_text().splitlines()))
        assert len(rows) == ITERATIONS
        joint = movement.tilt.joint_names[0]
        column = np.array([float(row[f"{joint}.twin [rad]"]) for row in rows])
        assert column == pytest.approx(movement.iterations()[2][:, 0], abs=1e-7)
        assert files[f"figure_{movement.name}.png"].read_bytes().startswith(b"\x89PNG")


def test_command_prints_json_and_writes_files(run_of_command):
    assert run_of_command.exit_code == 0
    assert json.loads(run_of_command.stdout)["worst_tracking"] < TRACKING_LIMIT
    assert (run_of_command.folder / "figure_head.png").is_file()


def test_progress_is_reported_from_nothing_to_all(run_of_command):
    assert run_of_command.calls == [(k, 3) for k in range(4)]
