"""Statuses: never better than the recomputed errors, and honest about what is proven."""

import math
import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.ik import IKStatus
from pepper_kin.ik.fast.compiled_tasks import squared_tolerance
from pepper_kin.ik.solvers import ALL_SOLVERS

PEPPER = pk.load_pepper()
HERE = np.array((0.40, 0.20, 0.85))
TABLE = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))


EDGE = {
    "position": lambda tolerance: pk.ik.HandPosition("left", HERE, tolerance=tolerance),
    "orientation": lambda tolerance: pk.ik.FrameOrientation("LArm_effector", np.eye(3), tolerance=tolerance),
    "direction": lambda tolerance: pk.ik.Point("left", (0.3, 0.2, 1.0), tolerance=tolerance),
    "gaze": lambda tolerance: pk.ik.LookAt((1.0, 0.7, 0.4), tolerance=tolerance),
    "relative": lambda tolerance: pk.ik.RelativePosition(
        "LArm_effector", "RArm_effector", (0.1, 0.2, 0.3), tolerance=tolerance
    ),
    "mass": lambda tolerance: pk.ik.CenterOfMass((0.1, 0.05), tolerance=tolerance),
    "posture": lambda tolerance: pk.ik.JointPosture((0.7,), ("LElbowYaw",), tolerance=tolerance),
}


@pytest.mark.parametrize("solver", ALL_SOLVERS)
@pytest.mark.parametrize("kind", EDGE)
def test_solved_means_recomputed_errors_within_the_tolerance_to_the_last_bit(kind, solver):
    """Joints that change nothing: the error stays, and the tolerance is it, or a few bits more or less."""
    generator = np.random.default_rng(6)
    met = 0
    for _ in range(10 if solver == "fast" else 2):
        q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        error = EDGE[kind](1.0).error(PEPPER, q)
        bits = [
            np.nextafter(error, 0),
            error,
            np.nextafter(error, 9),
            error * (1 - 1e-12),
            error * (1 + 1e-8),
        ]
        for tolerance in bits:
            options = {"joints": "RWristYaw", "solver": solver, "collisions": False, "restarts": 0}
            result = pk.ik.solve(PEPPER, EDGE[kind](tolerance), q, **options)
            met += result.success
            assert EDGE[kind](tolerance).error(PEPPER, result.q) <= tolerance or not result.success
            assert result.errors[0].met or not result.success
            many = pk.ik.solve_batch(PEPPER, EDGE[kind](tolerance), np.tile(q, (2, 1)), **options)
            assert list(many.success) == [result.success] * 2
    assert met > 0


def test_machine_code_compares_with_less_than_the_tolerance():
    for allowed in (1e-14, 1e-12, 1e-9, 1e-3, 1.0, 1e9):
        assert 0.2 * allowed**2 < squared_tolerance(allowed) < allowed**2
    assert squared_tolerance(math.inf) == math.inf


def test_a_search_that_saw_another_robot_is_found_out(monkeypatch):
    """The errors are recomputed; a status that they contradict cannot be had beside them."""
    import pepper_kin.ik.fast.search as search

    other = pk.load_pepper(base="planar")
    assert other.n != PEPPER.n
    plain = search.compiled_tasks
    wrong = pk.ik.FramePosition("RArm_effector", HERE * (1, -1, 1))
    monkeypatch.setattr(search, "compiled_tasks", lambda pepper, tasks: plain(pepper, [wrong]))
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", HERE * (1, -1, 1)), collisions=False)
    assert result.status is IKStatus.SOLVED  # of the other hand
    with pytest.raises(ModelError, match=r"position of left hand for met, but its error is .* allowed"):
        result.report()
    with pytest.raises(ModelError):
        _ = result.errors


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_contradictory_tasks_are_named(solver):
    far = (0.40, 0.05, 0.90)
    tasks = [
        pk.ik.LookAt((1.0, 0.0, 1.0)),
        pk.ik.HandPosition("left", HERE),
        pk.ik.FramePosition("LArm_effector", far, label="the palm"),
    ]
    result = pk.ik.solve(PEPPER, tasks, solver=solver, collisions=False, restarts=4)
    assert not result.success
    assert result.conflict == ("position of left hand", "position of the palm")
    report = result.report()
    assert "position of left hand and position of the palm contradict each other" in report
    assert report.startswith("not reached: tasks contradict each other")
    assert "leave one out" in result.advice
    for left_out in (1, 2):
        rest = [task for k, task in enumerate(tasks) if k != left_out]
        assert pk.ik.solve(PEPPER, rest, solver=solver, collisions=False, restarts=4).success


