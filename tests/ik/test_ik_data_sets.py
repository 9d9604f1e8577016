"""Long work in batches: pieces and threads change nothing; the example's file holds what it says."""

import time

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import PepperKinError
from pepper_kin.ik import batch

PEPPER = pk.load_pepper()
FIELDS = ("q", "codes", "errors", "iterations", "restarts")


def targets(count, seed=0):
    """Points around the robot: some reached at once, some after restarts, some never."""
    return np.random.default_rng(seed).uniform((-0.4, -0.6, 0.2), (0.8, 0.9, 1.5), (count, 3))


@pytest.fixture(scope="module")
def whole():
    return pk.ik.solve_batch(PEPPER, [pk.ik.HandPosition("left", targets(600))], seed=2, collisions=False)


@pytest.mark.thorough
@pytest.mark.parametrize(("chunk", "threads"), [(1, 1), (7, 3), (64, 2), (599, 2), (600, 1), (10_000, 4)])
def test_pieces_and_threads_change_nothing(monkeypatch, whole, chunk, threads):
    monkeypatch.setattr(batch, "CHUNK", chunk)
    calls = []
    found = pk.ik.solve_batch(
        PEPPER,
        [pk.ik.HandPosition("left", targets(600))],
        seed=2,
        threads=threads,
        progress=lambda done, count: calls.append((done, count)),
        collisions=False,
    )
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), err_msg=name)
    assert 0 < whole.success.sum() < 600
    assert calls == sorted(calls)
    assert len(calls) == -(-600 // chunk)
    assert calls[-1] == (600, 600)


def test_cutting_the_targets_changes_nothing(whole):
    cuts = np.array_split(targets(600), [1, 3, 200, 413])
    parts = [
        pk.ik.solve_batch(PEPPER, [pk.ik.HandPosition("left", cut)], seed=2, collisions=False) for cut in cuts
    ]
    for name in FIELDS:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)


def test_another_order_of_targets_changes_nothing(whole):
    order = np.random.default_rng(1).permutation(600)
    found = pk.ik.solve_batch(
        PEPPER, [pk.ik.HandPosition("left", targets(600)[order])], seed=2, collisions=False
    )
    np.testing.assert_array_equal(found.q, whole.q[order])


@pytest.mark.parametrize("threads", [1, 2])
def test_what_breaks_off_the_progress_breaks_off_the_work(threads):
    """Ctrl-C arrives in the calling thread; the rows that are left are not done first."""
    begun = []

    def work(begin, end):
        begun.append(begin)
        time.sleep(0.002)

    def stop(done, count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch._share_out(work, 500 * batch.CHUNK, threads, stop)
    assert 1 <= len(begun) < 500
    with pytest.raises(KeyboardInterrupt):
        pk.ik.solve_batch(
            PEPPER, pk.ik.HandPosition("left", targets(50)), threads=threads, progress=stop, collisions=False
        )


@pytest.mark.thorough
def test_the_data_set_of_the_example(run_example, tmp_path):
    done = run_example("07_data_set.py", "--count", "3000", "--seed", "5", cwd=tmp_path)
    assert done.returncode == 0
    assert "3000 targets: " in done.stdout
    assert "3000 of 3000 targets" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["ik_data_set.npz"]
    with np.load(tmp_path / "ik_data_set.npz", allow_pickle=False) as file:
        data = {key: file[key] for key in file.files}
    assert set(data) == {
        "targets", "q", "solved", "errors", "joint_names", "frame", "units", "seed",
    }  # fmt: skip
    assert data["targets"].shape == (3000, 3)
    assert data["q"].shape == (3000, PEPPER.n)
    assert tuple(data["joint_names"]) == PEPPER.joint_names
    assert int(data["seed"]) == 5
    assert "[m]" in str(data["units"])
    assert "[rad]" in str(data["units"])
    model = pinocchio.buildModelFromXML(PEPPER.export("urdf"))
    scratch, frame = model.createData(), model.getFrameId(str(data["frame"]))
    for row in range(0, 3000, 17):
        pinocchio.framesForwardKinematics(model, scratch, data["q"][row])
        error = np.linalg.norm(scratch.oMf[frame].translation - data["targets"][row])
        assert error == pytest.approx(data["errors"][row], abs=1e-9)
        assert (error <= 1e-3) == data["solved"][row]
    assert (data["q"] >= PEPPER.lower_limits).all()
    assert (data["q"] <= PEPPER.upper_limits).all()


def test_a_data_set_that_cannot_be_written_leaves_nothing(run_example, tmp_path):
    arguments = ("--count", "50", "-o", str(tmp_path / "no folder" / "data.npz"))
    with pytest.raises(PepperKinError, match="cannot be written"):
        run_example("07_data_set.py", *arguments, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []
