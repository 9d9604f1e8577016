"""A timeout is kept, or refused where the solver cannot be stopped."""

import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import optimize

PEPPER = pk.load_pepper()
PATH = [PEPPER.posture("Stand"), PEPPER.joint_vector({"HeadYaw": 0.3})]


@pytest.mark.parametrize("timeout", [1e-3, 5.0])
def test_fatrop_takes_no_timeout(timeout):
    allowed = "expected none with solver 'fatrop', which cannot be stopped by the clock: give max_iterations"
    with pytest.raises(InvalidValueError, match=f"timeout: got {timeout}, {allowed}"):
        optimize(PEPPER, PATH, solver="fatrop", timeout=timeout)


@pytest.mark.parametrize("solver", ["newton", "ipopt", "fatrop"])
@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan")])
def test_a_timeout_that_is_none_is_refused_for_every_solver(solver, timeout):
    with pytest.raises(InvalidValueError, match=f"timeout: got {timeout}, expected a finite number above 0"):
        optimize(PEPPER, PATH, solver=solver, timeout=timeout)
