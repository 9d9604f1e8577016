"""Speed of dynamics and kinematics: batches against loops over Pinocchio and MuJoCo, and the rest of it.

python benchmarks/dynamics.py [--quick]

Peers run in the same process, or in one of their own with `--pinocchio-python`, interleaved; ratios are
medians over repeats, of processor time where one thread computes.  Before it is timed, each batch
is compared with its peer's results.  Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from dynamics_pinocchio_server import WORLD, pinocchio_calls, seconds_of

import pepper_kin as pk
from pepper_kin.batch.states import kernel_for
from pepper_kin.model.plain_urdf import plain_urdf

FRAME = "LArm_effector"


@dataclass(frozen=True)
class Settings:
    states: int
    peer_states: int
    repeats: int
    calls: int


FULL = Settings(states=100_000, peer_states=10_000, repeats=15, calls=2000)
QUICK = Settings(states=20_000, peer_states=1_000, repeats=3, calls=200)


def seconds(function: Callable[[], object], clock: Callable[[], float]) -> float:
    begin = clock()
    function()
    return clock() - begin


def median_times(
    repeats: int, *functions: Callable[[], object], clock: Callable[[], float] = time.process_time
) -> list[list[float]]:
    """Times of each function [s], taken in turn."""
    for function in functions:
        function()
    rounds = [[seconds(function, clock) for function in functions] for _ in range(repeats)]
    return [list(column) for column in zip(*rounds, strict=True)]


def table(title: str, rows: list[tuple[str, ...]], heads: tuple[str, ...]) -> None:
    print(f"\n{title}\n\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    sys.stdout.flush()


def verdict(ok: bool) -> str:
    return "yes" if ok else "**no**"


class Loops:
    """Python loops over Pinocchio's functions, as lean as a user would write them.

    With mimic joints, coordinates are mapped and results reduced for all states at once.
    """

    def __init__(self, pepper: pk.PepperModel) -> None:
        self.pepper = pepper
        self.model, self.data = pepper.inner_model, pepper.inner_model.createData()
        self.map = np.array(pepper.full_map)
        self.frame = pepper.frame_id(FRAME)
        self.joints = [self.model.getJointId(name) for name in pepper.joint_names]

    def _full(self, q, *rates):
        return self.pepper.to_full(q), *(self.pepper.rate_to_full(rate) for rate in rates)

    def _both(self, matrices):
        return self.map.T @ matrices @ self.map if self.pepper.is_coupled else matrices

    def inverse_dynamics(self, q, v, a):
        model, data, rnea = self.model, self.data, pin.rnea
        out = np.empty((len(q), model.nv))
        for i, (x, y, z) in enumerate(zip(*self._full(q, v, a), strict=True)):
            out[i] = rnea(model, data, x, y, z)
        return out @ self.map if self.pepper.is_coupled else out

    def forward_dynamics(self, q, v, tau):
        model, data, aba = self.model, self.data, pin.aba
        out = np.empty(q.shape)
        if not self.pepper.is_coupled:
            for i, (x, y, z) in enumerate(zip(q, v, tau, strict=True)):
                out[i] = aba(model, data, x, y, z)
            return out
        # Pinocchio's ABA knows no mimic joints: its mass matrix and bias are reduced and solved.
        for i, (x, y) in enumerate(zip(*self._full(q, v), strict=True)):
            upper = np.triu(pin.crba(model, data, x))
            mass = self.map.T @ (upper + np.triu(upper, 1).T) @ self.map
            out[i] = np.linalg.solve(mass, tau[i] - pin.nonLinearEffects(model, data, x, y) @ self.map)
        return out

    def mass_matrix(self, q):
        model, data, crba = self.model, self.data, pin.crba
        out = np.empty((len(q), model.nv, model.nv))
        for i, x in enumerate(self._full(q)[0]):
            out[i] = crba(model, data, x)
        if not self.pepper.is_coupled:
            return out  # the upper triangle, as Pinocchio leaves it
        upper = np.triu(out)
        return np.triu(self._both(upper + np.swapaxes(np.triu(upper, 1), 1, 2)))

    def frame_jacobian(self, q):
        model, data, frame, compute = self.model, self.data, self.frame, pin.computeFrameJacobian
        out = np.empty((len(q), 6, model.nv))
        for i, x in enumerate(self._full(q)[0]):
            out[i] = compute(model, data, x, frame, WORLD)
        return out @ self.map if self.pepper.is_coupled else out

    def poses(self, q):
        model, data, joints, compute = self.model, self.data, self.joints, pin.forwardKinematics
        out = np.empty((len(q), len(joints), 4, 4))
        placements = data.oMi
        for i, x in enumerate(self._full(q)[0]):
            compute(model, data, x)
            for k, joint in enumerate(joints):
                out[i, k] = placements[joint].homogeneous
        return out

    def derivatives(self, q, v, a):
        model, data, compute = self.model, self.data, pin.computeRNEADerivatives
        out = np.empty((3, len(q), model.nv, model.nv))
        for i, (x, y, z) in enumerate(zip(*self._full(q, v, a), strict=True)):
            out[0, i], out[1, i], out[2, i] = compute(model, data, x, y, z)
        return self._both(out)


class Engine:
    """MuJoCo on the same robot without shapes."""

    def __init__(self, pepper: pk.PepperModel) -> None:
        spec = mujoco.MjSpec.from_string(plain_urdf(pepper.document))
        spec.compiler.fusestatic = True
        # Links that only carry others have no mass; MuJoCo wants some.
        spec.compiler.boundmass = spec.compiler.boundinertia = 1e-14
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(self.model.njnt)]
        self.order = [list(pepper.inner_model.names)[1:].index(name) for name in names]
        self.pepper = pepper

    def inverse_dynamics(self, q, v, a):
        model, data, inverse = self.model, self.data, mujoco.mj_inverse
        full = (self.pepper.to_full(q), self.pepper.rate_to_full(v), self.pepper.rate_to_full(a))
        qs, vs, accelerations = (x[:, self.order] for x in full)
        out = np.empty(qs.shape)
        for i, (x, y, z) in enumerate(zip(qs, vs, accelerations, strict=True)):
            data.qpos[:], data.qvel[:], data.qacc[:] = x, y, z
            inverse(model, data)
            out[i] = data.qfrc_inverse
        return out[:, np.argsort(self.order)] @ np.array(self.pepper.full_map)


def random_states(pepper: pk.PepperModel, count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(0)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))
    v, a = rng.normal(size=(2, count, pepper.n))
    return q, v, a


def joint_links(pepper: pk.PepperModel) -> list[str]:
    children = {joint.name: joint.child for joint in pepper.document.joints}
    return [children[name] for name in pepper.joint_names]


def batch_rows(pepper: pk.PepperModel, settings: Settings) -> list[tuple[str, ...]]:
    loops, engine = Loops(pepper), Engine(pepper)
    q, v, a = random_states(pepper, settings.states)
    few, k = (q[: settings.peer_states], v[: settings.peer_states], a[: settings.peer_states]), pk.kinematics
    d, links, n = pk.dynamics, joint_links(pepper), pepper.n
    rnea, poses = ("inverse_dynamics",), ("frame_poses", tuple(links))
    jobs = [
        ("inverse dynamics, mj_inverse", 50, lambda *x: d.inverse_dynamics(pepper, *x),
         engine.inverse_dynamics, 3, rnea),
        ("inverse dynamics", 30, lambda *x: d.inverse_dynamics(pepper, *x), loops.inverse_dynamics, 3, rnea),
        ("forward dynamics", 60, lambda *x: d.forward_dynamics(pepper, *x), loops.forward_dynamics, 3,
         ("forward_dynamics",)),
        ("mass matrix", 25, lambda *x: d.mass_matrix(pepper, *x), loops.mass_matrix, 1, ("mass_matrix",)),
        ("frame Jacobian", 25, lambda *x: k.frame_jacobian(pepper, *x, FRAME), loops.frame_jacobian, 1,
         ("frame_jacobian", FRAME)),
        (f"poses of all {n} joints", 25, lambda *x: k.frame_poses(pepper, *x, links), loops.poses, 1, poses),
        ("RNEA derivatives", 20, lambda *x: d.inverse_dynamics_derivatives(pepper, *x), loops.derivatives, 3,
         ("inverse_dynamics_derivatives",)),
    ]  # fmt: skip
    rows = []
    for name, asked, ours, peer, inputs, quantity in jobs:
        many, some = (q, v, a)[:inputs], few[:inputs]
        found, expected = np.asarray(ours(*some)), np.asarray(peer(*some))
        if name == "mass matrix":
            found, expected = np.triu(found), np.triu(expected)
        error = np.abs(found - expected).max() / np.abs(expected).max()
        if not error < 1e-9:
            raise SystemExit(f"{name}: results differ by {error:.1e}")
        del found, expected
        kernel = kernel_for(pepper, settings.states, *quantity)
        out = kernel(*many)
        times = median_times(
            settings.repeats,
            lambda f=ours, x=many: f(*x),
            lambda f=kernel, x=many, o=out: f(*x, out=o),
            lambda f=peer, x=some: f(*x),
        )
        counts = (settings.states, settings.states, settings.peer_states)
        new, reused, loop = (
            [t / count * 1e9 for t in column] for column, count in zip(times, counts, strict=True)
        )
        ratio = statistics.median(p / o for p, o in zip(loop, new, strict=True))
        other = statistics.median(p / o for p, o in zip(loop, reused, strict=True))
        cells = (f"{statistics.median(column):.0f} ns" for column in (new, reused, loop))
        rows.append((name, f"{asked}x", f"{ratio:.0f}x", f"{other:.0f}x", *cells,
                     f"{verdict(ratio >= asked)}, {verdict(other >= asked)}"))  # fmt: skip
    return rows


def kernel_rows(pepper: pk.PepperModel, settings: Settings) -> list[tuple[str, ...]]:
    """Single against double precision, and two threads against one, results in the caller's arrays."""
    states = random_states(pepper, settings.states)
    narrow = tuple(x.astype(np.float32) for x in states)
    links = tuple(joint_links(pepper))
    rows = []
    for quantity, args, inputs in (
        ("inverse_dynamics", (), 3), ("forward_dynamics", (), 3), ("mass_matrix", (), 1),
        ("frame_jacobian", (FRAME,), 1), ("frame_poses", (links,), 1),
    ):  # fmt: skip
        double = pk.batch.kernel(pepper, quantity, *args, wide=True)
        single = pk.batch.kernel(pepper, quantity, *args, dtype="float32", wide=True)
        wide, short = states[:inputs], narrow[:inputs]
        out, out32 = double(*wide), single(*short)
        one, two, half = median_times(
            settings.repeats,
            lambda f=double, x=wide, o=out: f(*x, out=o),
            lambda f=double, x=wide, o=out: f(*x, out=o, threads=2),
            lambda f=single, x=short, o=out32: f(*x, out=o),
            clock=time.perf_counter,
        )
        precision = statistics.median(x / y for x, y in zip(one, half, strict=True))
        threads = statistics.median(x / y for x, y in zip(one, two, strict=True))
        nanoseconds = statistics.median(one) / settings.states * 1e9
        flops = double.flop_count / nanoseconds
        name = quantity.replace("_", " ")
        rows.append((name, f"{nanoseconds:.0f} ns", f"{double.flop_count}", f"{flops:.1f}",
                     f"{precision:.2f}x", verdict(precision >= 1.8),
                     f"{threads:.2f}x", verdict(threads >= 1.7)))  # fmt: skip
    return rows


