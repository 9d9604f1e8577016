"""Time limits do not count the time in which machine code is made."""

import subprocess
import sys
import threading

import pytest

from pepper_kin.kernels import store, working_time
from pepper_kin.kernels.working_time import not_counted, on_perf_counter
from pepper_kin.planners import Deadline

SLOW = """
from pepper_kin.kernels import compiled_function, store, working_time
real, late, names = working_time.perf_counter, [0.0], []
working_time.perf_counter = lambda: real() + late[0]
kept_or_made = store._kept_or_made

def slowly(name, *arguments):
    names.append(name)
    late[0] += 1000.0  # as where LLVM takes so long
    return kept_or_made(name, *arguments)

store._kept_or_made = slowly
store.find = compiled_function.find = lambda *_: None

import pepper_kin as pk

robot, cup = pk.load_pepper().with_solvers({solvers!r}), (0.38, 0.22, 0.82)
start, turned, made = robot.posture("Stand"), robot.joint_vector({{"HeadYaw": 0.5}}), []
calls = {{
    "solve": lambda: pk.ik.solve(robot, pk.ik.HandPosition("left", cup), start, timeout=60.0),
    "plan": lambda: pk.plan(robot, start, [pk.ik.HandPosition("left", cup)], timeout=60.0),
    "optimize": lambda: pk.motion.optimize(robot, [start, turned], timeout=60.0),
}}
for name, call in calls.items():
    before = len(names)
    found = call()
    made.append(len(names) - before)
    assert found.success and found.time < 500.0, (name, found.status, found.time)
assert all(made[1:]) and sum(made) > 5, made  # code was asked for in the calls
"""


@pytest.fixture
def clock(monkeypatch):
    """Return the time of `perf_counter`, in a list of one number."""
    now = [100.0]
    monkeypatch.setattr(working_time, "perf_counter", lambda: now[0])
    return now


def test_the_clock_stands_while_a_part_is_made(clock, tmp_path, monkeypatch):
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path))
    deadline, begin = Deadline(5.0), on_perf_counter(0.0)

    def make(target):
        clock[0] += 70.0
        assert deadline.left == 5.0  # also for who asks meanwhile
        return b"code"

    clock[0] += 1.0
    assert deadline.left == 4.0
    clock[0] -= 1.0
    store.obtain("a part", "a key", make)
    assert deadline.left == 5.0
    assert on_perf_counter(0.0) - begin == 70.0
    clock[0] += 6.0
    assert deadline.expired


def test_two_threads_that_make_code_count_once(clock):
    deadline, inside, go_on = Deadline(100.0), threading.Event(), threading.Event()

    def other():
        with not_counted():
            inside.set()
            go_on.wait()

    thread = threading.Thread(target=other)
    with not_counted():
        thread.start()
        inside.wait()
        clock[0] += 10.0
    clock[0] += 20.0
    assert deadline.elapsed == 0.0
    go_on.set()
    thread.join()
    clock[0] += 3.0
    assert deadline.elapsed == 3.0


@pytest.mark.thorough
@pytest.mark.parametrize("solvers", ["fast", "reference"])
def test_first_calls_with_a_time_limit_succeed_however_long_their_code_takes(solvers):
    """Each part of the code takes a thousand seconds by the clock, whose limit is a minute."""
    script = SLOW.format(solvers=solvers)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
