"""The scheme over long times and at its edges: energy, order, and what is refused or stopped."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin import Twin, actuator_parameters

CHAIN = """
<robot name="chain"><link name="world"/>
  <link name="a"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="Upper" type="continuous"><parent link="world"/><child link="a"/><axis xyz="0 1 0"/></joint>
  <joint name="Lower" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0 0 -0.6"/>
    <axis xyz="0 1 0"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def chain():
    return pk.load_robot(CHAIN)


def limp(robot):
    return actuator_parameters(robot).changed(stiffness=0.0, damping=0.0)


def energy(robot, run):
    kinetic = pk.dynamics.kinetic_energy(robot, run.position, run.velocity)
    return kinetic + pk.dynamics.potential_energy(robot, run.position)


@pytest.mark.parametrize("start", [[0.3, 0.0], [0.4, 0.2]])
def test_two_pendulums_swing_for_a_minute_without_drift(chain, start):
    """60 s without friction: energy swings by O(h) about where it was."""
    swing, drift = [], []
    for h in (1e-3, 5e-4):
        twin = Twin(chain, h, actuators=limp(chain), feedforward="none")
        twin.reset(start)
        run = twin.follow(np.zeros((round(60 / h), 2)))
        level = energy(chain, run)
        depth = np.ptp(pk.dynamics.potential_energy(chain, run.position))
        swing.append(np.abs(level - level[0]).max() / depth)
        parts = level[1:].reshape(6, -1).mean(axis=1)
        drift.append(np.abs(parts - parts[0]).max() / depth)
        assert np.abs(run.position).max() < 2
    assert swing[0] < 0.05
    assert swing[1] < 0.7 * swing[0]
    assert drift[0] < 0.03
    assert drift[1] < 0.7 * drift[0]


def test_substeps_converge_with_order_one(pepper):
    """The same references, ever finer sub-steps; against Richardson's limit."""
    compliant = actuator_parameters(pepper)
    compliant = compliant.changed(
        stiffness=compliant.stiffness / 20, damping=compliant.damping / 4, torque_limit=np.inf
    )
    target = np.tile(pepper.posture("Stand") + 0.05 * (-1.0) ** np.arange(15), (8, 1))

    def end(substeps):
        twin = Twin(pepper, 8e-3, actuators=compliant, substeps=substeps)
        return twin.follow(target).position[-1]

    best = 2 * end(320) - end(160)
    counts = np.array([10, 20, 40])
    errors = [np.linalg.norm(end(k) - best) for k in counts]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("h", [1e-3, 5e-3, 0.05])
def test_gains_however_high_stay_stable(pepper, h):
    """A million times the gains: the step becomes a jump to the reference."""
    params = actuator_parameters(pepper)
    hard = params.changed(stiffness=1e6 * params.stiffness, damping=1e3 * params.damping, torque_limit=np.inf)
    target = pepper.posture("Stand") + 0.05 * (-1.0) ** np.arange(15)
    run = Twin(pepper, h, actuators=hard).follow(np.tile(target, (200, 1)))
    assert run.success
    np.testing.assert_allclose(run.position[-1], target, atol=1e-6)
    assert np.abs(run.position - pepper.posture("Stand")).max() < 0.06


def test_gains_that_explode_stop_the_run_and_keep_the_log(pepper):
    """Numbers run out: the run says at which step, which joint, and what happened."""
    params = actuator_parameters(pepper)
    mad = params.changed(stiffness={"HeadYaw": 1e308}, torque_limit=np.inf)
    twin = Twin(pepper, actuators=mad)
    calm, far = np.tile(pepper.posture("Stand"), (30, 1)), np.tile(pepper.posture("Stand"), (30, 1))
    far[20:, 3] += 2.0e2
    run = twin.follow(far)
    assert run.status.value == "stopped"
    assert "twin stopped at step 21 (0.021 s): HeadYaw: its actuator demands a torque of inf" in run.message
    assert len(run) == 21
    assert np.isfinite(run.position).all()
    assert twin.state.time == pytest.approx(0.020)
    assert twin.follow(calm).success


def test_commands_that_are_no_numbers_are_refused_and_nothing_moves(pepper):
    twin = Twin(pepper)
    twin.step(pepper.posture("Stand"))
    before = twin.state
    wrong = np.tile(pepper.posture("Stand"), (5, 1))
    wrong[3, 4] = np.nan
    for call, message in [
        (lambda: twin.step(wrong[3]), "position: got nan at joint HeadPitch"),
        (lambda: twin.follow(wrong), "position: got nan"),
        (lambda: twin.follow(wrong[:2], effort=np.full((2, 15), np.inf)), "effort: got inf"),
        (lambda: twin.follow(wrong[:2], load=np.zeros((3, 15))), r"load: got shape \(3, 15\)"),
        (lambda: Twin(pepper, 0.0), "timestep: got 0.0"),
        (lambda: Twin(pepper, 10.0), r"timestep: got 10.0 s, expected a number in \(0, 0.05\] s"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            call()
    assert twin.state.time == before.time
    np.testing.assert_array_equal(twin.state.position, before.position)


def test_follow_goes_on_from_where_the_twin_is(pepper):
    target = pepper.posture("Stand") + np.linspace(0, 0.1, 40)[:, np.newaxis]
    whole, parts = Twin(pepper), Twin(pepper)
    run = whole.follow(target)
    first, second = parts.follow(target[:15]), parts.follow(target[15:])
    np.testing.assert_array_equal(second.position[0], first.position[-1])
    np.testing.assert_array_equal(second.position[1:], run.position[16:])
    np.testing.assert_array_equal(run.reference_position[1:], target)
