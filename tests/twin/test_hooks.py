"""Hooks of the twin: pushes, a world, sensors."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin import Integrator, Twin, actuator_parameters


class SpringWorld:
    """Holds one joint with a spring, and records its arguments."""

    def __init__(self, joint, stiffness=0.0, rest=0.0):
        self.joint, self.stiffness, self.rest, self.calls = joint, stiffness, rest, []

    def advance(self, q, v, mass_hat, force, h):
        self.calls.append((q, v, mass_hat, force, h))
        return -self.stiffness * (q[self.joint] - self.rest) * (np.arange(q.size) == self.joint)


class Diary:
    def __init__(self):
        self.states = []

    def observe(self, state):
        self.states.append(state)


@pytest.mark.parametrize("substeps", [1, 3])
def test_linear_equation_given_to_the_world_is_the_step(pepper, substeps):
    wall = SpringWorld(3)
    twin = Twin(pepper, world=wall, substeps=substeps)
    alone = Twin(pepper, substeps=substeps)
    target = pepper.posture("Stand") + 0.3  # saturates some
    for _ in range(5):
        before = len(wall.calls)
        state = twin.step(target)
        assert len(wall.calls) == before + substeps
        v = wall.calls[before][1]
        for _, _, mass_hat, force, h in wall.calls[before:]:
            np.testing.assert_allclose(mass_hat, mass_hat.T, atol=1e-12)
            assert np.linalg.eigvalsh(mass_hat).min() > 0
            assert h == pytest.approx(1e-3 / substeps)
            v = v + h * np.linalg.solve(mass_hat, force)
        np.testing.assert_allclose(state.velocity, v, atol=1e-9)
        np.testing.assert_allclose(state.position, alone.step(target).position, atol=1e-12)


def test_load_of_the_world_is_felt(pepper):
    params = actuator_parameters(pepper)
    j = pepper.joint_index("HeadYaw")
    rest = pepper.posture("Stand")
    twin = Twin(pepper, world=SpringWorld(j, 1000.0, rest[j]))
    target = rest + 0.002 * (np.arange(15) == j)
    for _ in range(600):
        state = twin.step(target)
    part = params.stiffness[j] / (params.stiffness[j] + 1000.0)
    assert state.position[j] - rest[j] == pytest.approx(0.002 * part, rel=1e-6)


def test_acceleration_of_the_step_follows_from_the_equation(pepper):
    rng = np.random.default_rng(2)
    integrator = Integrator(pepper, 2e-3, actuator_parameters(pepper, "motor"))
    for _ in range(5):
        q = pepper.posture("Stand") + 0.05 * rng.normal(size=15)
        v, load = rng.normal(size=15), rng.normal(size=15)
        q_ref, v_ref, forward = q + 0.02 * rng.normal(size=15), rng.normal(size=15), rng.normal(size=15)
        mass_hat, force = integrator.linearized(q, v, q_ref, v_ref, forward, load)
        v_next = integrator.step(q, v, q_ref, v_ref, forward, load)[1]
        np.testing.assert_allclose(v_next, v + 2e-3 * np.linalg.solve(mass_hat, force), atol=1e-9)


@pytest.mark.parametrize("substeps", [1, 2])
def test_sensors_see_every_state_once(pepper, substeps):
    diary = Diary()
    twin = Twin(pepper, sensors=diary, substeps=substeps)
    target = np.tile(pepper.posture("Stand") + 0.05, (20, 1))
    run = twin.follow(target)
    assert len(diary.states) == 21
    np.testing.assert_allclose([s.time for s in diary.states], run.time)
    np.testing.assert_array_equal([s.position for s in diary.states], run.position)
    np.testing.assert_array_equal([s.torque for s in diary.states], run.torque)
    rates = np.diff(run.velocity, axis=0) / 1e-3
    np.testing.assert_allclose([s.acceleration for s in diary.states[1:]], rates, atol=1e-9)
    assert not diary.states[0].acceleration.any()


def test_push_is_the_transposed_jacobian_times_the_force(pepper):
    """Static deflection of the servos: K dq = J^T f, also off the frame's origin."""
    force, point = np.array([2.0, -1.0, 1.5]), np.array([0.03, 0.01, -0.02])
    twin = Twin(pepper)
    twin.push("LArm_effector", force, point, duration=np.inf)
    q = pepper.posture("Stand")
    for _ in range(1500):
        state = twin.step(q)
    jacobian = pk.kinematics.frame_jacobian(pepper, state.position, "LArm_effector")
    rotation = pk.kinematics.frame_pose(pepper, state.position, "LArm_effector")[:3, :3]
    load = jacobian.T @ np.concatenate([force, np.cross(rotation @ point, force)])
    deflection = load / actuator_parameters(pepper).stiffness
    np.testing.assert_allclose(state.position - q, deflection, atol=2e-6)
    assert np.abs(deflection).max() > 1e-4


