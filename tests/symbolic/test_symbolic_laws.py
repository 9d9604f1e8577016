"""Laws that expressions keep whatever library they are compared with."""

import casadi
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.symbolic.states import StateExpressions, make_state, new_inputs
from pepper_kin.symbolic.tree import read_tree


def call(function, *args):
    return np.array(function(*args))


@pytest.mark.thorough
def test_analytical_derivatives_equal_automatic_ones(small_robot, states):
    n = small_robot.n
    q, v, a = (casadi.SX.sym(name, n) for name in "qva")
    for by_hand, plain, third in (
        (symbolic.inverse_dynamics_derivatives, symbolic.inverse_dynamics, "a"),
        (symbolic.forward_dynamics_derivatives, symbolic.forward_dynamics, "tau"),
    ):
        result = plain(small_robot)(q, v, a)
        jacobian = casadi.Function("jacobian", [q, v, a], [casadi.jacobian(result, casadi.vertcat(q, v, a))])
        for name in ("random", "lower limits at rest", "in line"):
            state = states(small_robot)[name]
            found = np.hstack([np.array(block) for block in by_hand(small_robot)(*state)])
            expected = call(jacobian, *state)
            assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max(), (third, name)


def test_cosines_and_sines_may_be_given_instead_of_angles(states):
    """The recursions see cosines and sines only: any pair on the unit circle gives the same as its angle."""
    from pepper_kin.symbolic.functions import make_function
    from pepper_kin.symbolic.inverse_dynamics import full_torques

    pepper = pk.load_pepper()
    tree = read_tree(pepper, compact=True)
    graph, inputs = new_inputs(tree, "c", "s", "v", "a")
    state = StateExpressions(tree, inputs["c"], inputs["s"], [0.0] * 15, inputs["v"], inputs["a"])
    function = make_function("f", graph, inputs, {"tau": [[t] for t in full_torques(state)]})
    q, v, a = states(pepper)["random"]
    found = call(function, np.cos(q), np.sin(q), v, a)
    np.testing.assert_allclose(found, call(symbolic.inverse_dynamics(pepper), q, v, a), rtol=1e-12)
    graph, inputs = new_inputs(tree, "q")
    assert make_state(tree, inputs["q"]).cosines[3].graph is graph
