"""The linear equation that a world gets, a world that adds nothing, a world that stops."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin import Integrator, Recorder, Twin, actuator_parameters
from pepper_kin.twin.command import Command
from pepper_kin.twin.world import ContactError, World

H = 0.001
PEPPER = pk.load_pepper()


def states(seed, wild, count=20):
    """States, commands and loads; wild ones clip motors, touch stops and overcome friction."""
    rng = np.random.default_rng(seed)
    n, size = PEPPER.n, 0.3 if wild else 0.0005
    for _ in range(count):
        q, v = PEPPER.neutral() + size * rng.normal(size=n), 3 * size * rng.normal(size=n)
        rows = (q + size * rng.normal(size=n), *(3 * size * rng.normal(size=(2, n))))
        yield q, v, Command(*rows), size * rng.normal(size=n)


@pytest.mark.parametrize("wild", [False, True])
@pytest.mark.parametrize("kind", ["servo", "motor"])
def test_the_linear_equation_has_the_step_as_its_solution(kind, wild):
    """And without forces of actuators beyond its own, its matrix is Pinocchio's mass matrix with their
    slopes."""
    actuators = actuator_parameters(PEPPER, kind)
    integrator = Integrator(PEPPER, H, actuators)
    clipped = 0
    for q, v, command, load in states(2, wild):
        mass_hat, force = integrator.linearized(q, v, *command, load)
        _, w, torque = integrator.step(q, v, *command, load)
        np.testing.assert_allclose(mass_hat @ (w - v) / H, force, rtol=1e-9, atol=1e-8 * np.abs(force).max())
        slopes = mass_hat - pk.dynamics.mass_matrix(PEPPER, q)
        off = slopes - np.diag(np.diag(slopes))
        assert np.abs(off).max() < 1e-12
        assert np.diag(slopes).min() > -1e-12
        if kind == "servo" and not wild:
            due = H * (H * actuators.stiffness + actuators.damping)
            np.testing.assert_allclose(np.diag(slopes), due, rtol=1e-9)
        clipped += np.any(np.abs(torque) >= actuators.torque_limit * (1 - 1e-12))
    assert bool(clipped) == wild  # motors were clipped, or none was


class Nothing:
    """A world in which nothing is."""

    def advance(self, q, v, mass_hat, force, h):
        return np.zeros(len(q))


def test_a_world_that_adds_nothing_changes_no_bit():
    goal = PEPPER.joint_vector({"HeadYaw": 0.3, "LShoulderPitch": 0.8})
    target = np.tile(goal, (40, 1))
    alone = Twin(PEPPER).follow(target)
    far = World(PEPPER, pk.Scene().add_box("wall", (0.1, 2, 2), (3, 0, 1)))
    for world in (Nothing(), far):
        run = Twin(PEPPER, world=world).follow(target)
        for name in ("position", "velocity", "torque"):
            assert np.array_equal(getattr(run, name), getattr(alone, name)), name


def overflowing():
    """A world with arrays for 256 points in which 65 boxes, of four points each, land at once."""
    world = World(PEPPER, pk.Scene().add_box("deck", (4, 4, 0.1), (3, 0, 0.95)))
    for k in range(65):
        world.add_box(f"box {k}", (0.1, 0.1, 0.1), 1.0, (1.5 + 0.2 * (k % 13), 0.2 * (k // 13), 1.06))
    return world


@pytest.mark.thorough
def test_a_run_stops_where_its_world_does_and_keeps_what_went_before(tmp_path):
    target = np.tile(PEPPER.joint_vector({"HeadYaw": 0.1}), (100, 1))
    twin = Twin(PEPPER, world=overflowing())
    run = twin.follow(target)
    good = len(run) - 1
    # From 10 mm it falls to where 2 mm and one more step are left.
    assert 0.002 < 0.010 - 9.81 * (good * H) ** 2 / 2 < 0.004
    assert not run.success
    assert run.status.value == "stopped"
    assert run.message.startswith(f"twin stopped at step {good + 1} ({(good + 1) * H:.6g} s): world stopped")
    assert "more than 256 points" in run.message
    alone = Twin(PEPPER).follow(target[:good])
    assert np.array_equal(run.position, alone.position)
    assert np.array_equal(twin.state.position, run.position[-1])
    assert twin.state.time == pytest.approx(good * H)
    with pytest.raises(ContactError, match=f"world stopped at step {good + 2}: more than 256 points"):
        twin.step(target[0])
    assert twin.state.time == pytest.approx(good * H)
    recorder = Recorder(Twin(PEPPER, world=overflowing()), tmp_path / "r", chunk=0.02)
    kept = recorder.follow(target)
    assert kept.message == run.message
    assert np.array_equal(recorder.recording.run().position, run.position)
    recorder.recording.replay(Twin(PEPPER, world=overflowing()))


def test_a_trajectory_stops_likewise():
    trajectory = pk.retime(PEPPER, [PEPPER.posture("Stand"), PEPPER.joint_vector({"HeadYaw": 0.5})])
    run = Twin(PEPPER, world=overflowing(), substeps=2).execute(trajectory)
    assert run.status.value == "stopped"
    assert "more than 256 points" in run.message
    assert 30 < len(run) < 50


def test_a_robot_that_diverges_among_things_is_blamed_itself():
    world = World(PEPPER, pk.Scene().add_box("deck", (4, 4, 0.1), (3, 0, 0.95)))
    world.add_box("parcel", (0.1, 0.1, 0.1), 1.0, (3, 0, 1.05))
    twin = Twin(PEPPER, world=world)
    load = np.zeros((10, PEPPER.n))
    load[6:, PEPPER.joint_index("HeadYaw")] = 1e300
    with np.errstate(all="ignore"):
        run = twin.follow(np.tile(PEPPER.neutral(), (10, 1)), load=load)
    assert run.status.value == "stopped"
    assert len(run) == 7
    assert run.message.startswith("twin stopped at step 7 (0.007 s): HeadYaw")
