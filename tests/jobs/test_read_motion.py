"""A motion is read whatever wrote it."""

import numpy as np
import pytest

from pepper_kin.exceptions import FileFormatError, UnknownNameError
from pepper_kin.files import save
from pepper_kin.jobs import load_motion
from pepper_kin.model import load_pepper
from pepper_kin.motion import gesture
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import Recorder, Run, Twin


@pytest.fixture(scope="module")
def pepper():
    return load_pepper()


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".json", ".yaml", ".py"])
def test_trajectories_of_every_format(pepper, tmp_path, suffix):
    nod = gesture(pepper, "nod")
    found = load_motion(pepper, save(nod, tmp_path / f"nod{suffix}"))
    assert isinstance(found, Trajectory)
    # A file that holds samples ends at the last of them, at most one step short of the end.
    assert abs(found.duration - nod.duration) < 0.05
    np.testing.assert_allclose(found(0.4).position, nod(0.4).position, atol=2e-3)


def test_runs_and_recordings(pepper, tmp_path):
    nod = gesture(pepper, "nod")
    run = Twin(pepper, 0.01).execute(nod)
    found = load_motion(pepper, run.save(tmp_path / "run.csv"))
    assert isinstance(found, Run)
    np.testing.assert_array_equal(found.torque, run.torque)
    Recorder(Twin(pepper, 0.01), tmp_path / "monday", seed=0).execute(nod)
    again = load_motion(pepper, tmp_path / "monday")
    assert isinstance(again, Run)
    np.testing.assert_allclose(again.position, run.position, atol=1e-12)  # sampled chunk by chunk
    with pytest.raises(FileFormatError, match="monday: has other joints: KneePitch"):
        load_motion(load_pepper(hands="mimic"), tmp_path / "monday")


def test_what_is_neither_is_refused_by_name(pepper, tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown suffix '\.txt'"):
        load_motion(pepper, tmp_path / "a.txt")
    with pytest.raises(FileFormatError, match=r"none\.csv: cannot be read"):
        load_motion(pepper, tmp_path / "none.csv")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="no recording here"):
        load_motion(pepper, tmp_path / "empty")
