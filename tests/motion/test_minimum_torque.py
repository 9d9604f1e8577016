import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.motion import MinimumTorqueStatus, minimum_torque_trajectory


@pytest.fixture(scope="module")
def ends():
    pepper = pk.load_pepper()
    goal = pepper.joint_vector(
        {"LShoulderPitch": 0.2, "RShoulderPitch": 0.6, "HipPitch": -0.4, "KneePitch": 0.15, "HeadYaw": 0.7}
    )
    return pepper, pepper.posture("Stand"), goal


def test_swing_keeps_all_limits_and_joins_its_ends(ends):
    pepper, start, goal = ends
    found = minimum_torque_trajectory(pepper, start, goal, 1.5)
    assert found.status is MinimumTorqueStatus.SOLVED, found.message
    np.testing.assert_allclose(found.trajectory.start, start, atol=1e-9)
    np.testing.assert_allclose(found.trajectory.end, goal, atol=1e-9)
    certificate = found.trajectory.check(pepper)
    for part in ("position", "velocity", "acceleration", "torque"):
        assert getattr(certificate, part).success, getattr(certificate, part).sentence()
    assert "obstacles were not looked at" in found.report()


def test_swing_takes_less_effort_than_the_smoothest_motion(ends):
    pepper, start, goal = ends
    found = minimum_torque_trajectory(pepper, start, goal, 1.5)
    still = np.zeros((2, pepper.n))
    samples = pk.trajectory.Samples(pepper.joint_names, [0.0, 1.5], [start, goal], still, still)
    t = np.linspace(0, 1.5, 1501)

    def effort(motion):
        share = pk.dynamics.newton_euler(pepper, *motion(t)) / pepper.effort_limits
        return np.trapezoid((share**2).sum(axis=1), t)

    assert found.figures.effort == pytest.approx(effort(found.trajectory), rel=0.01)
    assert effort(found.trajectory) < 0.95 * effort(samples.to_trajectory())


def test_joints_whose_ends_are_alike_may_move(ends):
    """Bending the arms between takes load off the shoulders."""
    pepper, start, goal = ends
    found = minimum_torque_trajectory(pepper, start, goal, 1.5)
    alike = np.abs(goal - start) < 1e-12
    assert alike.any()
    between = found.trajectory(np.linspace(0, 1.5, 50)).position
    assert np.ptp(between[:, alike], axis=0).max() > 0.05


@pytest.fixture(scope="module")
def coarse_and_fine(ends):
    return [minimum_torque_trajectory(*ends, 1.5, intervals=n) for n in (10, 40)]


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_finer_splines_approach_the_reference(ends, coarse_and_fine, solver):
    """With free accelerations at both ends the reference does better, by less and less for finer splines."""
    pepper, start, goal = ends
    coarse, fine = coarse_and_fine
    found = minimum_torque_trajectory(pepper, start, goal, 1.5, intervals=10, solver=solver)
    assert found.success, found.message
    assert found.figures.effort < fine.figures.effort < coarse.figures.effort
    assert fine.figures.effort < 1.25 * found.figures.effort


def test_too_short_is_infeasible(ends):
    found = minimum_torque_trajectory(*ends, 0.1)
    assert found.status is MinimumTorqueStatus.INFEASIBLE
    assert found.trajectory is None
    assert "No motion of 0.1 s within the limits" in found.report()


def test_misuse_is_named(ends):
    pepper, start, goal = ends
    with pytest.raises(InvalidValueError, match="solver: got 'snopt'"):
        minimum_torque_trajectory(pepper, start, goal, 1.0, solver="snopt")
    with pytest.raises(InvalidValueError, match="goal: got the start"):
        minimum_torque_trajectory(pepper, start, start, 1.0)
    with pytest.raises(LimitError, match="goal: HeadYaw"):
        minimum_torque_trajectory(pepper, start, start + 3 * (np.arange(15) == 3), 1.0)
    with pytest.raises(InvalidValueError, match=r"start: got shape \(2, 15\)"):
        minimum_torque_trajectory(pepper, np.stack([start, goal]), goal, 1.0)
