"""Comparison of the twin with an independent engine: the same model, gains and inputs in MuJoCo."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, optional
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.model.text_table import text_table
from pepper_kin.motion import gesture
from pepper_kin.twin import ActuatorParameters, Twin, actuator_parameters
from pepper_kin.twin.actuators import TORQUE

SECONDS = 1.0
TIMESTEPS = (4e-4, 2e-4, 1e-4)  # [s]
LIMIT = 1e-3
"""Maximum difference of a joint after one second with the smallest timestep that passes [rad or m]."""
_PUSH_FRAME, _PUSH = "LArm_effector", np.array([-4.0, 3.0, 2.0])  # [N]
_PUSH_START, _PUSH_TIME = 0.2, 0.3  # [s]
_STEP = 0.05  # height of the steps relative to a joint's range
_GENTLE = 1e-3
"""Ratio of the push scenario's gains to Pepper's, low so that the push moves the arm."""


@dataclass(frozen=True, eq=False)
class ComparedMotion:
    """Scenario of both engines.

    Attributes:
        name: Name of the scenario.
        start: Positions at time 0, at rest [rad or m], shape (n,).
        actuators: Actuators of the twin; MuJoCo gets equal gains and torque limits.
        reference: Function from times [s] to reference positions and velocities.
        pushed: Whether a hand is pushed.
    """

    name: str
    start: Array
    actuators: ActuatorParameters
    reference: Callable[[Array], tuple[Array, Array]]
    pushed: bool = False


@dataclass(frozen=True)
class PhysicsRow:
    """Differences of one scenario.

    Attributes:
        name: Name of the scenario.
        moved: Maximum distance of a joint from its start [rad or m].
        timesteps: Timesteps, largest first [s].
        differences: Maximum difference of a joint at the end, for each timestep [rad or m].
        greatest: Maximum difference at any time, for each timestep [rad or m].
        joint: Joint with the maximum difference at the end with the smallest timestep.
    """

    name: str
    moved: float
    timesteps: tuple[float, ...]
    differences: tuple[float, ...]
    greatest: tuple[float, ...]
    joint: str

    @property
    def order(self) -> float:
        """Slope of log difference over log timestep: 1 if differences halve with the timestep.

        NaN if the engines agree to rounding.
        """
        if max(self.differences) < 1e-3 * LIMIT:
            return float("nan")
        slope = np.polyfit(np.log(self.timesteps), np.log(np.maximum(self.differences, 1e-300)), 1)[0]
        return float(slope)

    @property
    def shrinks(self) -> bool:
        """Whether differences decrease with every smaller timestep, or are far below the limit."""
        series = (self.differences, self.greatest)
        pairs = [pair for values in series for pair in itertools.pairwise(values)]
        return all(small < large or small < 1e-3 * LIMIT for large, small in pairs)

    @property
    def success(self) -> bool:
        """Whether differences shrink to `LIMIT` or below."""
        return self.shrinks and self.differences[-1] <= LIMIT


@dataclass(frozen=True)
class PhysicsCheck:
    """Comparison of the twin with MuJoCo.

    Attributes:
        robot: Name of the robot.
        duration: Length of each scenario [s].
        engine: Name and version of the other engine.
        rows: Results of the scenarios.
    """

    robot: str
    duration: float
    engine: str
    rows: tuple[PhysicsRow, ...]

    @property
    def success(self) -> bool:
        """Whether every scenario agrees."""
        return all(row.success for row in self.rows)

    def report(self) -> str:
        """Return the table of differences as text."""
        steps = self.rows[0].timesteps
        widths = (f"h = {1e3 * h:g} ms" for h in steps)
        head = ("scenario", "moved [rad or m]", *widths, "at any time", "order", "worst joint")
        rows = [
            [row.name, f"{row.moved:.2f}", *(f"{d:.1e}" for d in row.differences), f"{row.greatest[-1]:.1e}",
             "-" if np.isnan(row.order) else f"{row.order:.1f}", row.joint]
            for row in self.rows
        ]  # fmt: skip
        return "\n".join(
            [
                f"{self.robot} beside {self.engine}: largest difference of a joint after {self.duration:g} s "
                "[rad or m], same model, gains and inputs",
                *text_table(head, rows),
                "Both engines are of first order: differences shrink with the timestep. Stops and contacts "
                "are off in both.",
                f"Limit {LIMIT:g} after {self.duration:g} s with the smallest timestep: "
                + ("all within." if self.success else "BEYOND, or not shrinking."),
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        rows = [
            {
                "scenario": row.name, "moved": row.moved, "timesteps": list(row.timesteps),
                "differences": list(row.differences), "greatest": list(row.greatest),
                "order": None if np.isnan(row.order) else row.order, "joint": row.joint,
                "success": row.success,
            }
            for row in self.rows
        ]  # fmt: skip
        return {
            "success": self.success, "robot": self.robot, "duration": self.duration, "engine": self.engine,
            "limit": LIMIT, "rows": rows,
        }  # fmt: skip


def check_physics(
    pepper: PepperModel | None = None,
    *,
    timesteps: Sequence[float] = TIMESTEPS,
    duration: float = SECONDS,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PhysicsCheck:
    """Run a free swing, step responses, a gesture and a push in the twin and in MuJoCo.

    MuJoCo runs the model that `pepper.export("mjcf")` writes, with the gains and torque limits of the twin's
    actuators, the same commands at every step, and the same force on the hand; its joint limits and contacts
    are switched off, as are the twin's stops.

    Args:
        pepper: Pepper; `load_pepper()` if omitted.
        timesteps: At least two timesteps [s].
        duration: Length of each scenario [s].
        seed: Seed of the start of the free swing.
        progress: Function that is called with the numbers of finished and of all scenarios.

    Returns:
        Differences for each scenario and timestep.

    Raises:
        MissingDependencyError: if mujoco is not installed.
        InvalidValueError: for a timestep that is not positive, fewer than two, or a negative seed.
    """
    if seed < 0:
        raise InvalidValueError("seed", seed, "at least 0")
    mujoco = optional("mujoco", extra="mujoco", need="a check against MuJoCo")
    steps = tuple(sorted((check_positive("timestep", h, "s") for h in timesteps), reverse=True))
    if len(steps) < 2:
        raise InvalidValueError("timesteps", len(steps), "at least two")
    pepper = load_pepper() if pepper is None else pepper
    model = mujoco.MjModel.from_xml_string(pepper.export("mjcf"))
    check_positive("duration", duration, "s")
    motions, rows = _motions(pepper, seed), []
    for index, motion in enumerate(motions):
        progress(index, len(motions))
        rows.append(_compare(pepper, model, motion, steps, duration))
    progress(len(motions), len(motions))
    return PhysicsCheck(pepper.name, duration, f"MuJoCo {mujoco.__version__}", tuple(rows))


def _motions(pepper: PepperModel, seed: int) -> list[ComparedMotion]:
    """Return the scenarios: free swing, step responses, gesture and push."""
    n, stand = pepper.n, pepper.neutral()
    servos = actuator_parameters(pepper).changed(stop_stiffness=0.0, stop_damping=0.0)
    limp = servos.changed(mode=TORQUE)
    compliant = servos.changed(stiffness=_GENTLE * servos.stiffness, damping=10 * _GENTLE * servos.damping)
    rng = np.random.default_rng(seed)
    middle = 0.5 * (pepper.lower_limits + pepper.upper_limits)
    thrown = middle + 0.2 * rng.uniform(-1, 1, n) * (pepper.upper_limits - pepper.lower_limits)
    goal = np.clip(stand + _STEP * (pepper.upper_limits - pepper.lower_limits), stand, pepper.upper_limits)
    wave = gesture(pepper, "wave")

    def still(q: Array) -> Callable[[Array], tuple[Array, Array]]:
        return lambda time: (np.tile(q, (len(time), 1)), np.zeros((len(time), n)))

    def waving(time: Array) -> tuple[Array, Array]:
        state = wave(np.minimum(time, wave.duration))
        return state.position, state.velocity

    return [
        ComparedMotion("free swing", thrown, limp, still(thrown)),
        ComparedMotion("step responses", stand, servos, still(goal)),
        ComparedMotion("gesture: wave", wave(0.0).position, servos, waving),
        ComparedMotion("push on a hand", stand, compliant, still(stand), pushed=True),
    ]


def _compare(
    pepper: PepperModel, model: Any, motion: ComparedMotion, steps: tuple[float, ...], duration: float
) -> PhysicsRow:
    """Run a scenario in both engines with each timestep and return the differences."""
    ends, greatest, moved = [], [], 0.0
    for h in steps:
        count = round(duration / h)
        time: Array = h * np.arange(1, count + 1, dtype=float)
        q_ref, v_ref = motion.reference(time)
        ours = _ours(pepper, motion, h, q_ref, v_ref)
        theirs = _theirs(pepper, model, motion, h, q_ref, v_ref)
        difference = np.abs(ours - theirs)
        ends.append(difference[-1])
        greatest.append(float(difference.max()))
        moved = float(np.abs(ours - motion.start).max())
    joint = pepper.joint_names[int(np.argmax(ends[-1]))]
    return PhysicsRow(motion.name, moved, steps, tuple(float(d.max()) for d in ends), tuple(greatest), joint)


def _ours(pepper: PepperModel, motion: ComparedMotion, h: float, q_ref: Array, v_ref: Array) -> Array:
    """Return the twin's positions, shape (T, n) [rad], for references of equal shape."""
    twin = Twin(pepper, h, feedforward="none", actuators=motion.actuators)
    twin.reset(motion.start)
    if motion.pushed:
        twin.push(_PUSH_FRAME, _PUSH, start=_PUSH_START, duration=_PUSH_TIME)
    return twin.follow(q_ref, v_ref).position[1:]


