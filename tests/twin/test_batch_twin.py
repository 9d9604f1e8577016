"""Many twins at once: each is the single twin with its parameters."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.twin import RunStatus, Twin, TwinBatch, actuator_parameters

COUNT = 7


@pytest.fixture(scope="module")
def trajectory(pepper):
    goal = pepper.joint_vector({"LShoulderPitch": 0.4, "LElbowRoll": -0.9, "HeadYaw": 0.6, "HipPitch": -0.2})
    return pk.retime(pepper, [pepper.posture("Stand"), goal], solver="toppra")


def same(batch, robot, single):
    np.testing.assert_allclose(batch.position[robot], single.position, atol=1e-9)
    np.testing.assert_allclose(batch.velocity[robot], single.velocity, atol=1e-9)
    np.testing.assert_allclose(batch.torque[robot], single.torque, atol=1e-7)


@pytest.mark.parametrize("settings", [{}, {"feedforward": "inverse_dynamics"}, {"substeps": 2}])
def test_each_is_the_single_twin(pepper, trajectory, settings):
    run = TwinBatch(pepper, COUNT, **settings).execute(trajectory, 0.05, every=1)
    single = Twin(pepper, **settings).execute(trajectory, 0.05)
    assert run.success.all()
    np.testing.assert_allclose(run.time, single.time)
    for robot in range(COUNT):
        same(run, robot, single)
    np.testing.assert_allclose(run.rms_error[2], single.rms_error, atol=1e-9)
    np.testing.assert_array_equal(run.final_position, run.position[:, -1])
    assert run.report() == f"7 twins, {run.time[-1]:.3f} s: 7 completed, 0 stopped"


def test_each_has_its_own_parameters_states_and_references(pepper):
    rng = np.random.default_rng(0)
    base = actuator_parameters(pepper, "motor")
    vary = {
        "stiffness": base.stiffness * rng.uniform(0.5, 2, (COUNT, 1)),
        "coulomb_friction": {"HeadYaw": rng.uniform(0, 1, COUNT), "LElbowRoll": 0.2},
        "torque_limit": base.torque_limit * rng.uniform(0.3, 1, (COUNT, 15)),
        "strength": rng.uniform(0.5, 1, (COUNT, 1)),
    }
    start = pepper.posture("Stand") + 0.05 * rng.uniform(-1, 1, (COUNT, 15))
    speed = 0.2 * rng.normal(size=(COUNT, 15))
    target = (
        start[:, np.newaxis] + 0.3 * rng.normal(size=(COUNT, 1, 15)) * np.linspace(0, 1, 60)[:, np.newaxis]
    )
    load = rng.normal(size=(COUNT, 60, 15))
    batch = TwinBatch(pepper, COUNT, 2e-3, actuators=base, vary=vary)
    batch.reset(start, speed)
    run = batch.follow(target, load=load, every=1)
    for robot in range(COUNT):
        friction = {"HeadYaw": vary["coulomb_friction"]["HeadYaw"][robot], "LElbowRoll": 0.2}
        params = base.changed(
            stiffness=vary["stiffness"][robot],
            coulomb_friction=friction,
            torque_limit=vary["torque_limit"][robot],
            strength=vary["strength"][robot, 0],
        )
        twin = Twin(pepper, 2e-3, actuators=params)
        twin.reset(start[robot], speed[robot])
        single = twin.follow(target[robot], load=load[robot])
        assert single.status is not RunStatus.STOPPED
        same(run, robot, single)
    assert np.ptp(run.final_position, axis=0).min() > 1e-3


@pytest.mark.thorough
@pytest.mark.parametrize("hands", ["locked", "mimic"])
def test_masses_and_payloads_are_those_of_a_changed_model(hands):
    """M a + b = tau with inertias scaled, and point masses added, by Pinocchio."""
    robot = pk.load_pepper(hands=hands)
    rng = np.random.default_rng(1)
    factor, whole, held = rng.uniform(0.5, 2, 5), rng.uniform(0.8, 1.2, 5), rng.uniform(0, 1, 5)
    batch = TwinBatch(
        robot,
        5,
        mass_scale={"LElbowRoll": factor, "head": whole},
        payload={"LArm_effector": held, "torso": 2.0},
    )
    middle = (robot.lower_limits + robot.upper_limits) / 2
    start = middle + 0.1 * rng.uniform(-1, 1, (5, robot.n))
    v = rng.normal(size=(5, robot.n))
    batch.reset(start, v)
    run = batch.follow(start[:, np.newaxis], every=1)
    for k in range(5):
        scales = dict.fromkeys(robot.joint_group("head"), whole[k]) | {"LElbowRoll": factor[k]}
        model = changed(robot, scales, {"LArm_effector": held[k], "torso": 2.0})
        a = (run.velocity[k, 1] - v[k]) / 1e-3
        full = robot.full_map
        tau = pinocchio.rnea(
            model, model.createData(), full @ start[k] + robot.full_offset, full @ v[k], full @ a
        )
        np.testing.assert_allclose(tau @ full, run.torque[k, 1], atol=1e-7)


def changed(robot, scales, payload):
    model = pinocchio.Model(robot.pinocchio_model)
    for i in range(1, model.njoints):
        joint = robot.joint_names[int(np.abs(robot.full_map[i - 1]).argmax())]
        inertia = model.inertias[i]
        s = scales.get(joint, 1.0)
        model.inertias[i] = pinocchio.Inertia(s * inertia.mass, inertia.lever, s * inertia.inertia)
    for frame, mass in payload.items():
        place = model.frames[robot.frame_id(frame)]
        extra = pinocchio.Inertia(mass, place.placement.translation, np.zeros((3, 3)))
        model.inertias[place.parentJoint] = model.inertias[place.parentJoint] + extra
    return model


def test_threads_and_neighbors_change_nothing(pepper, trajectory):
    lone = TwinBatch(pepper, 2).execute(trajectory, every=10)
    many = TwinBatch(pepper, 13).execute(trajectory, every=10, threads=2)
    for robot in range(13):
        np.testing.assert_array_equal(many.position[robot], lone.position[0])


def test_latency_goes_on_from_one_call_to_the_next(pepper, trajectory):
    late = actuator_parameters(pepper).changed(latency=0.005)
    batch, twin = TwinBatch(pepper, 3, actuators=late), Twin(pepper, actuators=late)
    rng = np.random.default_rng(0)
    for _ in range(3):
        target = pepper.posture("Stand") + 0.02 * rng.normal(size=(4, 15))
        run, single = batch.follow(target, every=1), twin.follow(target)
        same(run, 1, single)


def test_rows_are_recorded_as_wanted(pepper):
    target = np.tile(pepper.posture("Stand") + 0.01, (10, 1))
    full = TwinBatch(pepper, 2).follow(target, every=1)
    third = TwinBatch(pepper, 2).follow(target, every=3)
    ends = TwinBatch(pepper, 2).follow(target)
    assert full.position.shape == (2, 11, 15)
    np.testing.assert_allclose(third.time, [0, 0.003, 0.006, 0.009])
    np.testing.assert_array_equal(third.position, full.position[:, ::3])
    np.testing.assert_array_equal(third.final_position, full.position[:, -1])
    np.testing.assert_allclose(ends.time, [0, 0.01])
    np.testing.assert_array_equal(ends.torque[:, 1], full.torque[:, -1])


def test_one_that_diverges_stops_alone(pepper):
    load = np.zeros((3, 8, 15))
    load[1, 4, 4] = 1e9
    run = TwinBatch(pepper, 3).follow(np.tile(pepper.posture("Stand"), (8, 1)), load=load, every=1)
    np.testing.assert_array_equal(run.success, [True, False, True])
    np.testing.assert_array_equal(run.good_steps, [8, 4, 8])
    assert run.messages[1].startswith("twin stopped at step 5 (0.005 s): HeadPitch: velocity became ")
    assert "3 twins, 0.008 s: 2 completed, 1 stopped; robot 1: twin stopped" in run.report()
    assert np.isfinite(run.position[1, :5]).all()
    assert np.isnan(run.position[1, 5:]).all()
    np.testing.assert_array_equal(run.final_position[1], run.position[1, 4])
    np.testing.assert_array_equal(run.position[0], run.position[2])
    ends = TwinBatch(pepper, 3).follow(np.tile(pepper.posture("Stand"), (8, 1)), load=load)
    assert ends.messages == run.messages


@pytest.mark.parametrize("rows", [[4, 1], np.array([False, True, False, False, True, False, False])])
@pytest.mark.parametrize("latency", [0.0, 0.006])
def test_some_robots_are_put_elsewhere_and_the_others_go_on(pepper, rows, latency):
    """Those put elsewhere do what a new twin does there; the others as without a reset, to the bit."""
    rng = np.random.default_rng(2)
    stand = pepper.posture("Stand")
    actuators = actuator_parameters(pepper, "motor").changed(latency=latency)
    first, then = (stand + 0.05 * rng.normal(size=(COUNT, 30, 15)) for _ in range(2))
    start = stand + 0.05 * rng.uniform(-1, 1, (2, 15))
    speed = 0.1 * rng.normal(size=(2, 15))
    batch, undisturbed = (TwinBatch(pepper, COUNT, 2e-3, actuators=actuators) for _ in range(2))
    before = batch.follow(first)
    undisturbed.follow(first)
    kept = before.final_position.copy()
    batch.reset(start, speed, rows=rows)
    np.testing.assert_array_equal(before.final_position, kept)
    run, other = batch.follow(then, every=1), undisturbed.follow(then, every=1)
    places = [4, 1] if isinstance(rows, list) else [1, 4]
    for k, robot in enumerate(places):
        twin = Twin(pepper, 2e-3, actuators=actuators)
        twin.reset(start[k], speed[k])
        same(run, robot, twin.follow(then[robot]))
    rest = np.setdiff1d(np.arange(COUNT), places)
    for quantity in ("position", "velocity", "torque"):
        np.testing.assert_array_equal(getattr(run, quantity)[rest], getattr(other, quantity)[rest])


def test_one_posture_for_some_robots_and_none_for_no_robot(pepper):
    batch = TwinBatch(pepper, 3)
    crouch = pepper.posture("Crouch")
    batch.reset(crouch, rows=[2])
    stand = pepper.neutral()
    np.testing.assert_array_equal(batch.position, [stand, stand, crouch])
    batch.reset(rows=[])
    np.testing.assert_array_equal(batch.position, [stand, stand, crouch])
    batch.reset(rows=[2])
    np.testing.assert_array_equal(batch.position, [stand] * 3)
    batch.reset(np.array([crouch, stand, stand]), rows=[1, 0, 2])
    np.testing.assert_array_equal(batch.position, [stand, crouch, stand])


def test_wrong_rows_are_refused(pepper):
    batch = TwinBatch(pepper, 3)
    for rows in ([3], [-1], [0, 0], [0.5], [True, False], 1):
        with pytest.raises(InvalidValueError, match=r"rows: got .*numbers from 0 to 2, each once, or a mask"):
            batch.reset(rows=rows)
    with pytest.raises(
        InvalidValueError, match=r"q: got shape \(3, 15\), expected shape \(15,\) or \(2, 15\)"
    ):
        batch.reset(np.zeros((3, 15)), rows=[0, 1])


def test_what_is_wrong_is_refused(pepper, trajectory):
    batch = TwinBatch(pepper, 3)
    q = pepper.posture("Stand")
    for call, message in [
        (lambda: TwinBatch(pepper, 0), "count: got 0, expected an integer of at least 1"),
        (lambda: TwinBatch(pepper, 3, 0.1), "timestep: got 0.1 s"),
        (lambda: TwinBatch(pepper, 3, 0.0), "timestep: got 0.0"),
        (lambda: TwinBatch(pepper, 3, vary={"damping": np.ones(3)}), r"damping: got shape \(3,\)"),
        (
            lambda: TwinBatch(pepper, 3, vary={"damping": {"HeadYaw": [1, -1, 1]}}),
            "damping of HeadYaw of robot 1: got -1.0",
        ),
        (
            lambda: TwinBatch(pepper, 3, mass_scale={"HeadYaw": [1, 0, 1]}),
            "mass_scale of HeadYaw: got 0.0 of",
        ),
        (lambda: TwinBatch(pepper, 3, payload={"Head": [1, np.nan, 1]}), "payload of Head: got nan"),
        (
            lambda: batch.reset(np.tile(q, (2, 1))),
            r"q: got shape \(2, 15\), expected shape \(15,\) or \(3, 15\)",
        ),
        (lambda: batch.follow(q), r"position: got shape \(15,\), expected shape \(T, 15\) or \(3, T, 15\)"),
        (lambda: batch.follow(np.full((2, 15), np.nan)), "position: got nan at joint KneePitch"),
        (lambda: batch.follow(np.tile(q, (2, 1)), np.zeros((3, 15))), r"velocity: got shape \(3, 15\)"),
        (
            lambda: batch.follow(np.tile(q, (2, 1)), every=0),
            "every: got 0, expected an integer of at least 1",
        ),
        (lambda: batch.follow(np.tile(q, (2, 1)), threads=0), "threads: got 0"),
        (lambda: batch.execute(trajectory, -1), "hold_time: got -1"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            call()
    with pytest.raises(UnknownNameError, match="unknown joint or group 'tail'; available: KneePitch"):
        TwinBatch(pepper, 3, mass_scale={"tail": 2.0})
    with pytest.raises(UnknownNameError, match="unknown frame 'tail'"):
        TwinBatch(pepper, 3, payload={"tail": 2.0})
    with pytest.raises(UnknownNameError, match="unknown quantity of an actuator 'mode'"):
        TwinBatch(pepper, 3, vary={"mode": 1.0})
    with pytest.raises(LimitError, match="q: HeadYaw = 9 rad"):
        batch.reset(np.where(np.arange(15) == 3, 9.0, q))
