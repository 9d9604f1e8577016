"""The main job by others' libraries: each is called, and agrees with the machine code that is the default."""

import json

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import collision, dynamics, kinematics
from pepper_kin.collision.fast import FastChecker
from pepper_kin.collision.loads import carrying
from pepper_kin.core.collision.check import set_margins
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.jobs.demo import demo_scene
from pepper_kin.twin import pinocchio_step
from pepper_kin.twin.world import World

FAST = pk.load_pepper()
BY_THE_FIELD = FAST.with_solvers("reference")
KINDS = [{}, {"hands": "mimic"}, {"base": "planar"}]


def states(robot, count, seed=0):
    rng = np.random.default_rng(seed)
    low, high = np.maximum(robot.lower_limits, -1.0), np.minimum(robot.upper_limits, 1.0)
    return rng.uniform(low, high, (count, robot.n)), *rng.normal(size=(2, count, robot.n))


def motion_of(robot):
    goal = robot.joint_vector({"LShoulderPitch": 0.5, "HeadYaw": 0.4})
    return pk.retime(robot, [robot.posture("Stand"), goal])


@pytest.mark.thorough
def test_the_main_job_is_done_by_others_and_certified_by_both(monkeypatch):
    """The compiled check of collisions raises; placo, toppra, RNEA and CRBA are counted."""
    calls = dict.fromkeys(("rnea", "crba", "nonLinearEffects"), 0)

    def counted(name, function):
        def call(*arguments):
            calls[name] += 1
            return function(*arguments)

        return call

    def refuse(*_):
        raise AssertionError("the compiled check was called")

    for name in ("_verdicts", "_verdict", "of_motion"):
        monkeypatch.setattr(FastChecker, name, refuse)
    for module, names in ((pk.dynamics.inverse, ["rnea"]), (pinocchio_step, ["crba", "nonLinearEffects"])):
        for name in names:
            monkeypatch.setattr(module.pinocchio, name, counted(name, getattr(pinocchio, name)))
    found = pk.jobs.run_demo(pk.load_pepper().with_solvers("reference"))
    assert found.success, found.message
    assert found.plan.ik.solver == "placo"
    assert found.figures["hand_error_m"] < 0.01
    assert calls["crba"] == calls["nonLinearEffects"] == len(found.run.time) - 1
    assert calls["rnea"] > 1000
    monkeypatch.undo()
    assert found.trajectory.check(FAST, demo_scene()).success


