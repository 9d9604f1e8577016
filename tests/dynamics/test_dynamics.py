import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

OPTIONS = [("fixed", "locked"), ("planar", "locked"), ("fixed", "mimic"), ("planar", "independent")]


def states(pepper, count, seed=0):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(pepper.lower_limits, -3, 3), np.clip(pepper.upper_limits, -3, 3)
    q = rng.uniform(lower, upper, (count, pepper.n))
    return q, rng.normal(size=(count, pepper.n)) * 3, rng.normal(size=(count, pepper.n)) * 10


@pytest.mark.parametrize(("base", "hands"), OPTIONS)
def test_recursive_newton_euler_against_the_independent_one(base, hands):
    pepper = pk.load_pepper(base, hands)
    q, v, a = states(pepper, 1000)
    difference = pk.dynamics.inverse_dynamics(pepper, q, v, a) - pk.dynamics.newton_euler(pepper, q, v, a)
    assert np.abs(difference).max() < 1e-9


@pytest.mark.parametrize(("base", "hands"), OPTIONS)
def test_power_is_the_rate_of_energy(base, hands):
    """d(T + V)/dt = tau . v along any motion: a law that mass, bias and gravity must keep together."""
    pepper = pk.load_pepper(base, hands)
    q, v, a = states(pepper, 20, seed=3)
    v, a = v * 0.3, a * 0.1
    tau = pk.dynamics.inverse_dynamics(pepper, q, v, a)
    h = 1e-5

    def energy(t):
        q_t, v_t = q + v * t + a * t * t / 2, v + a * t
        return pk.dynamics.kinetic_energy(pepper, q_t, v_t) + pk.dynamics.potential_energy(pepper, q_t)

    rate = (energy(h) - energy(-h)) / (2 * h)
    np.testing.assert_allclose(rate, np.sum(tau * v, axis=-1), rtol=1e-6, atol=1e-6)


def test_published_center_of_mass_mass_and_gravity_torques():
    """Figures of the reference data: total mass, zero and Stand centers of mass, gravity torques at Stand."""
    pepper = pk.load_pepper()
    assert pk.dynamics.total_mass(pepper) == pytest.approx(28.68118, abs=1e-5)
    center = pk.dynamics.center_of_mass(pepper, np.zeros(15))
    np.testing.assert_allclose(center, [0.00948, 0.0, 0.41449], atol=5e-6)
    stand = pepper.posture("StandInit")
    center = pk.dynamics.center_of_mass(pepper, stand)
    np.testing.assert_allclose(center, [-0.00351, -0.00023, 0.3997], atol=1e-5)
    expected = [
        -1.3941, -1.4513, 0.0641, -0.0014, 0.2609, -0.2187, 0.3014, -0.047, -0.3268, -0.0034,
        -0.2196, -0.2812, 0.044, 0.3298, 0.0034,
    ]  # fmt: skip
    np.testing.assert_allclose(pk.dynamics.gravity_torque(pepper, stand), expected, atol=6e-5)


def test_at_rest_the_zero_moment_point_is_below_the_center_of_mass():
    for base in ("fixed", "planar"):
        pepper = pk.load_pepper(base)
        q, v, _ = states(pepper, 20, seed=4)
        zmp = pk.dynamics.zero_moment_point(pepper, q, 0 * v, 0 * v)
        np.testing.assert_allclose(zmp, pk.dynamics.center_of_mass(pepper, q)[..., :2], atol=1e-10)


def test_zero_moment_point_balances_the_planar_base():
    """Pushing the whole robot forward with a moves the point back by a h / g: the cart-table law."""
    pepper = pk.load_pepper("planar")
    q, zero = pepper.posture("Stand"), np.zeros(pepper.n)
    push = zero.copy()
    push[pepper.joint_index("BaseX")] = 0.5
    center = pk.dynamics.center_of_mass(pepper, q)
    zmp = pk.dynamics.zero_moment_point(pepper, q, zero, push)
    np.testing.assert_allclose(zmp, center[:2] - [0.5 * center[2] / 9.81, 0.0], atol=1e-10)


def test_zero_moment_point_from_the_forces_of_the_base_joints():
    """The free base's joint forces, by the independent Newton-Euler, are what the floor gives in x and y."""
    fixed, planar = pk.load_pepper(), pk.load_pepper("planar")
    q, v, a = states(fixed, 10, seed=5)
    v, a = v * 0.3, a * 0.05
    pad = ((0, 0), (3, 0))
    full = [np.pad(x, pad) for x in (q, v, a)]
    zmp = pk.dynamics.zero_moment_point(fixed, q, v, a)
    np.testing.assert_allclose(zmp, pk.dynamics.zero_moment_point(planar, *full), atol=1e-10)
    # Moment balance about z of forces acting in the floor plane: independent of the vertical force.
    tau = pk.dynamics.newton_euler(planar, *full)
    rate = 1e-6
    later = [full[0] + rate * full[1], full[1] + rate * full[2]]
    earlier = [full[0] - rate * full[1], full[1] - rate * full[2]]

    def momentum(state):
        mass = pk.dynamics.mass_matrix(planar, state[0])
        return np.einsum("bij,bj->bi", mass, state[1])[:, :2]

    np.testing.assert_allclose((momentum(later) - momentum(earlier)) / (2 * rate), tau[:, :2], atol=1e-5)


def test_bad_batches_are_named():
    pepper = pk.load_pepper()
    with pytest.raises(InvalidValueError, match=r"batch axes: got q: \(2,\), v: \(3,\)"):
        pk.dynamics.kinetic_energy(pepper, np.zeros((2, 15)), np.zeros((3, 15)))
    with pytest.raises(InvalidValueError, match=r"v: got nan at joint HipRoll"):
        pk.dynamics.inverse_dynamics(
            pepper, np.zeros(15), np.where(np.arange(15) == 2, np.nan, 0), np.zeros(15)
        )
