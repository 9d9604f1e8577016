"""The cache and the calls of machine code under stress: killed writers, full disks, processes, interrupts.

Results are right or an error of the library's, and no file of the cache is ever wrong.
"""

import hashlib
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import collision, ik

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="signals and limits of POSIX")

FUNCTIONS = """
import sys, random, numpy as np, casadi as ca
from pepper_kin.kernels import compile_function
POINTS = np.linspace(-2, 2, 30).reshape(10, 3)
def make(k):
    x = ca.SX.sym("x", 3)
    return ca.Function("f", [x], [(k + 1.5) * ca.sin(x) + x[0]], ["x"], ["y"])
def right(k):
    wanted = (k + 1.5) * np.sin(POINTS) + POINTS[:, :1]
    return np.allclose(compile_function(make(k))(POINTS), wanted, rtol=1e-13, atol=1e-13)
"""


def run(program, cache, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        env={**os.environ, "PEPPER_KIN_CACHE": str(cache)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        **options,
    )


def damaged(folder):
    """Return the files of a cache whose content does not fit the checksum before it."""
    found = []
    for path in folder.glob("*.code"):
        data, key = path.read_bytes(), path.stem
        if hashlib.sha256(key.encode() + data[32:]).digest() != data[:32]:
            found.append(path)
    return found


WRITER = """
import sys, numpy as np
from pepper_kin.kernels import store
content = np.random.default_rng(0).bytes(20_000_000)
print("ready", flush=True)
k = 0
while True:
    store.write_part(f"{k % 3:064x}", bytes([k % 251]) + content)
    k += 1
"""


def test_a_writer_that_is_killed_leaves_whole_files(tmp_path, rng, amount, tried):
    rounds, folder = amount(4, 20, 500), tmp_path / "cache"
    rest = np.random.default_rng(0).bytes(20_000_000)
    for _ in range(rounds):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER],
            env={**os.environ, "PEPPER_KIN_CACHE": str(folder)},
            stdout=subprocess.PIPE,
        )
        assert writer.stdout.readline() == b"ready\n"
        time.sleep(rng.uniform(0.0, 0.3))
        writer.kill()
        writer.wait()
        writer.stdout.close()
        assert damaged(folder) == []
        for path in folder.glob("*.code"):
            assert path.read_bytes()[33:] == rest
    tried("writers killed", rounds)


LIMITED = (
    FUNCTIONS
    + """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
print(all(right(k) for k in range(3)))
"""
)


def test_a_disk_that_is_full_costs_the_cache_only(tmp_path, rng, amount, tried):
    """Files may not become longer than some bytes, as on a disk that is full."""
    sizes = [0, *rng.integers(1, 30_000, amount(3, 30, 1000)).tolist()]
    for size in sizes:
        done = run(LIMITED, tmp_path / "cache", size)
        assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr
        assert damaged(tmp_path / "cache") == []
        assert not list((tmp_path / "cache").glob("*.tmp"))
    tried("full disks", len(sizes))


@pytest.mark.parametrize("place", ["/sys/kernel/pepper_kin", "/dev/null/pepper_kin"])
def test_a_folder_that_cannot_be_written_costs_the_cache_only(place):
    done = run(FUNCTIONS + "print(all(right(k) for k in range(3)))", place)
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


def test_processes_that_share_a_cache_write_each_part_once(tmp_path, amount, tried):
    count, functions, folder = amount(3, 6, 16), amount(4, 12, 40), tmp_path / "cache"
    program = FUNCTIONS + (
        "order = list(range(int(sys.argv[1])))\n"
        "random.Random(int(sys.argv[2])).shuffle(order)\n"
        "print(all(right(k) for k in order))"
    )
    writers = [
        subprocess.Popen(
            [sys.executable, "-c", program, str(functions), str(k)],
            env={**os.environ, "PEPPER_KIN_CACHE": str(folder)},
            stdout=subprocess.PIPE,
        )
        for k in range(count)
    ]
    for writer in writers:
        assert writer.communicate(timeout=300)[0] == b"True\n"
    assert len(list(folder.glob("*.code"))) == functions + 1  # and the digests of sources
    assert damaged(folder) == []
    assert not [path for path in folder.iterdir() if path.suffix in (".tmp", ".lock")]
    tried("processes that shared a cache", count)


def answers(pepper, seed):
    """Return numbers of several rooms that depend on a seed only."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (40, pepper.n))
    scene = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.6 + 0.01 * (seed % 7)))
    point = (0.3 + 0.01 * (seed % 5), 0.2, 0.85)
    found = ik.solve(pepper, ik.HandPosition("left", point), scene=scene, seed=seed)
    torque = pk.dynamics.inverse_dynamics(pepper, q, np.zeros_like(q), np.zeros_like(q))
    verdicts = collision.in_collision(pepper, q, scene)
    plan = pk.plan(pepper, pepper.posture("Stand"), pepper.joint_vector({"HeadYaw": 0.3}), scene, seed=seed)
    return np.concatenate([found.q, torque.ravel(), verdicts.astype(float), np.ravel(plan.path)])


def test_threads_get_the_answers_of_one(pepper, amount, tried):
    seeds = range(amount(8, 64, 5000))
    alone = [answers(pepper, seed) for seed in seeds]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda seed: answers(pepper, seed), seeds))
    wrong = sum(not np.array_equal(a, b) for a, b in zip(alone, together, strict=True))
    tried("calls in threads", len(seeds), wrong)
    assert wrong == 0


FORKS = """
import os, signal, sys, threading, time
import numpy as np
sys.path.insert(0, sys.argv[1])
import pepper_kin as pk
from test_processes import answers
from pepper_kin import symbolic
pepper, rounds = pk.load_pepper(), int(sys.argv[2])
busy = True
def work():
    import casadi as ca
    from pepper_kin.kernels import compile_function
    k = 0
    while busy:  # another thread loads and makes machine code all the time
        x = ca.SX.sym("x")
        compile_function(ca.Function("f", [x], [ca.sin(k * x)]), cache=False)
        symbolic.function(pepper, "frame_pose", pepper.frame_names[k % len(pepper.frame_names)])
        k += 1
