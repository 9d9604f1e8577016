"""A quick comparison of fast functions with the usual alternatives on this machine."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.dynamics import inverse_dynamics
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import HandPosition, solve, solve_batch
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.text_table import text_table
from pepper_kin.twin import Twin

Array = NDArray[np.float64]

_FRAME = "LArm_effector"
_STATES = 4000  # of a batch; a loop takes a twentieth of them
_SINGLE_TARGETS = 20
_BATCH_TARGETS = 500
_STEPS = 400  # of the twin; the interpreted way takes a tenth of them
_TIMESTEP = 0.001  # [s]


@dataclass(frozen=True)
class BenchRow:
    """One thing done in two ways.

    Attributes:
        name: What is done.
        ours: The library's fast way, in words.
        seconds: Its median time for one [s].
        peer: The other way, in words.
        peer_seconds: Its median time for one [s].
        quality: How the results of the two compare, in words.
    """

    name: str
    ours: str
    seconds: float
    peer: str
    peer_seconds: float
    quality: str

    @property
    def ratio(self) -> float:
        """How many times as long the other way takes."""
        return self.peer_seconds / self.seconds


@dataclass(frozen=True)
class BenchResult:
    """What was measured, and where.

    Attributes:
        machine: Processor architecture, number of processors, system.
        repeats: Times each measurement was taken, in turn with its peer.
        seed: Of the states and targets.
        rows: The measurements.
    """

    machine: str
    repeats: int
    seed: int
    rows: tuple[BenchRow, ...]

    def report(self) -> str:
        """Return the table in words."""
        head = ("what", "fast way", "time", "other way", "time", "ratio", "results")
        rows = [
            [
                row.name,
                row.ours,
                _time(row.seconds),
                row.peer,
                _time(row.peer_seconds),
                f"{row.ratio:.1f} x",
                row.quality,
            ]
            for row in self.rows
        ]
        note = f"Medians of {self.repeats} turns, one thread; ratios above 1: the fast way is faster."
        return "\n".join([f"On {self.machine}:", *text_table(head, rows), note])

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; times in seconds."""
        rows = [
            {
                "name": row.name, "ours": row.ours, "seconds": row.seconds, "peer": row.peer,
                "peer_seconds": row.peer_seconds, "ratio": row.ratio, "quality": row.quality,
            }
            for row in self.rows
        ]  # fmt: skip
        return {"machine": self.machine, "repeats": self.repeats, "seed": self.seed, "rows": rows}


def run_bench(
    pepper: PepperModel | None = None,
    *,
    repeats: int = 5,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> BenchResult:
    """Measure IK, batches and the twin against the other ways of the same library.

    The two ways of a row take turns, so that a busy moment of the machine hits both.  What is compiled is
    compiled before the clock runs; on a new machine that takes a minute.

    Args:
        pepper: The robot; `load_pepper()` if omitted.
        repeats: Turns of each measurement, at least 1.
        seed: Of the states and targets.
        progress: Called with the number of rows done and of all.

    Returns:
        Medians and ratios.

    Raises:
        InvalidValueError: for fewer than one repeat, or a negative seed.
    """
    if repeats < 1:
        raise InvalidValueError("repeats", repeats, "at least 1")
    if seed < 0:
        raise InvalidValueError("seed", seed, "at least 0")
    pepper = load_pepper() if pepper is None else pepper
    measures = (_one_ik, _batch_ik, _poses, _torques, _twin_step)
    rows = []
    for index, measure in enumerate(measures):
        progress(index, len(measures))
        rows.append(measure(pepper, np.random.default_rng(seed), repeats))
    progress(len(measures), len(measures))
    machine = f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}"
    return BenchResult(machine, repeats, seed, tuple(rows))


def _one_ik(pepper: PepperModel, rng: np.random.Generator, repeats: int) -> BenchRow:
    targets = _targets(pepper, rng, _SINGLE_TARGETS)
    solved: dict[str, int] = {}

    def with_solver(solver: str) -> Callable[[], None]:
        def run() -> None:
            found = [solve(pepper, HandPosition("left", target), solver=solver) for target in targets]
            solved[solver] = sum(result.success for result in found)

        return run

    ours, peer = _medians(repeats, with_solver("fast"), with_solver("placo"))
    count = len(targets)
    quality = f"solved {solved['fast']} and {solved['placo']} of {count}"
    return BenchRow("IK of a hand, one call", "fast", ours / count, "placo", peer / count, quality)


def _batch_ik(pepper: PepperModel, rng: np.random.Generator, repeats: int) -> BenchRow:
    targets = _targets(pepper, rng, _BATCH_TARGETS)
    few = targets[:_SINGLE_TARGETS]

    def loop() -> list[bool]:
        return [solve(pepper, HandPosition("left", target)).success for target in few]

    def batch() -> Array:
        return solve_batch(pepper, HandPosition("left", targets), collisions=False).codes == 0

    solved = f"solved {int(batch().sum())} of {len(targets)} and {sum(loop())} of {len(few)}"
    ours, peer = _medians(repeats, batch, loop)
    name, peers = "IK of a hand, many", "calls of fast"
    return BenchRow(name, "batch", ours / len(targets), peers, peer / len(few), solved)