def test_toppra_times_and_asks_pinocchio(monkeypatch):
    toppra = pytest.importorskip("toppra.algorithm")
    made = []
    compute = toppra.TOPPRA.compute_parameterization
    monkeypatch.setattr(
        toppra.TOPPRA, "compute_parameterization", lambda *a, **k: made.append(1) or compute(*a, **k)
    )
    by_toppra, ours = motion_of(BY_THE_FIELD), motion_of(FAST)
    assert made
    assert by_toppra.duration == pytest.approx(ours.duration, rel=2e-3)
    assert by_toppra.is_close(pk.retime(FAST, [by_toppra.start, by_toppra.end], solver="toppra"), 1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("options", KINDS, ids=str)
def test_dynamics_and_kinematics_of_batches_are_pinocchios(options):
    robot = pk.load_pepper(**options)
    q, v, a = states(robot, 60)
    other = robot.with_solvers("reference")
    for function, inputs in (
        (dynamics.inverse_dynamics, (q, v, a)),
        (dynamics.forward_dynamics, (q, v, a)),
        (dynamics.mass_matrix, (q,)),
        (dynamics.base_wrench, (q, v, a)),
        (dynamics.center_of_mass, (q,)),
        (lambda r, q: kinematics.frame_jacobian(r, q, "l_gripper"), (q,)),
    ):
        found = function(other, *inputs)
        np.testing.assert_allclose(found, function(robot, *inputs), rtol=1e-9, atol=1e-9)
    by_name = dynamics.inverse_dynamics(robot, q[0], v[0], a[0], solver="pinocchio")
    np.testing.assert_array_equal(dynamics.inverse_dynamics(other, q[0], v[0], a[0]), by_name)


def test_verdicts_are_coals():
    q, scene = states(FAST, 500)[0], demo_scene()
    fast = collision.in_collision(FAST, q, scene)
    np.testing.assert_array_equal(collision.in_collision(BY_THE_FIELD, q, scene), fast)
    assert fast.any()
    assert not fast.all()


@pytest.mark.thorough
@pytest.mark.parametrize("options", KINDS, ids=str)
def test_a_run_of_the_twin_is_the_same(options):
    robot = pk.load_pepper(**options)
    motion = motion_of(robot)
    for more in ({}, {"payload": {"left": 0.3}}):
        ours = pk.Twin(robot, **more).execute(motion, hold_time=0.2)
        other = pk.Twin(robot.with_solvers("reference"), **more).execute(motion, hold_time=0.2)
        np.testing.assert_allclose(other.position, ours.position, rtol=0, atol=1e-11)
        np.testing.assert_allclose(other.torque, ours.torque, rtol=0, atol=1e-8)


def test_a_twin_that_meets_a_wall_is_the_same():
    scene = pk.Scene().add_box("wall", (0.05, 1.0, 0.5), (0.30, 0.1, 0.9))
    goal = {"LShoulderPitch": 0.0, "LElbowRoll": -0.1}
    motion = pk.retime(FAST, [FAST.posture("Stand"), FAST.joint_vector(goal)])
    runs = [
        pk.Twin(robot, world=World(robot, scene)).execute(motion, hold_time=0.2)
        for robot in (FAST, BY_THE_FIELD)
    ]
    assert np.abs(runs[0].position - runs[0].reference_position).max() > 0.1
    np.testing.assert_allclose(runs[1].position, runs[0].position, rtol=0, atol=1e-6)


def test_what_is_carried_counts():
    q, v, a = states(FAST, 40)
    loads = collision.loads_of(FAST, None, {"left": 0.4, "r_gripper": 0.2})
    expected = dynamics.newton_euler(FAST, q, v, a, loads)
    heavy = carrying(BY_THE_FIELD, loads)
    np.testing.assert_allclose(dynamics.inverse_dynamics(heavy, q, v, a), expected, atol=1e-9)
    motion, payload = motion_of(FAST), {"left": 0.3}
    certificates = [motion.check(robot, payload=payload) for robot in (FAST, BY_THE_FIELD)]
    for name in ("torque", "balance"):
        ours, others = (getattr(one, name) for one in certificates)
        np.testing.assert_allclose(others.value, ours.value, rtol=0, atol=1e-8)


def test_masses_of_a_batch_that_are_scaled_are_refused():
    with pytest.raises(InvalidValueError, match="'fast' where masses of a batch are scaled"):
        pk.twin.TwinBatch(BY_THE_FIELD, 2, mass_scale={"HeadYaw": 1.1})


def test_other_names_are_refused():
    with pytest.raises(InvalidValueError, match=r"solvers: got 'referenz', expected one of 'fast', 'refer"):
        FAST.with_solvers("referenz")


@pytest.mark.thorough
def test_the_command_takes_the_word(run, tmp_path):
    done = run("demo", "-o", "out", "--solvers", "reference", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["success"]


def test_a_plan_writes_no_margins_where_nothing_is_compiled():
    """The search wrote them through an empty block, into memory of others."""
    empty = np.empty(0)
    set_margins.python(empty, 0.01, 0.0, 0.1)  # in Python, where an index is checked
    assert empty.size == 0


@pytest.mark.parametrize("many", [False, True])
def test_what_a_step_raises_ends_the_run_as_itself(monkeypatch, many):
    """Ctrl-C within Pinocchio was printed, and the run called diverged."""

    def interrupted(*_):
        raise KeyboardInterrupt

    q = BY_THE_FIELD.posture("Stand")
    twin = pk.Twin(BY_THE_FIELD)
    twin.step(q)
    monkeypatch.setattr(pinocchio_step.pinocchio, "crba", interrupted)
    with pytest.raises(KeyboardInterrupt):
        twin.execute(motion_of(FAST)) if many else twin.step(q)
