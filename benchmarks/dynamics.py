"""Dynamics and kinematics: batches beside loops over Pinocchio and MuJoCo, single calls, new processes."""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from dynamics_pinocchio_server import WORLD, pinocchio_calls, seconds_of
from harness import Served, figures, in_turn, python

import pepper_kin as pk
from pepper_kin.batch.states import kernel_for
from pepper_kin.model.plain_urdf import plain_urdf

FRAME = "LArm_effector"


def verdict(*ok: bool) -> str:
    return ", ".join("yes" if one else "**no**" for one in ok)


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

    def each(self, function, shape, *states):
        """Return what a function makes of each state, shape (N, *shape)."""
        model, data, out = self.model, self.data, np.empty((len(states[0]), *shape))
        for i, row in enumerate(zip(*states, strict=True)):
            out[i] = function(model, data, *row)
        return out

    def inverse_dynamics(self, q, v, a):
        out = self.each(pin.rnea, (self.model.nv,), *self._full(q, v, a))
        return out @ self.map if self.pepper.is_coupled else out

    def forward_dynamics(self, q, v, tau):
        if not self.pepper.is_coupled:
            return self.each(pin.aba, q.shape[1:], q, v, tau)
        # Pinocchio's ABA knows no mimic joints: its mass matrix and bias are reduced and solved.
        model, data, out = self.model, self.data, np.empty(q.shape)
        for i, (x, y) in enumerate(zip(*self._full(q, v), strict=True)):
            upper = np.triu(pin.crba(model, data, x))
            mass = self.map.T @ (upper + np.triu(upper, 1).T) @ self.map
            out[i] = np.linalg.solve(mass, tau[i] - pin.nonLinearEffects(model, data, x, y) @ self.map)
        return out

    def mass_matrix(self, q):
        out = self.each(pin.crba, (self.model.nv, self.model.nv), *self._full(q))
        if not self.pepper.is_coupled:
            return out  # the upper triangle, as Pinocchio leaves it
        upper = np.triu(out)
        return np.triu(self._both(upper + np.swapaxes(np.triu(upper, 1), 1, 2)))

    def frame_jacobian(self, q):
        out, (full,) = np.empty((len(q), 6, self.model.nv)), self._full(q)
        model, data, frame, compute = self.model, self.data, self.frame, pin.computeFrameJacobian
        for i, x in enumerate(full):
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


BATCHES = "job | asked {}x | new arrays {:.0f}x | `out=` {:.0f}x | new arrays, a state {:.0f} ns | "
BATCHES += "`out=`, a state {:.0f} ns | loop, a state {:.0f} ns | ok (new, `out=`)"


def batch_rows(pepper: pk.PepperModel, states: int, peer_states: int, repeats: int) -> Iterator[tuple]:
    loops, engine, d, k = Loops(pepper), Engine(pepper), pk.dynamics, pk.kinematics
    whole, links = random_states(pepper, states), joint_links(pepper)
    rnea, poses = ("inverse_dynamics",), ("frame_poses", tuple(links))
    inverse = partial(d.inverse_dynamics, pepper)
    jobs = [
        ("inverse dynamics, mj_inverse", 50, inverse, engine.inverse_dynamics, 3, rnea),
        ("inverse dynamics", 30, inverse, loops.inverse_dynamics, 3, rnea),
        ("forward dynamics", 60, partial(d.forward_dynamics, pepper), loops.forward_dynamics, 3,
         ("forward_dynamics",)),
        ("mass matrix", 25, partial(d.mass_matrix, pepper), loops.mass_matrix, 1, ("mass_matrix",)),
        ("frame Jacobian", 25, lambda q: k.frame_jacobian(pepper, q, FRAME), loops.frame_jacobian, 1,
         ("frame_jacobian", FRAME)),
        (f"poses of all {pepper.n} joints", 25, lambda q: k.frame_poses(pepper, q, links), loops.poses, 1,
         poses),
        ("RNEA derivatives", 20, partial(d.inverse_dynamics_derivatives, pepper), loops.derivatives, 3,
         ("inverse_dynamics_derivatives",)),
    ]  # fmt: skip
    for name, asked, ours, peer, inputs, quantity in jobs:
        many, some = whole[:inputs], tuple(x[:peer_states] for x in whole[:inputs])
        found, expected = np.asarray(ours(*some)), np.asarray(peer(*some))
        if name == "mass matrix":
            found, expected = np.triu(found), np.triu(expected)
        error = np.abs(found - expected).max() / np.abs(expected).max()
        if not error < 1e-9:
            raise SystemExit(f"{name}: results differ by {error:.1e}")
        del found, expected
        kernel = kernel_for(pepper, states, *quantity)
        out = kernel(*many)
        calls = {
            "new": partial(ours, *many),
            "out": partial(kernel, *many, out=out),
            "loop": partial(peer, *some),
        }
        times = in_turn(calls, repeats)
        new, reused, loop = times["new"] / states, times["out"] / states, times["loop"] / peer_states
        ratios = [np.median(loop / new), np.median(loop / reused)]
        each = (1e9 * np.median(spent) for spent in (new, reused, loop))
        yield BATCHES, name, asked, *ratios, *each, verdict(*(ratio >= asked for ratio in ratios))