ASKED = {
    "forward dynamics": 3.0,
    "inverse dynamics": 2.0,
    "inverse dynamics derivatives": 6.0,
    "mass matrix": 2.0,
}
"""Time of a call from Python [us]; else no more than 1 us beyond Pinocchio's own call (2 of derivatives)."""


def own_calls(pepper: pk.PepperModel, q, v, a) -> dict[str, Callable[[], object]]:
    """Our call for each quantity of one state, named as in `pinocchio_calls`."""
    d, k = pk.dynamics, pk.kinematics
    return {
        "frame pose": lambda: k.frame_pose(pepper, q, FRAME),
        "frame velocity": lambda: k.frame_velocity(pepper, q, v, FRAME),
        "frame acceleration": lambda: k.frame_acceleration(pepper, q, v, a, FRAME),
        "frame Jacobian": lambda: k.frame_jacobian(pepper, q, FRAME),
        "frame Jacobian rate": lambda: k.frame_jacobian_rate(pepper, q, v, FRAME),
        "inverse dynamics": lambda: d.inverse_dynamics(pepper, q, v, a),
        "forward dynamics": lambda: d.forward_dynamics(pepper, q, v, a),
        "mass matrix": lambda: d.mass_matrix(pepper, q),
        "inverse mass matrix": lambda: d.inverse_mass_matrix(pepper, q),
        "Coriolis matrix": lambda: d.coriolis_matrix(pepper, q, v),
        "gravity torque": lambda: d.gravity_torque(pepper, q),
        "inverse dynamics derivatives": lambda: d.inverse_dynamics_derivatives(pepper, q, v, a),
        "forward dynamics derivatives": lambda: d.forward_dynamics_derivatives(pepper, q, v, a),
        "regressor": lambda: d.regressor(pepper, q, v, a),
        "center of mass": lambda: d.center_of_mass(pepper, q),
        "center-of-mass Jacobian": lambda: d.center_of_mass_jacobian(pepper, q),
        "centroidal map": lambda: d.centroidal_map(pepper, q),
        "centroidal momentum": lambda: d.centroidal_momentum(pepper, q, v),
        "kinetic energy": lambda: d.kinetic_energy(pepper, q, v),
        "potential energy": lambda: d.potential_energy(pepper, q),
        "base wrench": lambda: d.base_wrench(pepper, q, v, a),
    }