def test_push_acts_in_its_time_and_no_longer(pepper):
    q = pepper.posture("Stand")
    twin = Twin(pepper)
    push = twin.push("LArm_effector", [0, 0, -5.0], start=0.01, duration=0.005)
    assert twin.pushes == (push,)
    run = twin.follow(np.tile(q, (40, 1)))
    moved = np.abs(run.position - q).max(axis=1)
    assert moved[:11].max() < 1e-12
    assert moved[11] > 1e-7
    rates = np.diff(run.velocity, axis=0) / 1e-3
    needed = pk.dynamics.newton_euler(pepper, run.position[:-1], run.velocity[:-1], rates)
    outside = np.abs(needed - run.torque[1:]).max(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(outside > 1e-6), range(10, 15))
    stepped = Twin(pepper)
    stepped.push("LArm_effector", [0, 0, -5.0], start=0.01, duration=0.005)
    for k in range(1, 41):
        np.testing.assert_array_equal(stepped.step(q).position, run.position[k])
    twin.clear_pushes()
    twin.reset()
    assert np.abs(twin.follow(np.tile(q, (40, 1))).position - q).max() < 1e-12


def test_a_push_survives_the_reset_of_execute(pepper):
    goal = pepper.joint_vector({"HeadYaw": 0.3})
    trajectory = pk.retime(pepper, [pepper.posture("Stand"), goal], solver="toppra")
    twin = Twin(pepper)
    plain = twin.execute(trajectory)
    twin.push("LArm_effector", [0, 0, -5.0], start=0.1, duration=0.05)
    pushed = twin.execute(trajectory)
    difference = np.abs(plain.position - pushed.position).max(axis=1)
    assert difference[:101].max() < 1e-12
    assert difference[110] > 1e-5


def test_wrong_pushes_are_refused(pepper):
    twin = Twin(pepper)
    with pytest.raises(UnknownNameError, match="unknown frame 'Nose'"):
        twin.push("Nose", [0, 0, 1])
    for wrong, message in [
        ({"force": [0, np.nan, 1]}, "force: got nan"),
        ({"force": [0, 1]}, r"force: got shape \(2,\)"),
        ({"force": [0, 0, 1], "duration": 0.0}, "duration: got 0.0, expected a time above 0 s"),
        ({"force": [0, 0, 1], "duration": np.nan}, "duration: got nan"),
        ({"force": [0, 0, 1], "start": np.inf}, "start: got inf"),
        ({"force": [0, 0, 1], "point": [0, 0]}, "point: got shape"),
        ({"force": [0, 0, 1e10]}, "force: got 10000000000.0, expected numbers from"),
        (
            {"force": [0, 0, 1e6], "point": [1e4, 0, 0]},
            r"force: got 1e\+06 N at a point 10000 m away, .* N m",
        ),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            twin.push("Head", **wrong)
    assert twin.pushes == ()


def test_bad_numbers_of_substeps_are_refused(pepper):
    for substeps in [0, -1, 1.5, True, "two"]:
        with pytest.raises(InvalidValueError, match=r"substeps: got .* expected an integer of at least 1"):
            Twin(pepper, substeps=substeps)