thread = threading.Thread(target=work, daemon=True)
if len(sys.argv) > 3:
    thread.start()
wanted, wrong = None, 0
for k in range(rounds):
    time.sleep(0.01 * (k % 5))
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(100)  # a child that waits for ever is ended
        os.write(writer, answers(pepper, 3).tobytes())
        os._exit(0)
    os.close(writer)
    found = b"".join(iter(lambda: os.read(reader, 1 << 16), b""))
    os.close(reader)
    status = os.waitpid(child, 0)[1]
    if wanted is None:
        wanted = answers(pepper, 3).tobytes()
    wrong += status != 0 or found != wanted
busy = False
print("wrong", wrong)
"""


@pytest.mark.parametrize(
    "busy", [(), ("busy",)], ids=["before anything is loaded", "while another thread loads"]
)
def test_forked_children_get_the_answers_of_their_parent(tmp_path, amount, tried, busy):
    rounds = amount(2, 10, 1000)
    done = run(FORKS, os.environ["PEPPER_KIN_CACHE"], os.path.dirname(__file__), rounds, *busy)
    assert done.stdout.endswith("wrong 0\n"), (done.stdout, done.stderr)
    tried("forked children", rounds)


SPAWN = """
import multiprocessing, sys
import pepper_kin as pk
sys.path.insert(0, sys.argv[1])
from test_processes import answers
if __name__ == "__main__":
    pepper = pk.load_pepper().with_masses({"LForeArm": 1.0})
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        there = pool.starmap(answers, [(pepper, seed) for seed in (1, 2)])
    print(all((a == answers(pepper, seed)).all() for seed, a in zip((1, 2), there)))
"""


def test_spawned_processes_get_changed_robots_and_the_same_answers(tmp_path, tried):
    script = tmp_path / "spawn.py"
    script.write_text(SPAWN)
    done = subprocess.run(
        [sys.executable, str(script), os.path.dirname(__file__)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stdout == "True\n", done.stderr
    tried("spawned processes", 2)


def long_ik(pepper):
    points = np.random.default_rng(0).uniform((0.1, -0.5, 0.3), (0.7, 0.7, 1.3), (200, 3))
    return ik.solve_batch(pepper, ik.HandPosition("left", points))


def long_twin(pepper):
    from pepper_kin.twin import TwinBatch

    path = np.array([pepper.neutral(), pepper.joint_vector({"HeadYaw": 1.0})])
    return TwinBatch(pepper, 512).execute(pk.retime(pepper, path))


def table():
    return pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))


def long_plan(pepper):
    """Plan with a planner that shortens what it has found until its time is over."""
    goal = [ik.HandPosition("left", (0.38, 0.22, 0.82))]
    return pk.plan(pepper, pepper.posture("Stand"), goal, table(), planner="aorrtc", timeout=1.5)


def long_optimize(pepper):
    path = [pepper.posture("Stand"), pepper.joint_vector({"RShoulderPitch": 0.4, "RElbowRoll": 0.8})]
    return pk.motion.optimize(pepper, path, table(), intervals=80, starts=4)


@contextmanager
def untraced():
    """Do without coverage meanwhile, which waits for ever on its own lock after an interrupt in it."""
    tracer = sys.gettrace()
    sys.settrace(None)
    try:
        yield
    finally:
        sys.settrace(tracer)


LONG = {"ik": long_ik, "twin": long_twin, "plan": long_plan, "optimize": long_optimize}


def interrupted(call, pepper, seconds):
    """Whether Ctrl-C some seconds after the begin of a call ends it."""
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        old = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            call(pepper)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, old)
    except KeyboardInterrupt:
        return True
    finally:
        signal.signal(signal.SIGINT, previous)
    return False


@pytest.mark.parametrize("name", LONG)
def test_an_interrupt_in_the_midst_of_a_call_is_heard_and_the_next_call_is_right(
    pepper, rng, amount, tried, name
):
    wanted, heard = answers(pepper, 5), 0
    LONG[name](pepper)  # loads its code
    begin = time.perf_counter()
    LONG[name](pepper)
    seconds = min(time.perf_counter() - begin, 2.0)
    rounds = amount(3, 5, 300)
    for _ in range(rounds):
        with untraced():
            heard += interrupted(LONG[name], pepper, rng.uniform(0.05, 0.6) * seconds)
        np.testing.assert_array_equal(answers(pepper, 5), wanted)
    assert heard
    tried("interrupted calls", rounds)