def one_state(pepper: pk.PepperModel) -> list[np.ndarray]:
    return [x[0].copy() for x in random_states(pepper, 1)]


class OtherPinocchio:
    """Another version of Pinocchio in a process of its own."""

    def __init__(self, interpreter: str, pepper: pk.PepperModel, *state: np.ndarray) -> None:
        server = Path(__file__).with_name("dynamics_pinocchio_server.py")
        with tempfile.TemporaryDirectory() as folder:
            urdf = Path(folder) / "robot.urdf"
            urdf.write_text(plain_urdf(pepper.document))
            command = [interpreter, str(server), str(urdf), FRAME]
            self.process = subprocess.Popen(command, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            self.version = self.ask([x.tolist() for x in state])

    def ask(self, question: object) -> Any:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(json.dumps(question), file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def single_table(pepper: pk.PepperModel, settings: Settings, other: OtherPinocchio | None) -> None:
    """Processor time of one state, in turn with Pinocchio's of this process and of another one."""
    state = one_state(pepper)
    own, peer = own_calls(pepper, *state), pinocchio_calls(pepper.inner_model, FRAME, *state)
    count, rows = settings.calls // 10, []
    for name, call in own.items():
        runs = [lambda f=call: seconds_of(f, count), lambda f=peer[name]: seconds_of(f, count)]
        if other:
            runs.append(lambda name=name: other.ask([name, count]))
        times = [[run() for run in runs] for _ in range(max(settings.repeats, 10) + 1)][1:]
        ours, *theirs = (1e6 / count * statistics.median(column) for column in zip(*times, strict=True))
        extra = 1e6 / count * statistics.median(row[0] - row[1] for row in times)
        limit = 2.0 if "derivatives" in name else 1.0
        if name in ASKED:
            wanted, ok = f"{ASKED[name]:.0f} µs", ours <= ASKED[name]
        else:
            wanted, ok = f"{limit:.0f} µs beyond", extra <= limit
        cells = (f"{time:.1f} µs" for time in (ours, *theirs))
        rows.append((name, wanted, *cells, f"{min(theirs) / ours:.1f}x", verdict(ok)))
    peers = [f"Pinocchio {version}" for version in (pin.__version__, *([other.version] if other else []))]
    title = f"One state from Python, {pepper.n} joints (processor time, in turn):"
    table(title, rows, ("quantity", "asked", "ours", *peers, "times faster", "ok"))


ASKED_OF_BATCHES = {"forward dynamics": 40, "inverse dynamics": 50, "inverse dynamics derivatives": 20}


def newest_table(pepper: pk.PepperModel, settings: Settings, other: OtherPinocchio) -> None:
    """Batches beside loops over the other Pinocchio, in turn."""
    states, d, rows = random_states(pepper, settings.states), pk.dynamics, []
    for name, asked in ASKED_OF_BATCHES.items():
        quantity = name.replace(" ", "_")
        public, kernel = getattr(d, quantity), kernel_for(pepper, settings.states, quantity)
        out = kernel(*states)
        runs = [
            (settings.states, lambda f=public: seconds_of(lambda: f(pepper, *states), 1)),
            (settings.states, lambda f=kernel, o=out: seconds_of(lambda: f(*states, out=o), 1)),
            (settings.peer_states, lambda name=name: other.ask([name, settings.peer_states, "loop"])),
        ]
        times = [[run() / count for count, run in runs] for _ in range(settings.repeats + 1)][1:]
        new, reused, loop = (statistics.median(column) for column in zip(*times, strict=True))
        cells = (f"{1e9 * time:.0f} ns" for time in (new, reused, loop))
        rows.append((name, f"{asked}x", f"{loop / new:.0f}x", f"{loop / reused:.0f}x", *cells,
                     f"{verdict(loop / new >= asked)}, {verdict(loop / reused >= asked)}"))  # fmt: skip
    title = f"Batches, times faster than a loop over Pinocchio {other.version} (processor time, in turn):"
    table(title, rows,
          ("job", "asked", "new arrays", "`out=`", "new arrays, a state", "`out=`, a state", "loop, a state",
           "ok (new, `out=`)"))  # fmt: skip


ALL_KERNELS = """
import time
import pepper_kin as pk
from pepper_kin import batch, symbolic
pepper = pk.load_pepper()
begin = time.perf_counter()
for name in symbolic.QUANTITIES:
    args = {"frame_poses": (tuple(%r),)}.get(name, ("LArm_effector",) if name.startswith("frame") else ())
    batch.kernel(pepper, name, *args)
print(time.perf_counter() - begin)
"""


def process_rows(pepper: pk.PepperModel, settings: Settings) -> list[tuple[str, ...]]:
    """What only a new process shows: compiling all kernels, loading them, importing the package."""
    code, cold, warm = ALL_KERNELS % joint_links(pepper), [], []
    for _ in range(max(1, settings.repeats // 5)):
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "PEPPER_KIN_CACHE": folder}
            for times in (cold, warm):
                done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True,
                                      text=True, check=True)  # fmt: skip
                times.append(float(done.stdout))

    def start(text: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, "-c", text], check=True)

    bare, package = median_times(
        settings.repeats, start("pass"), start("import pepper_kin"), clock=time.perf_counter
    )
    extra = statistics.median(p - b for p, b in zip(package, bare, strict=True))
    slow, fast = statistics.median(cold), statistics.median(warm)
    return [
        ("all kernels compiled, cold", "5 s", f"{slow:.1f} s", verdict(slow <= 5)),
        ("all kernels from cache", "0.3 s", f"{fast:.2f} s", verdict(fast <= 0.3)),
        ("import pepper_kin, beyond a bare interpreter", "0.15 s", f"{extra:.3f} s", verdict(extra <= 0.15)),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer states and repeats")
    parser.add_argument("--skip-mimic", action="store_true", help="without the report for mimic hands")
    parser.add_argument("--pinocchio-python", help="interpreter of an environment with another Pinocchio")
    options = parser.parse_args()
    settings = QUICK if options.quick else FULL
    pepper, target = pk.load_pepper(), pk.kernels.host_target()
    print(
        f"{target.cpu}, vectors of {target.vector_bytes} bytes, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, pin {pin.__version__}, MuJoCo {mujoco.__version__}; "
        f"{settings.states} states (loops: {settings.peer_states}), "
        f"medians of {settings.repeats} interleaved repeats."
    )
    interpreter = options.pinocchio_python
    other = OtherPinocchio(interpreter, pepper, *one_state(pepper)) if interpreter else None
    heads = ("job", "asked", "new arrays", "`out=`", "new arrays, a state", "`out=`, a state",
             "loop, a state", "ok (new, `out=`)")  # fmt: skip
    title = (
        "Times faster than the loop; one thread, float64, NumPy arrays in and out, {}-joint {}. "
        "New arrays: the public function; `out=`: its kernel, writing to an array that is there already:"
    )
    table(title.format(pepper.n, "load_pepper()"), batch_rows(pepper, settings), heads)
    table("Kernels, float64, one thread, and what single precision and a second thread bring:",
          kernel_rows(pepper, settings),
          ("kernel", "a state", "operations", "Gflop/s", "float32, asked 1.8x", "ok",
           "two threads, asked 1.7x", "ok"))  # fmt: skip
    single_table(pepper, settings, other)
    if other:
        newest_table(pepper, settings, other)
        other.close()
    table("New processes:", process_rows(pepper, settings), ("job", "asked", "measured", "ok"))
    if not options.skip_mimic:
        mimic = pk.load_pepper(hands="mimic")
        table(title.format(mimic.n, 'load_pepper(hands="mimic")'), batch_rows(mimic, settings), heads)


if __name__ == "__main__":
    main()