def kernel_rows(pepper: pk.PepperModel, states: int, repeats: int) -> Iterator[tuple]:
    """Single against double precision, and two threads against one, results in the caller's arrays."""
    every = random_states(pepper, states)
    for quantity, args, inputs in (
        ("inverse_dynamics", (), 3), ("forward_dynamics", (), 3), ("mass_matrix", (), 1),
        ("frame_jacobian", (FRAME,), 1), ("frame_poses", (tuple(joint_links(pepper)),), 1),
    ):  # fmt: skip
        double = pk.batch.kernel(pepper, quantity, *args, wide=True)
        single = pk.batch.kernel(pepper, quantity, *args, dtype="float32", wide=True)
        wide, short = every[:inputs], tuple(x.astype(np.float32) for x in every[:inputs])
        out = double(*wide)
        calls = {
            "one": partial(double, *wide, out=out),
            "two": partial(double, *wide, out=out, threads=2),
            "half": partial(single, *short, out=single(*short)),
        }
        times = in_turn(calls, repeats, time.perf_counter)
        precision, threads = (np.median(times["one"] / times[which]) for which in ("half", "two"))
        each = np.median(times["one"]) / states * 1e9
        yield (
            "kernel | a state {:.0f} ns | operations | Gflop/s {:.1f} | float32, asked 1.8x {:.2f}x | ok | "
            "two threads, asked 1.7x {:.2f}x | ok",
            quantity.replace("_", " "), each, double.flop_count, double.flop_count / each, precision,
            precision >= 1.8, threads, threads >= 1.7,
        )  # fmt: skip


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


def other_pinocchio(interpreter: str, pepper: pk.PepperModel, *state: np.ndarray) -> Served:
    """Return another version of Pinocchio in a process of its own."""
    server = Path(__file__).with_name("dynamics_pinocchio_server.py")
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder) / "robot.urdf"
        urdf.write_text(plain_urdf(pepper.document))
        process = Served(interpreter, server, urdf, FRAME)
        process.version = process.ask([x.tolist() for x in state])
    return process


def single_rows(pepper: pk.PepperModel, calls: int, repeats: int, other: Served | None) -> Iterator[tuple]:
    """Processor time of one state, in turn with Pinocchio's of this process and of another one."""
    state = one_state(pepper)
    own, peer = own_calls(pepper, *state), pinocchio_calls(pepper.inner_model, FRAME, *state)
    versions = [pin.__version__, *([other.version] if other else [])]
    heads = " | ".join(f"Pinocchio {version} {{:.1f}} µs" for version in versions)
    for name, call in own.items():
        runs = [partial(seconds_of, call, calls), partial(seconds_of, peer[name], calls)]
        if other:
            runs.append(partial(other.ask, [name, calls]))
        times = np.array([[run() for run in runs] for _ in range(repeats + 1)][1:]) * 1e6 / calls
        ours, *theirs = np.median(times, axis=0)
        limit, extra = 2.0 if "derivatives" in name else 1.0, np.median(times[:, 0] - times[:, 1])
        wanted, ok = f"{limit:.0f} µs beyond", extra <= limit
        if name in ASKED:
            wanted, ok = f"{ASKED[name]:.0f} µs", ours <= ASKED[name]
        yield (
            f"quantity | asked | ours {{:.1f}} µs | {heads} | times faster {{:.1f}}x | ok",
            name,
            wanted,
            ours,
            *theirs,
            min(theirs) / ours,
            ok,
        )


