"""The twin beside MuJoCo: agreement, and that a difference would be found."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import pepper_kin as pk
from pepper_kin.cli import app
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.jobs import PhysicsCheck, check_physics, physics_check
from pepper_kin.jobs.physics_check import LIMIT, PhysicsRow


@pytest.fixture(scope="module")
def found() -> PhysicsCheck:
    return check_physics(timesteps=(4e-4, 1e-4))


@pytest.mark.thorough
def test_engines_agree_and_the_difference_shrinks(found):
    assert found.success
    assert [row.name for row in found.rows] == [
        "free swing",
        "step responses",
        "gesture: wave",
        "push on a hand",
    ]
    for row in found.rows:
        assert row.moved > 0.1
        assert row.differences[-1] <= LIMIT
        # First order: four times shorter steps, about four times smaller differences, or nothing to see.
        assert row.greatest[-1] < 0.4 * row.greatest[0] or row.greatest[-1] < 1e-6


@pytest.mark.thorough
def test_a_heavier_hand_in_one_engine_would_be_found(monkeypatch):
    right = physics_check._drive

    def heavier(model, motion):
        model.body("l_wrist").mass[:] *= 1.5
        right(model, motion)

    monkeypatch.setattr(physics_check, "_drive", heavier)
    found = check_physics(timesteps=(1e-3, 5e-4), duration=0.3)
    assert not found.success
    assert "BEYOND" in found.report()


@pytest.mark.thorough
def test_report_and_json_tell_the_same(found):
    text, summary = found.report(), found.as_dict()
    assert found.engine.startswith("MuJoCo")
    for row, plain in zip(found.rows, summary["rows"], strict=True):
        assert row.name in text
        assert f"{row.differences[-1]:.1e}" in text
        assert plain["differences"] == list(row.differences)
    json.dumps(summary)


def test_order_is_the_slope():
    row = PhysicsRow("x", 1.0, (4e-4, 2e-4, 1e-4), (4e-3, 2e-3, 1e-3), (4e-3, 2e-3, 1e-3), "HeadYaw")
    assert row.order == pytest.approx(1.0)
    assert np.isnan(PhysicsRow("x", 1.0, (2e-4, 1e-4), (1e-9, 1e-9), (1e-9, 1e-9), "HeadYaw").order)


def test_misuse_is_named():
    with pytest.raises(InvalidValueError, match=r"timesteps.*at least two"):
        check_physics(pk.load_pepper(), timesteps=(1e-3,))
    with pytest.raises(InvalidValueError, match="timestep"):
        check_physics(pk.load_pepper(), timesteps=(1e-3, -1.0))


def test_command_prints_json_and_writes_files(monkeypatch, found, tmp_path):
    monkeypatch.setattr("pepper_kin.jobs.physics_check.check_physics", lambda **_: found)
    monkeypatch.setattr("pepper_kin.jobs.check_physics", lambda **_: found, raising=False)
    done = CliRunner().invoke(app, ["check", "physics", "--json", "-o", str(tmp_path)])
    assert done.exit_code == 0
    assert json.loads(done.stdout)["success"] is True
    assert json.loads((tmp_path / "physics.json").read_text())["engine"] == found.engine