def _poses(pepper: PepperModel, rng: np.random.Generator, repeats: int) -> BenchRow:
    q, _, _ = _states(pepper, rng)
    few = q[:: _STATES // 200]
    batch = frame_pose(pepper, q, _FRAME)[:: _STATES // 200]
    alone = np.array([frame_pose(pepper, state, _FRAME) for state in few])
    ours, peer = _medians(
        repeats,
        lambda: frame_pose(pepper, q, _FRAME),
        lambda: [frame_pose(pepper, state, _FRAME) for state in few],
    )
    off = float(np.abs(batch - alone).max())
    return BenchRow("pose of a hand", "batch", ours / len(q), "one by one", peer / len(few), _same(off))


def _torques(pepper: PepperModel, rng: np.random.Generator, repeats: int) -> BenchRow:
    """Measure inverse dynamics against a loop over Pinocchio itself, without this library's checks."""
    import pinocchio

    q, v, a = _states(pepper, rng)
    few = slice(None, None, _STATES // 200)
    model = pepper.inner_model
    data = model.createData()

    def loop() -> Array:
        return np.array(
            [pinocchio.rnea(model, data, *state) for state in zip(q[few], v[few], a[few], strict=True)]
        )

    off = float(np.abs(inverse_dynamics(pepper, q, v, a)[few] - loop()).max())
    ours, peer = _medians(repeats, lambda: inverse_dynamics(pepper, q, v, a), loop)
    count = len(q[few])
    return BenchRow(
        "inverse dynamics", "batch", ours / len(q), "loop over Pinocchio", peer / count, _same(off)
    )


def _twin_step(pepper: PepperModel, rng: np.random.Generator, repeats: int) -> BenchRow:
    goal = np.clip(pepper.neutral() + 0.001, pepper.lower_limits, pepper.upper_limits)
    few, start, ends = _STEPS // 10, pepper.neutral(), {}
    twin, reference = Twin(pepper, _TIMESTEP), np.tile(goal, (_STEPS, 1))

    def hold() -> None:
        twin.reset(start)
        ends["ours"] = twin.follow(reference, np.zeros_like(reference)).position[few]

    def hold_over_pinocchio() -> None:
        ends["peer"] = _servo_over_pinocchio(pepper, twin, goal, few)

    ours, peer = _medians(repeats, hold, hold_over_pinocchio)
    off = float(np.abs(ends["ours"] - ends["peer"]).max())
    return BenchRow("step of the twin", "compiled", ours / _STEPS, "over Pinocchio", peer / few, _same(off))


def _servo_over_pinocchio(pepper: PepperModel, twin: Twin, goal: Array, steps: int) -> Array:
    """Return where servos far from their limits bring the robot: the twin's scheme, called from Python.

    The goal and the result have shape (n,) [rad or m].
    """
    import pinocchio

    servo, h = twin.actuators, twin.timestep
    model = pinocchio.Model(pepper.pinocchio_model)
    data = model.createData()
    model.armature = np.array(model.armature) + h * h * servo.stiffness + h * servo.damping
    q, v = pepper.neutral(), np.zeros(pepper.n)
    for _ in range(steps):
        torque = servo.stiffness * (goal - q - h * v) - servo.damping * v
        torque += pinocchio.computeGeneralizedGravity(model, data, q)
        v = v + h * pinocchio.aba(model, data, q, v, torque)
        q = q + h * v
    return np.asarray(q)


def _same(difference: float) -> str:
    return f"same to {difference:.0e}"


def _targets(pepper: PepperModel, rng: np.random.Generator, count: int) -> Array:
    """Return points that the left palm takes at random joint positions, so all can be reached [m]."""
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))
    return np.asarray(frame_pose(pepper, q, _FRAME)[:, :3, 3])


def _states(pepper: PepperModel, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    shape = (_STATES, pepper.n)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, shape)
    return q, rng.normal(size=shape), rng.normal(size=shape)


def _medians(repeats: int, *functions: Callable[[], object]) -> list[float]:
    """Return median times [s] of functions that take turns; each runs once before, to compile."""
    for function in functions:
        function()
    turns = [[_seconds(function) for function in functions] for _ in range(repeats)]
    return [statistics.median(column) for column in zip(*turns, strict=True)]


def _seconds(function: Callable[[], object]) -> float:
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def _time(seconds: float) -> str:
    return f"{seconds * 1e3:.2f} ms" if seconds >= 1e-3 else f"{seconds * 1e6:.2f} us"
