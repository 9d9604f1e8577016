"""States beyond every robot are refused by joint and limit; within the limit all results are finite."""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model.joint_vectors import MOST

PEPPER = pk.load_pepper()
VECTORS = ("q", "v", "a", "tau")


def functions() -> list[Callable[..., Any]]:
    """Return the public functions of the two rooms whose arguments are joint vectors, frames and no more."""
    found = []
    for package in (pk.kinematics, pk.dynamics):
        for name in package.__all__:
            function = getattr(package, name)
            if not inspect.isfunction(function):
                continue
            needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
            others = set(needed[1:])
            if needed[0] == "pepper" and others & set(VECTORS) and others <= {*VECTORS, "frame", "frames"}:
                found.append(function)
    return found


def call(function: Callable[..., Any], state: np.ndarray) -> Any:
    values = {name: state for name in VECTORS} | {"frame": "l_gripper", "frames": ("l_gripper", "Head")}
    needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    return function(PEPPER, *(values[name] for name in needed[1:]))


def is_finite(value: Any) -> bool:
    if isinstance(value, tuple | list):
        return all(map(is_finite, value))
    return bool(np.isfinite(np.asarray(value, dtype=float)).all())


def test_numbers_beyond_the_range_are_refused_by_joint() -> None:
    for function in functions():
        for count in [None, 3, 40]:
            if count == 40 and function.__name__ not in (
                "inverse_dynamics",
                "frame_pose",
                "mass_matrix",
                "gravity_torque",
            ):
                continue  # its kernel would be compiled for this alone
            for value in (1.001 * MOST, -1e30, 1e200, -1e308, np.inf, np.nan):
                state = np.zeros(PEPPER.n) if count is None else np.zeros((count, PEPPER.n))
                state[..., 4] = value
                with pytest.raises(InvalidValueError, match=f"at joint {PEPPER.joint_names[4]}, expected"):
                    call(function, state)


def test_results_are_finite_up_to_the_limit() -> None:
    for function in functions():
        for value in (MOST, -MOST, 0.3 * MOST, 1e-320):
            state = np.full(PEPPER.n, value)
            if function.__name__ in ("zero_moment_point", "tip_over_margin") and abs(value) > 1.0:
                with pytest.raises(
                    InfeasibleError, match="no zero-moment point: the floor would have to pull"
                ):
                    call(function, state)
            else:
                assert is_finite(call(function, state))


def test_forces_beyond_the_range_are_refused_by_frame() -> None:
    q = PEPPER.neutral()
    for value in (1e10, 1e200, 1e308, np.inf):
        with pytest.raises(InvalidValueError, match=r"force at Head: .*(from -1e\+09 to 1e\+09|finite)"):
            pk.dynamics.external_torque(PEPPER, q, {"Head": [0, 0, value, 0, 0, 0]})
    for wrong in ([True, 0, 0, 0, 0, 0], ["1", 0, 0, 0, 0, 0], [[0] * 6, [0] * 5], None):
        with pytest.raises(InvalidValueError, match="force at Head"):
            pk.dynamics.external_torque(PEPPER, q, {"Head": wrong})  # type: ignore[dict-item]
