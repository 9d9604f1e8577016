"""Many targets at once: each row is what `solve` gives, whatever the threads."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.ik.batch import CHUNK, CODES

PEPPER = pk.load_pepper()


def hands(count, seed=0):
    q = np.random.default_rng(seed).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))
    return pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")


def test_rows_are_what_solve_gives():
    points = hands(20)[:, :3, 3].copy()
    points[3] *= 3
    starts = np.random.default_rng(1).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (20, 15))
    tasks = [pk.ik.HandPosition("left", points), pk.ik.LookAt((1.0, 0.0, 1.0))]
    batch = pk.ik.solve_batch(PEPPER, tasks, starts, seed=3, collisions=False)
    for i in range(20):
        one = pk.ik.solve(
            PEPPER, [pk.ik.HandPosition("left", points[i]), tasks[1]], starts[i], seed=3, collisions=False
        )
        np.testing.assert_array_equal(batch.q[i], one.q)
        assert batch.status(i) is one.status
        assert (batch.iterations[i], batch.restarts[i]) == (one.iterations, one.restarts)
        np.testing.assert_allclose(batch.errors[i], [error.value for error in one.errors], atol=1e-9)
        assert batch.result(i).certificate == one.certificate
    assert not batch.success[3]


@pytest.mark.parametrize("row", [list, tuple, np.array])
def test_points_may_be_lists(row):
    """Several points as an array, and as lists; one pose as rows is one."""
    poses = hands(3)
    lists = [row(point) for point in poses[:, :3, 3].tolist()]
    np.testing.assert_array_equal(pk.ik.HandPosition("left", lists).target, poses[:, :3, 3])
    pose = pk.ik.HandPose("left", [row(line) for line in poses[0].tolist()])
    np.testing.assert_array_equal(pose.target, poses[0])
    with pytest.raises(InvalidValueError, match="target of left hand"):
        pk.ik.HandPosition("left", [[0.3, 0.2, 0.9], [0.3, 0.2]])


@pytest.mark.thorough
def test_threads_change_nothing_and_progress_is_reported():
    points = hands(3 * CHUNK + 5)[:, :3, 3]
    calls = []
    one = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), collisions=False)
    two = pk.ik.solve_batch(
        PEPPER,
        pk.ik.HandPosition("left", points),
        threads=3,
        progress=lambda done, count: calls.append((done, count)),
        collisions=False,
    )
    for name in ("q", "codes", "errors", "iterations", "restarts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert calls[-1] == (len(points), len(points))
    assert sorted(calls) == calls
    assert len(calls) == 4
    assert f"{len(points)} targets: {int(one.success.sum())} solved" in one.report()


@pytest.mark.parametrize("solver", ["placo", "proxsuite"])
def test_other_solvers_too(solver):
    poses = hands(3, seed=4)
    tasks = [pk.ik.HandPosition("left", poses[:, :3, 3]), pk.ik.Point("left", poses[:, :3, 0])]
    found = pk.ik.solve_batch(PEPPER, tasks, solver=solver, restarts=1, collisions=False)
    single = pk.ik.solve(PEPPER, [task.at(1) for task in tasks], solver=solver, restarts=1, collisions=False)
    # Not to the last bit: their linear algebra rounds by where in memory the arrays lie.
    np.testing.assert_allclose(found.q[1], single.q, atol=1e-8)


def test_every_task_takes_many_targets():
    poses = hands(6, seed=2)
    postures = np.random.default_rng(5).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (6, 15))
    for tasks in (
        pk.ik.HandPose("left", poses),
        pk.ik.FrameOrientation("LArm_effector", poses[:, :3, :3]),
        pk.ik.Point("left", poses[:, :3, 0]),
        pk.ik.LookAt(poses[:, :3, 3] + (0.5, 0.0, 0.0)),
        pk.ik.JointPosture(postures),
    ):
        found = pk.ik.solve_batch(PEPPER, tasks, collisions=False)
        assert found.success.all()
        for i in range(6):
            assert all(error.met for error in found.result(i).errors)
            assert CODES[found.codes[i]] is pk.ik.IKStatus.SOLVED


def test_a_row_that_fails_says_why_as_solve_does():
    """A batch called contradictory tasks beyond reach, and named nothing that is in the way."""
    pepper = pk.load_pepper()
    points, other = [(0.3, 0.3, 0.9), (9.0, 0.0, 0.0)], (0.3, 0.1, 0.9)
    tasks = [pk.ik.HandPosition("left", np.array(points)), pk.ik.HandPosition("left", np.tile(other, (2, 1)))]
    found = pk.ik.solve_batch(pepper, tasks)
    for row, point in enumerate(points):
        single = pk.ik.solve(pepper, [pk.ik.HandPosition("left", point), pk.ik.HandPosition("left", other)])
        assert found.result(row).conflict == single.conflict
        assert found.result(row).advice == single.advice
    assert "contradict each other" in found.result(0).report()

    scene = pk.Scene().add_box("box", (0.3, 0.3, 0.3), (0.45, 0.2, 0.85))
    for target, options in (
        (pk.ik.HandPosition("left", (0.45, 0.2, 0.85)), {"scene": scene, "margin": 0.01}),
        (pk.ik.HandPosition("left", (0.45, 0.2, 0.5)), {"joints": "left_arm"}),
    ):
        single = pk.ik.solve(pepper, target, **options)
        row = pk.ik.solve_batch(pepper, pk.ik.HandPosition("left", target.target[None]), **options).result(0)
        assert single.hint
        assert row.hint == single.hint


def test_no_targets_is_an_empty_result():
    found = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", np.empty((0, 3))), collisions=False)
    assert found.q.shape == (0, 15)
    assert found.errors.shape == (0, 1)
    assert len(found) == 0


def test_misuse_is_refused_by_name():
    points = hands(4)[:, :3, 3]
    task = pk.ik.HandPosition("left", points)
    with pytest.raises(InvalidValueError, match="4 targets, expected one target; `solve_batch` takes many"):
        pk.ik.solve(PEPPER, task, collisions=False)
    with pytest.raises(InvalidValueError, match="`solve` takes one"):
        pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points[0]), collisions=False)
    with pytest.raises(InvalidValueError, match=r"targets of left hand: 4, targets of gaze.*: 3"):
        pk.ik.solve_batch(PEPPER, [task, pk.ik.LookAt(points[:3])], collisions=False)
    with pytest.raises(InvalidValueError, match="start: 2"):
        pk.ik.solve_batch(PEPPER, task, np.tile(PEPPER.neutral(), (2, 1)), collisions=False)
    with pytest.raises(InvalidValueError, match=r"target of left hand: got nan"):
        pk.ik.HandPosition("left", np.where(np.eye(3) > 0, np.nan, 0.0))
    with pytest.raises(InvalidValueError, match=r"target of left hand: got shape \(4, 2\)"):
        pk.ik.HandPosition("left", points[:, :2])
    with pytest.raises(InvalidValueError, match="direction of left hand"):
        pk.ik.Point("left", np.zeros((2, 3)))
    with pytest.raises(LimitError, match="start"):
        pk.ik.solve_batch(PEPPER, task, np.full(15, 0.5), collisions=False)
    with pytest.raises(InvalidValueError, match="threads"):
        pk.ik.solve_batch(PEPPER, task, threads=0, collisions=False)
