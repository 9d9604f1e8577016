"""The page's examples do what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import symbolic

PAGE = Path(__file__).parents[2] / "docs" / "symbolic.md"
THEORY = PAGE.parent / "theory" / "dynamics.md"


@pytest.fixture(scope="module")
def examples():
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_first_example(examples):
    names = {}
    exec(examples[0], names)
    pepper = names["pepper"]
    expected = pk.kinematics.frame_pose(pepper, pepper.posture("Stand"), "LArm_effector")
    np.testing.assert_allclose(np.array(names["hand"](pepper.posture("Stand"))), expected, atol=1e-12)
    assert names["dynamics"].name_in() == ["q", "v", "tau"]


@pytest.mark.thorough
def test_optimal_control(examples):
    names = {}
    exec(examples[1], names)
    pepper, path, torques = names["pepper"], names["path"], names["torques"]
    assert path.shape == (11, 15)
    end = pk.kinematics.frame_pose(pepper, path[-1], "LArm_effector")[:3, 3]
    np.testing.assert_allclose(end, names["target"], atol=1e-6)
    np.testing.assert_allclose(path[0], pepper.posture("Stand"), atol=1e-7)
    slack = 1e-6
    assert np.all((path >= pepper.lower_limits - slack) & (path <= pepper.upper_limits + slack))
    assert np.all(np.abs(torques) <= pepper.effort_limits + slack)
    v, a = (names["solution"].value(names[x]).T for x in "va")
    np.testing.assert_allclose(v[[0, -1]], 0, atol=1e-7)
    np.testing.assert_allclose(torques, pk.dynamics.inverse_dynamics(pepper, path[:-1], v[:-1], a), atol=1e-9)
    # A straight line in joint space to the same end, as fast at its peak, needs more torque.
    s = np.linspace(0, 1, 11)[:, None]
    profile = 10 * s**3 - 15 * s**4 + 6 * s**5
    speed, rate = 30 * s**2 * (1 - s) ** 2, 60 * s - 180 * s**2 + 120 * s**3
    span = path[-1] - path[0]
    straight = pk.dynamics.inverse_dynamics(pepper, path[0] + profile * span, speed * span, rate * span)
    assert np.sum(torques**2) < np.sum(straight[:-1] ** 2)


def test_the_table_states_the_operations(examples):
    """Counts on the page are those of the code."""
    import casadi

    free = {casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_CONST, casadi.OP_NEG}
    rows = re.findall(r"^\| `(\w+)` \| (\d+)", THEORY.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) == 6
    for name, stated in rows:
        function = symbolic.function(pk.load_pepper(), name)
        codes = [function.instruction_id(k) for k in range(function.n_instructions())]
        assert sum(code not in free for code in codes) == int(stated), name