def test_a_task_beyond_reach_contradicts_nothing():
    tasks = [pk.ik.HandPosition("left", (3.0, 0.0, 1.0)), pk.ik.LookAt((1.0, 0.0, 1.0))]
    result = pk.ik.solve(PEPPER, tasks, collisions=False)
    assert result.conflict == ()
    assert result.report().startswith("not reached: beyond reach")


def test_the_report_tells_proven_from_searched():
    far = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (3.0, 0.0, 1.0)), collisions=False)
    proven = re.search(
        r"proven by the lengths of the links: no posture brings left hand nearer than", far.report()
    )
    assert proven is not None
    assert far.proof in far.report()
    low = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (0.45, 0.2, 0.70)), scene=TABLE)
    assert low.status is IKStatus.CLOSEST_COLLISION
    assert low.proof == ""
    words = f"the best of {low.restarts + 1} starts: that there is no closer one is not proven"
    assert words in low.report()
    met = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", HERE), collisions=False)
    assert "proven" not in met.report()


def test_the_closest_point_beside_obstacles_hardly_depends_on_the_seed():
    """Targets in a table: where one seed came to 17 cm and another to 11, 9 cm were possible."""
    for point in ((0.45, 0.2, 0.70), (0.6, 0.1, 0.70)):
        distances = []
        for seed in range(4):
            result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=TABLE, seed=seed)
            assert result.status is IKStatus.CLOSEST_COLLISION
            assert not pk.collision.in_collision(PEPPER, result.q, TABLE)
            distances.append(result.errors[0].value)
        assert np.ptp(distances) < 0.01, (point, distances)


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_groups_and_names_in_a_posture(solver):
    arm = PEPPER.joint_group("right_arm")
    target = [0.5, -0.4, 0.3, 0.8, 0.2, 0.1]
    task = pk.ik.JointPosture(target, joints=["right_arm", "HeadYaw"])
    same = pk.ik.JointPosture(target, joints=[*arm, "HeadYaw"])
    results = [pk.ik.solve(PEPPER, t, solver=solver, collisions=False) for t in (task, same)]
    assert results[0].success
    np.testing.assert_array_equal(results[0].q, results[1].q)
    got = results[0].q[[PEPPER.joint_index(name) for name in (*arm, "HeadYaw")]]
    np.testing.assert_allclose(got, target, atol=0.01)
    q = np.tile(target, (3, 1)) * [[1.0], [0.9], [0.8]]
    found = pk.ik.solve_batch(
        PEPPER, pk.ik.JointPosture(q, joints=["right_arm", "HeadYaw"]), collisions=False
    )
    assert found.success.all()
    with pytest.raises(
        InvalidValueError, match=r"posture: got shape \(2,\), expected shape \(6,\), for RShoulder"
    ):
        pk.ik.solve(PEPPER, pk.ik.JointPosture([0.1, 0.2], joints=["right_arm", "HeadYaw"]), collisions=False)


@pytest.mark.parametrize("batch", [False, True])
def test_the_first_report_of_a_process_counts_no_loading(child, batch):
    """It was 1.5 s for 0.2 ms; what is loaded is most of the whole call."""
    program = """
import sys, time
import numpy as np, pepper_kin as pk
pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.4))
target = np.array([[0.38, 0.22, 0.82]] * 2)
begin = time.perf_counter()
if sys.argv[1] == "True":
    result = pk.ik.solve_batch(pepper, [pk.ik.HandPosition("left", target)], scene=scene)
else:
    result = pk.ik.solve(pepper, [pk.ik.HandPosition("left", target[0])], scene=scene)
print(result.time / (time.perf_counter() - begin))
"""
    assert float(child(program, batch).stdout) < 0.5
