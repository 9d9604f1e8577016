import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.dynamics.newton_euler import newton_euler_of_motion
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError

OPTIONS = [("fixed", "locked"), ("planar", "locked"), ("planar", "mimic")]


def states(pepper, seed=0):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(pepper.lower_limits, -2, 2), np.clip(pepper.upper_limits, -2, 2)
    return rng.uniform(lower, upper), rng.normal(size=pepper.n), rng.normal(size=pepper.n)


def rate(function, step=1e-6):
    return (function(step) - function(-step)) / (2 * step)


@pytest.fixture(params=OPTIONS, ids=lambda option: "-".join(option))
def pepper(request):
    return pk.load_pepper(*request.param)


def test_coriolis_matrix(pepper):
    q, v, _ = states(pepper)
    coriolis = pk.dynamics.coriolis_matrix(pepper, q, v)
    bias = pk.dynamics.newton_euler(pepper, q, v, 0 * v) - pk.dynamics.newton_euler(pepper, q, 0 * v, 0 * v)
    np.testing.assert_allclose(coriolis @ v, bias, atol=1e-10)
    change = rate(lambda t: pk.dynamics.mass_matrix(pepper, q + t * v))
    skew = change - 2 * coriolis
    np.testing.assert_allclose(skew, -skew.T, atol=1e-7)


def test_derivatives_by_finite_differences(pepper):
    state = states(pepper)
    for function, derivatives in (
        (pk.dynamics.inverse_dynamics, pk.dynamics.inverse_dynamics_derivatives),
        (pk.dynamics.forward_dynamics, pk.dynamics.forward_dynamics_derivatives),
    ):
        for k, found in enumerate(derivatives(pepper, *state)):
            for j in range(pepper.n):

                def moved(t, k=k, j=j, function=function):
                    arguments = list(state)
                    arguments[k] = state[k] + t * np.eye(pepper.n)[j]
                    return function(pepper, *arguments)

                expected = rate(moved)
                allowed = 1e-5 * np.abs(found).max() + 1e-6
                np.testing.assert_allclose(found[:, j], expected, atol=allowed)


def test_derivatives_have_names_and_batches():
    pepper = pk.load_pepper()
    q, v, a = states(pepper)
    result = pk.dynamics.inverse_dynamics_derivatives(pepper, np.stack([q, 0 * q]), v, a)
    assert result.dtau_dq.shape == (2, 15, 15)
    np.testing.assert_allclose(
        result.dtau_da, pk.dynamics.mass_matrix(pepper, np.stack([q, 0 * q])), atol=1e-12
    )
    result = pk.dynamics.forward_dynamics_derivatives(pepper, q, np.stack([v, 0 * v]), a)
    assert result.da_dv.shape == result.da_dtau.shape == (2, 15, 15)


def test_regressor_times_parameters_is_the_torque(pepper):
    q, v, a = states(pepper)
    matrix = pk.dynamics.regressor(pepper, q, v, a)
    parameters = pk.dynamics.inertial_parameters(pepper)
    assert matrix.shape == (pepper.n, parameters.size)
    np.testing.assert_allclose(matrix @ parameters, pk.dynamics.newton_euler(pepper, q, v, a), atol=1e-10)
    np.testing.assert_allclose(np.array(symbolic.regressor(pepper)(q, v, a)), matrix, atol=1e-9)


def test_momentum_and_center_of_mass(pepper):
    q, v, _ = states(pepper)
    momentum = pk.dynamics.centroidal_momentum(pepper, q, v)
    np.testing.assert_allclose(momentum, pk.dynamics.centroidal_map(pepper, q) @ v, atol=1e-12)
    velocity = rate(lambda t: pk.dynamics.center_of_mass(pepper, q + t * v))
    np.testing.assert_allclose(pk.dynamics.center_of_mass_jacobian(pepper, q) @ v, velocity, atol=1e-8)
    np.testing.assert_allclose(momentum[:3], pk.dynamics.total_mass(pepper) * velocity, atol=1e-7)
    np.testing.assert_allclose(
        np.array(symbolic.centroidal_momentum(pepper)(q, v)).ravel(), momentum, atol=1e-10
    )


def test_momentum_changes_by_the_wrench_of_the_floor(pepper):
    q, v, a = states(pepper)

    def momentum(t):
        return pk.dynamics.centroidal_momentum(pepper, q + t * v + t * t / 2 * a, v + t * a)

    change = rate(momentum)
    wrench = pk.dynamics.base_wrench(pepper, q, v, a)
    center = pk.dynamics.center_of_mass(pepper, q)
    weight = [0, 0, -9.81 * pk.dynamics.total_mass(pepper)]
    np.testing.assert_allclose(change[:3], wrench[:3] + weight, atol=1e-6)
    np.testing.assert_allclose(change[3:], wrench[3:] - np.cross(center, wrench[:3]), atol=1e-6)


def test_base_wrench_of_the_planar_base_by_newton_euler():
    """What drives the base's three joints is what the floor gives along them."""
    pepper = pk.load_pepper("planar")
    q, v, a = states(pepper)
    wrench = pk.dynamics.base_wrench(pepper, q, v, a)
    tau = pk.dynamics.newton_euler(pepper, q, v, a)
    np.testing.assert_allclose(tau[:2], wrench[:2], atol=1e-9)
    x, y = q[:2]
    np.testing.assert_allclose(tau[2], wrench[5] - x * wrench[1] + y * wrench[0], atol=1e-9)
    zmp = pk.dynamics.zero_moment_point(pepper, q, v * 0.1, a * 0.1)
    slow = pk.dynamics.base_wrench(pepper, q, v * 0.1, a * 0.1)
    np.testing.assert_allclose(zmp, [-slow[4] / slow[2], slow[3] / slow[2]], atol=1e-12)