def _theirs(
    pepper: PepperModel, model: Any, motion: ComparedMotion, h: float, q_ref: Array, v_ref: Array
) -> Array:
    """Return MuJoCo's positions, shape (T, n) [rad], for references of equal shape."""
    import mujoco

    model.opt.timestep = h
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    data = mujoco.MjData(model)
    places = [model.joint(name).qposadr[0] for name in pepper.joint_names]
    _drive(model, motion)
    data.qpos[places] = motion.start
    body, nothing = int(model.site(_PUSH_FRAME).bodyid[0]), np.zeros(3)
    logged = np.empty_like(q_ref)
    control = np.concatenate([q_ref, v_ref], axis=1)
    for k in range(len(q_ref)):
        data.ctrl[:] = control[k]
        data.qfrc_applied[:] = 0.0
        if motion.pushed and _PUSH_START - 1e-9 <= k * h < _PUSH_START + _PUSH_TIME - 1e-9:
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            point = data.site(_PUSH_FRAME).xpos
            mujoco.mj_applyFT(model, data, _PUSH, nothing, point, body, data.qfrc_applied)
        mujoco.mj_step(model, data)
        logged[k] = data.qpos[places]
    return logged


def _drive(model: Any, motion: ComparedMotion) -> None:
    """Set the gains and limits of MuJoCo's servos, which are in the robot's order, without feed-forward."""
    wanted = motion.actuators
    n = len(wanted.joint_names)
    limp = wanted.in_mode(TORQUE)
    kp, kd = np.where(limp, 0.0, wanted.stiffness), np.where(limp, 0.0, wanted.damping)
    model.actuator_gainprm[:, 0] = np.concatenate([kp, kd])
    model.actuator_biasprm[:n, 1], model.actuator_biasprm[n:, 2] = -kp, -kd
    model.actuator_ctrllimited[:] = 0
    model.body_gravcomp[:] = 0.0
    for name, limit in zip(wanted.joint_names, wanted.torque_limit, strict=True):
        finite = bool(np.isfinite(limit))
        model.jnt_actfrclimited[model.joint(name).id] = finite
        model.jnt_actfrcrange[model.joint(name).id] = (-limit, limit) if finite else (0.0, 0.0)
