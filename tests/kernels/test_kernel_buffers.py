"""Buffers handed to machine code: their sizes are compared with what the code needs, by name."""

import ast
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import ik, planners
from pepper_kin.collision.fast.compiled import StaticLoads
from pepper_kin.core.kernel_batch import evaluate
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.fast import compiled_tasks
from pepper_kin.kernels import compile_function

ROOT = Path(pk.__file__).parent


@pytest.fixture(scope="module")
def kernel():
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    function = ca.Function("two_parts", [x, p], [ca.sin(x) * p[0], ca.sumsqr(x) * p[1]])
    return compile_function(function)


@pytest.mark.parametrize("function", ["single", "block", "batch"])
def test_buffers_that_fit_get_the_address(kernel, function):
    address = kernel.address_of(function, inputs=5, outputs=4, work=kernel.work_size)
    assert address == getattr(kernel, f"{function}_address") != 0
    assert kernel.address_of(function, inputs=5, outputs=9, work=kernel.work_size + 8) == address


def test_a_buffer_that_does_not_fit_is_named(kernel):
    for change, named in [
        ({"inputs": 4}, "input buffer of two_parts: got 4 numbers a state, expected 5"),
        ({"inputs": 6}, "input buffer of two_parts: got 6 numbers a state, expected 5"),
        ({"outputs": 3}, "output buffer of two_parts: got 3 numbers a state, expected 4 or more"),
        ({"work": 1}, "work buffer of two_parts: got 1 numbers, expected"),
    ]:
        sizes = {"inputs": 5, "outputs": 4, "work": kernel.work_size} | change
        with pytest.raises(InvalidValueError, match=named):
            kernel.address_of("block", **sizes)


def test_a_kernel_without_the_loop_has_no_such_address():
    x = ca.SX.sym("x")
    kernel = compile_function(ca.Function("plain", [x], [x * x]), batch=False)
    with pytest.raises(InvalidValueError, match="function of plain: got 'batch'"):
        kernel.address_of("batch", inputs=1, outputs=1, work=kernel.work_size)


@pytest.mark.thorough
def test_a_kernel_of_another_robot_is_refused_by_the_search(pepper, monkeypatch):
    """As if a key had left out what the code depends on: the planar robot's kernel for the fixed one."""
    task = [ik.HandPosition("left", (0.38, 0.22, 0.82))]
    other = compiled_tasks.compiled_tasks(pk.load_pepper(base="planar"), task)._kernels[-1]
    robot = pk.load_pepper(hands="independent")
    monkeypatch.setattr(compiled_tasks, "compile_function", lambda *_, **__: other)
    with pytest.raises(InvalidValueError, match="buffer of "):
        ik.solve(robot, task)


def test_a_kernel_with_more_results_than_loads_can_hold_is_refused(pepper):
    from pepper_kin.batch import kernel
    from pepper_kin.collision.fast import fast_checker_for

    mass = kernel(pepper, "mass_matrix")
    checker = fast_checker_for(pepper, None)
    free = np.arange(pepper.n)
    check = checker.of_motion(pepper.neutral(), free, pepper.effort_limits, StaticLoads(mass))
    with pytest.raises(InvalidValueError, match="output buffer of mass_matrix"):
        check.blocks()


def test_joint_vectors_of_another_length_are_refused(pepper):
    from pepper_kin.batch import kernel

    states = np.zeros((8, pepper.n + 1))
    with pytest.raises(InvalidValueError, match="input buffer of gravity_torque"):
        evaluate(kernel(pepper, "gravity_torque"), states)


def test_a_manifold_with_too_few_rows_is_refused(kernel):
    places = np.arange(2)
    code = planners.CompiledManifold(
        kernel.single_address, np.zeros(5), places, places, 2, kernel.work_size, keep_alive=kernel, size=9
    )
    manifold = planners.ConstraintManifold(code, 2, 2)
    with pytest.raises(InvalidValueError, match="output buffer of a manifold: got 2 rows of 1 \\+ 2 numbers"):
        manifold.errors(np.zeros((1, 2)))


@pytest.mark.thorough
def test_addresses_of_kernels_are_asked_for_with_the_sizes_of_buffers():
    """Nothing outside of `kernels` reads the addresses themselves."""
    names = {"single_address", "block_address", "batch_address"}
    found = []
    for path in ROOT.rglob("*.py"):
        place = path.relative_to(ROOT).as_posix()
        if place.startswith("kernels/"):
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Attribute) and node.attr in names:
                found.append(f"{place}:{node.lineno}")
    assert [place.partition(":")[0] for place in found] == ["collision/fast/compiled.py"], found  # a key