def test_tip_over_margin_of_a_triangle():
    """At rest the margin is the distance of the center of mass from the nearest side, by Heron's formula."""
    pepper = pk.load_pepper()
    q = np.stack([pepper.posture("Stand"), np.zeros(15)])
    margin = pk.dynamics.tip_over_margin(pepper, q, np.zeros(15), np.zeros(15))
    corners = np.array(pk.dynamics.WHEEL_CONTACTS)
    for found, point in zip(margin, pk.dynamics.center_of_mass(pepper, q)[:, :2], strict=True):
        heights = []
        for k in range(3):
            a, b = corners[k], corners[(k + 1) % 3]
            x, y, z = np.linalg.norm(a - b), np.linalg.norm(a - point), np.linalg.norm(b - point)
            s = (x + y + z) / 2
            heights.append(2 * np.sqrt(s * (s - x) * (s - y) * (s - z)) / x)
        assert found == pytest.approx(min(heights), abs=1e-9)
        assert found > 0


def test_tip_over_margin_moves_with_the_base_and_is_negative_outside():
    fixed, planar = pk.load_pepper(), pk.load_pepper("planar")
    stand, zero = fixed.posture("Stand"), np.zeros(15)
    margin = pk.dynamics.tip_over_margin(fixed, stand, zero, zero)
    moved = np.concatenate([[1.0, -2.0, 0.7], stand])
    still = np.zeros(18)
    assert pk.dynamics.tip_over_margin(planar, moved, still, still) == pytest.approx(margin, abs=1e-9)
    push = still.copy()
    push[0] = 9.0
    assert pk.dynamics.tip_over_margin(planar, moved, still, push) < 0
    lean = fixed.joint_vector({"HipPitch": -1.0, "KneePitch": -0.5})
    small = [[0.01, 0.0], [0.0, 0.01], [-0.01, 0.0], [0.0, -0.01]]
    assert pk.dynamics.tip_over_margin(fixed, lean, zero, zero, contacts=small) < 0


def test_misuse_is_named():
    pepper, zero = pk.load_pepper(), np.zeros(15)
    backwards = pk.dynamics.WHEEL_CONTACTS[::-1]
    for contacts in (backwards, [[0, 0], [1, 0]]):
        with pytest.raises(InvalidValueError, match=r"contacts: got .*convex polygon, counter-clockwise"):
            pk.dynamics.tip_over_margin(pepper, zero, zero, zero, contacts=contacts)
    with pytest.raises(InvalidValueError, match=r"contacts: got shape \(3, 3\), expected shape \(k, 2\)"):
        pk.dynamics.tip_over_margin(pepper, zero, zero, zero, contacts=np.ones((3, 3)))
    with pytest.raises(UnknownNameError, match="unknown frame 'wheels'"):
        pk.dynamics.tip_over_margin(pepper, zero, zero, zero, base_frame="wheels")
    fall = np.zeros(15)
    fall[0] = 1e4
    with pytest.raises(InfeasibleError, match="the floor would have to pull"):
        pk.dynamics.tip_over_margin(pepper, pepper.joint_vector({"KneePitch": 0.5}), zero, fall)


@pytest.mark.thorough
@pytest.mark.parametrize("options", [{}, {"base": "planar", "hands": "mimic"}])
def test_newton_euler_counts_what_was_changed_by_hand(options):
    """Masses, placements, frames that carry loads, gravity and armatures, all at once."""
    robot = pk.load_robot(pk.load_pepper(**options).urdf)
    plain = pk.dynamics.newton_euler(robot, robot.neutral(), robot.neutral(), robot.neutral())
    model = robot.pinocchio_model
    turn = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.05, 0.01, -0.02]))
    for joint in ("HipRoll", "LElbowYaw"):
        place = model.jointPlacements[model.getJointId(joint)]
        model.jointPlacements[model.getJointId(joint)] = place * turn
    model.inertias[model.getJointId("LWristYaw")].mass += 0.5
    model.gravity.linear = np.array([1.0, 2.0, -3.7])
    model.armature = np.linspace(0.1, 0.3, model.nv)
    model.frames[model.getFrameId("LArm_effector")].placement *= turn
    robot = robot.with_pinocchio_model(model)
    rng = np.random.default_rng(3)
    q, v, a = rng.uniform(-1.0, 1.0, (3, 20, robot.n))
    expected = pk.dynamics.inverse_dynamics(robot, q, v, a)
    np.testing.assert_allclose(pk.dynamics.newton_euler(robot, q, v, a), expected, atol=1e-10)
    np.testing.assert_allclose(newton_euler_of_motion(robot, q, v, a), expected, atol=1e-10)
    loads = pk.collision.loads_of(robot, None, {"left": 0.4})
    expected = expected + pk.collision.load_torque(robot, loads, q, v, a)
    np.testing.assert_allclose(pk.dynamics.newton_euler(robot, q, v, a, loads), expected, atol=1e-10)
    np.testing.assert_allclose(newton_euler_of_motion(robot, q, v, a, loads), expected, atol=1e-10)
    at_first = robot.neutral()
    assert np.abs(pk.dynamics.newton_euler(robot, at_first, at_first, at_first) - plain).max() > 0.1
