"""Tasks of a user's own classes, which the compiled search calls back, and what ends a search early."""

import ctypes
import inspect
import math
import signal
import threading
import time

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKStatus
from pepper_kin.ik.fast.compiled_tasks import PythonTasks
from pepper_kin.kernels.compiler import LoadedCode, compile_ir
from pepper_kin.kernels.interrupts import STOPPED
from pepper_kin.kernels.target import host_target

PEPPER = pk.load_pepper()
POINT = (0.4, 0.25, 0.9)


class Reach(pk.ik.Task):
    """The left hand at a point, by Python alone."""

    frame, label, weight, tolerance, unit, count = None, "own reach", 1.0, 1e-3, "m", None

    def __init__(self, point=POINT, pause=0.0):
        self.point, self.pause, self.calls = np.array(point), pause, 0

    def check(self, pepper):
        pass

    def residual(self, pepper, q):
        self.calls += 1
        time.sleep(self.pause)
        return pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3] - self.point

    def jacobian(self, pepper, q):
        return pk.kinematics.frame_jacobian(pepper, q, "LArm_effector")[:3]

    def size(self, residual):
        return float(np.linalg.norm(residual))

    def shortfall(self, pepper, q):
        return "short"

    attained = shortfall


@pytest.mark.parametrize("solver", ["fast", "placo", "proxsuite"])
def test_own_tasks_are_solved_by_every_solver(solver):
    result = pk.ik.solve(PEPPER, [Reach(), pk.ik.LookAt((1.0, 0.2, 1.0))], solver=solver, collisions=False)
    assert result.success, result.report()
    hand = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
    assert math.dist(hand, POINT) <= 1e-3


def test_own_tasks_lead_where_the_library_s_do():
    own, ours = (
        pk.ik.solve(PEPPER, task, collisions=False) for task in (Reach(), pk.ik.HandPosition("left", POINT))
    )
    np.testing.assert_allclose(own.q, ours.q, atol=1e-9)
    assert (own.iterations, own.restarts) == (ours.iterations, ours.restarts)
    far = pk.ik.solve(PEPPER, Reach((2.0, 0.0, 1.0)), restarts=4, collisions=False)
    assert far.status is IKStatus.CLOSEST_UNREACHABLE


def test_own_tasks_in_batches_solutions_and_scenes():
    starts = np.random.default_rng(0).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (3, PEPPER.n))
    found = pk.ik.solve_batch(PEPPER, Reach(), starts, collisions=False)
    assert found.success.all()
    assert len(pk.ik.solutions(PEPPER, Reach(), starts=8, collisions=False)) >= 2
    scene = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    result = pk.ik.solve(PEPPER, Reach(), scene=scene)
    assert result.success
    assert not result.in_collision


def test_what_a_task_raises_is_raised():
    class Faulty(Reach):
        def residual(self, pepper, q):
            if self.calls > 20:
                raise LookupError("no such thing")
            return super().residual(pepper, q)

    task = Faulty((2.0, 0.0, 1.0))
    with pytest.raises(LookupError, match="no such thing"):
        pk.ik.solve(PEPPER, task, collisions=False)
    assert task.calls < 30, "the search went on"
    assert pk.ik.solve(PEPPER, Reach(), collisions=False).success


def test_a_task_that_is_not_a_number_is_refused():
    class Undefined(Reach):
        def size(self, residual):
            return math.nan if self.calls > 5 else super().size(residual)

    with pytest.raises(InvalidValueError, match="residual of own reach"):
        pk.ik.solve(PEPPER, Undefined(), collisions=False)


def test_a_class_derived_from_one_of_the_library_s_keeps_its_own_residual():
    class Higher(pk.ik.FramePosition):
        def residual(self, pepper, q):
            return super().residual(pepper, q) - (0.0, 0.0, 0.1)

    result = pk.ik.solve(PEPPER, Higher("LArm_effector", POINT), collisions=False)
    hand = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
    np.testing.assert_allclose(hand, np.add(POINT, (0.0, 0.0, 0.1)), atol=1e-3)


def test_the_library_s_tasks_have_machine_code_and_others_have_none():
    items = [getattr(pk.ik, name) for name in pk.ik.__all__]
    ours = [
        x for x in items if inspect.isclass(x) and issubclass(x, pk.ik.Task) and not inspect.isabstract(x)
    ]
    assert pk.ik.HandPosition in ours
    assert all(kind.has_machine_code for kind in ours)
    assert Reach().structure() is None