ASKED_OF_BATCHES = {"forward dynamics": 40, "inverse dynamics": 50, "inverse dynamics derivatives": 20}


def newest_rows(pepper, states, peer_states, repeats, other) -> Iterator:
    """Batches beside loops over the other Pinocchio, in turn."""
    whole = random_states(pepper, states)
    for name, asked in ASKED_OF_BATCHES.items():
        quantity = name.replace(" ", "_")
        public, kernel = getattr(pk.dynamics, quantity), kernel_for(pepper, states, quantity)
        out = kernel(*whole)
        ours = partial(public, pepper, *whole), partial(kernel, *whole, out=out)
        times = [
            [seconds_of(call, 1) / states for call in ours]
            + [other.ask([name, peer_states, "loop"]) / peer_states]
            for _ in range(repeats + 1)
        ][1:]
        new, reused, loop = np.median(times, axis=0)
        ok = verdict(loop / new >= asked, loop / reused >= asked)
        yield BATCHES, name, asked, loop / new, loop / reused, 1e9 * new, 1e9 * reused, 1e9 * loop, ok


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


def process_rows(pepper: pk.PepperModel, repeats: int) -> Iterator[tuple]:
    """What only a new process shows: compiling all kernels, loading them, importing the package."""
    code, times = ALL_KERNELS % joint_links(pepper), defaultdict(list)
    for _ in range(max(1, repeats // 5)):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("cold", "warm"):
                times[name].append(float(python(code, PEPPER_KIN_CACHE=folder)))
    starts = {text: partial(python, text) for text in ("pass", "import pepper_kin")}
    bare, package = in_turn(starts, repeats, time.perf_counter).values()
    for name, asked, found in (
        ("all kernels compiled, cold", 5, np.median(times["cold"])),
        ("all kernels from cache", 0.3, np.median(times["warm"])),
        ("import pepper_kin, beyond a bare interpreter", 0.15, np.median(package - bare)),
    ):
        yield "job | asked {:g} s | measured {:.2g} s | ok", name, asked, found, found <= asked


@figures("benchmarks/dynamics.md", "MuJoCo; the interpreter of another Pinocchio", states=20_000, repeats=3)
def dynamics(states: int = 100_000, repeats: int = 15, pinocchio_python: str = "") -> Iterator[tuple | str]:
    """Speed of dynamics and kinematics: batches against loops over Pinocchio and MuJoCo, and the rest of it.

    Peers run in the same process, or in one of their own with `--pinocchio-python`, the interpreter of an
    environment with another Pinocchio, interleaved; ratios are medians over repeats, of processor time where
    one thread computes.  Before it is timed, each batch is compared with its peer's results; loops take a
    tenth of the states.
    """
    pepper, target, few = pk.load_pepper(), pk.kernels.host_target(), states // 10
    yield (
        f"{target.cpu}, vectors of {target.vector_bytes} bytes, {os.cpu_count()} cores, "
        f"Python {platform.python_version()}, pin {pin.__version__}, MuJoCo {mujoco.__version__}; "
        f"{states} states (loops: {few}), medians of {repeats} interleaved repeats."
    )
    other = other_pinocchio(pinocchio_python, pepper, *one_state(pepper)) if pinocchio_python else None
    title = (
        "Times faster than the loop; one thread, float64, NumPy arrays in and out, {}-joint {}. "
        "New arrays: the public function; `out=`: its kernel, writing to an array that is there already:"
    )
    yield title.format(pepper.n, "load_pepper()")
    yield from batch_rows(pepper, states, few, repeats)
    yield "Kernels, float64, one thread, and what single precision and a second thread bring:"
    yield from kernel_rows(pepper, states, repeats)
    yield f"One state from Python, {pepper.n} joints (processor time, in turn):"
    yield from single_rows(pepper, 20 if repeats < 10 else 200, max(repeats, 10), other)
    if other:
        yield f"Batches, times faster than a loop over Pinocchio {other.version} (processor time, in turn):"
        yield from newest_rows(pepper, states, few, repeats, other)
        other.close()
    yield "New processes:"
    yield from process_rows(pepper, repeats)
    mimic = pk.load_pepper(hands="mimic")
    yield title.format(mimic.n, 'load_pepper(hands="mimic")')
    yield from batch_rows(mimic, states, few, repeats)
