"""The twin against the wall clock; only bounds that hold on a busy machine are asserted."""

import time

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

PEPPER = pk.load_pepper()


def test_it_follows_the_commander_and_never_runs_ahead_of_the_clock():
    twin = pk.Twin(PEPPER, 0.005)
    goal, states = PEPPER.joint_vector({"HeadYaw": 0.2}), []
    begin = time.perf_counter()
    timing = twin.run_real_time(lambda state: goal, period=0.02, duration=0.4, on_state=states.append)
    passed = time.perf_counter() - begin
    assert len(timing) == len(states) == 20
    assert passed >= 0.4  # the simulated time took at least as long by the clock
    assert np.all(timing.late >= 0)
    assert np.all(timing.busy > 0)
    assert twin.state.time == pytest.approx(0.4)
    assert twin.state.position == pytest.approx(goal, abs=5e-3)
    assert "20 ticks of 20 ms" in timing.report()


def test_the_commander_ends_it():
    twin = pk.Twin(PEPPER, 0.005)
    timing = twin.run_real_time(lambda state: PEPPER.neutral() if state.time < 0.05 else None, period=0.01)
    assert twin.state.time == pytest.approx(0.05)
    assert len(timing) == 5
    assert timing.message == ""


def test_misuse_is_named_and_a_twin_that_diverges_ends_with_the_reason():
    twin = pk.Twin(PEPPER, 0.005)
    with pytest.raises(InvalidValueError, match=r"period.*multiple of the timestep"):
        twin.run_real_time(lambda state: None, period=0.012)
    with pytest.raises(InvalidValueError, match=r"position from the commander"):
        twin.run_real_time(lambda state: [np.nan] * PEPPER.n, period=0.01)
    wild = pk.twin.actuator_parameters(PEPPER).changed(mode="torque")
    unbound = wild.changed(torque_limit=np.inf, stop_stiffness=0.0, stop_damping=0.0)
    twin = pk.Twin(PEPPER, 0.005, actuators=unbound)
    twin.reset(v=np.full(PEPPER.n, 900.0))
    timing = twin.run_real_time(lambda state: PEPPER.neutral(), period=0.01, duration=1.0)
    assert "twin stopped at step" in timing.message
    assert timing.message in timing.report()