@pytest.mark.parametrize("task", [Reach((2.0, 0.0, 1.0), 1e-3), pk.ik.HandPosition("left", (2.0, 0.0, 1.0))])
def test_a_timeout_is_kept(task):
    both = [task, pk.ik.HandPosition("right", (0.1, -2.0, 1.0)), pk.ik.LookAt((-1.0, 0.0, 1.0))]
    pk.ik.solve(PEPPER, both, restarts=0, timeout=0.2, collisions=False)
    begin = time.thread_time()
    result = pk.ik.solve(PEPPER, both, restarts=10**6, max_iterations=10**4, timeout=0.2, collisions=False)
    assert time.thread_time() - begin < 0.6  # of its own; others may keep it waiting
    assert result.status in (IKStatus.TIMED_OUT, IKStatus.CLOSEST_UNREACHABLE)
    if isinstance(task, Reach):
        assert result.status is IKStatus.TIMED_OUT


def test_a_verdict_that_fails_is_raised(monkeypatch):
    from pepper_kin.collision.fast import FastChecker

    def fail(self, q):
        raise MemoryError("no verdict")

    monkeypatch.setattr(FastChecker, "in_collision", fail)
    apart = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    two = np.concatenate([apart, apart + 2]), np.concatenate([faces, faces + 4])
    scene = pk.Scene().add_mesh("not convex", *two, position=np.array(POINT) - 0.2)
    with pytest.raises(MemoryError, match="no verdict"):
        pk.ik.solve(PEPPER, pk.ik.HandPosition("left", POINT), scene=scene)


def _search_for_ever(tasks):
    while True:
        pk.ik.solve(PEPPER, tasks, restarts=10**6, max_iterations=10**4, collisions=False)


@pytest.mark.parametrize("own", [False, True])
def test_interrupts_are_heard(own):
    """The handler of a signal, here that of an alarm, raises within a second."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        pytest.skip("needs signals")
    hand = Reach((2.0, 0.0, 1.0), 1e-3) if own else pk.ik.HandPosition("left", (0.1, 2.0, 1.0))
    # A tolerance that nothing meets, near a target that is reached: no descents agree, the search goes on.
    near = pk.ik.HandPosition("right", (0.35, -0.25, 0.9), tolerance=1e-300)
    pk.ik.solve(PEPPER, [hand, near], restarts=0, collisions=False)

    def handler(number, frame):
        raise TimeoutError("alarm")

    before = signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    begin = time.thread_time()
    try:
        with pytest.raises(TimeoutError, match="alarm"):
            _search_for_ever([hand, near] if own else near)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert time.thread_time() - begin < 1.3  # of its own
    assert pk.ik.solve(PEPPER, pk.ik.HandPosition("left", POINT), collisions=False).success


RAISE_AND_CALL = """
declare i32 @raise(i32)

define void @raise_and_call(i64 %number, i64 %kernel, i64 %given, i64 %result) {
  %short = trunc i64 %number to i32
  %done = call i32 @raise(i32 %short)
  %function = inttoptr i64 %kernel to ptr
  call void %function(i64 %given, i64 %result, i64 0)
  ret void
}
"""


@pytest.mark.parametrize("calls_before", [0, 1])
def test_a_signal_as_a_call_back_begins_is_heard(calls_before, capfd):
    """Machine code raises it: Python comes to know of it with its first instruction in the call-back."""
    if not hasattr(signal, "raise_signal") or threading.current_thread() is not threading.main_thread():
        pytest.skip("needs signals")
    code = LoadedCode(compile_ir(RAISE_AND_CALL, host_target()), host_target())
    raise_and_call = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 4)(code.address("raise_and_call"))
    tasks = PythonTasks(PEPPER, [Reach()], np.arange(PEPPER.n))
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 3)(tasks.address)
    q, result = PEPPER.neutral(), np.empty(1000)
    for _ in range(calls_before):
        call(q.ctypes.data, result.ctypes.data, 0)

    def handler(number, frame):
        raise TimeoutError("alarm")

    before = signal.signal(signal.SIGTERM, handler)
    try:
        raise_and_call(signal.SIGTERM, tasks.address, q.ctypes.data, result.ctypes.data)
        call(q.ctypes.data, result.ctypes.data, 0)  # the search may call until it sees that it is to stop
    finally:
        signal.signal(signal.SIGTERM, before)
    assert tasks.signals[STOPPED] == 1
    with pytest.raises(TimeoutError, match="alarm"):
        tasks.check()
    assert capfd.readouterr().err == ""
