"""Minimum-effort motion between two states, with the full dynamics."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision.loads import loads_of
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.result import NOT_EXAMINED
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vector,
    check_choice,
    check_positive,
    check_whole,
    check_within_limits,
)
from pepper_kin.motion.optimization.cost import Cost, Figures, figures_of
from pepper_kin.motion.optimization.moving import free_joints
from pepper_kin.planners.optimization import Bounds, EffortStatus, OptimizationStatus, minimum_effort
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Samples, Trajectory
from pepper_kin.trajectory.active_limits import measure_use
from pepper_kin.trajectory.balance import wheel_limits
from pepper_kin.trajectory.limits import Limits
from pepper_kin.trajectory.samples import examination_step, sample_times

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


SOLVERS = ("newton", "ipopt", "fatrop")
_EXCESS = 0.02  # relative excess allowed for torques between the points of the transcription


class MinimumTorqueStatus(ResultStatus):
    """Status of the search; `advice` says what to try."""

    SOLVED = "solved", "Examine it with check(); obstacles were not looked at."
    NOT_CONVERGED = "not_converged", "Raise max_iterations, or try another solver."
    INFEASIBLE = "infeasible", "Allow more time, or give a limit that is zero another value."
    LIMITS_EXCEEDED = "limits_exceeded", "Use more intervals or a little more time."


@dataclass(frozen=True, eq=False)
class MinimumTorqueTrajectory(BriefRepr):
    """Result of `minimum_torque_trajectory`.

    Attributes:
        status: Status of the search.
        message: What happened, in a sentence with numbers.
        trajectory: The motion; None if the solver found none that joins start and goal.
        figures: Duration, jerk and effort of the motion; None without a motion.
        iterations: Number of iterations of the solver.
        time: Wall time, including building the problem [s].
        solver: Name of the solver.
    """

    status: MinimumTorqueStatus
    message: str
    trajectory: Trajectory | None
    figures: Figures | None
    iterations: int
    time: float
    solver: str

    @property
    def success(self) -> bool:
        """Whether the motion is optimal and keeps the limits."""
        return self.status is MinimumTorqueStatus.SOLVED

    def report(self) -> str:
        """Return in plain words the result, and what to try."""
        return f"{self.message} {self.status.advice} {NOT_EXAMINED.capitalize()}."


def minimum_torque_trajectory(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike,
    duration: float,
    *,
    intervals: int = 20,
    solver: str = "newton",
    max_iterations: int = 100,
    payload: Mapping[str, float] | None = None,
    scene: Scene | None = None,
) -> MinimumTorqueTrajectory:
    """Find the motion of given duration from rest to rest with minimum effort.

    The integral of sum_j (tau_j / maximum tau_j)^2 dt, tau = M(q) a + C(q, v) v + g(q), is minimized within
    the limits of position, velocity, acceleration and torque; all joints with nonzero limits may move.
    Wheels of a planar base keep their limits, too; "ipopt" and "fatrop" search without wheel limits, and a
    motion that violates them has the status LIMITS_EXCEEDED.  Collisions are not checked; `optimize` with
    `Cost(time=0, jerk=1e-3, effort=1)` and a duration avoids them.

    Args:
        pepper: The robot.
        start: First configuration [rad or m], shape (n,).
        goal: Last configuration [rad or m], shape (n,).
        duration: Duration [s].
        intervals: Number of segments of the motion.
        solver: "newton": splines of zero acceleration at both ends, by compiled kernels, in a fraction of a
            second.  "ipopt" and "fatrop": direct transcription by CasADi with free accelerations at both
            ends and exact Hessians, in seconds to minutes; a reference.
        max_iterations: Maximum number of iterations of the solver.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects.
        scene: The scene whose attached objects count with their mass; None for none.

    Returns:
        The motion.

    Raises:
        InvalidValueError: for a wrong shape, NaN, start equal to goal, or an unknown solver.
        LimitError: for a start or goal outside the joint limits, naming the joint.
    """
    begin = time.perf_counter()
    check_choice("solver", solver, SOLVERS)
    duration = check_positive("duration", duration, "s")
    check_whole("max_iterations", max_iterations, 0)
    first, last = (_end(pepper, q, name) for q, name in ((start, "start"), (goal, "goal")))
    if np.abs(last - first).max() < 1e-9:
        raise InvalidValueError("goal", "the start", "start and goal that differ")
    limits = _limits(pepper, loads_of(pepper, scene, payload))
    request = _Request(pepper, first, last, duration, intervals, max_iterations, solver, limits)
    stuck = _motionless(pepper, np.abs(last - first) > 1e-9, limits)
    found: tuple[MinimumTorqueStatus, Trajectory | None, int] = MinimumTorqueStatus.INFEASIBLE, None, 0
    if not stuck:
        found = _by_newton(request) if solver == "newton" else _by_casadi(request)
    status, trajectory, iterations = found
    if trajectory is None:
        message = f"No motion of {duration:.3g} s within the limits was found in {iterations} steps."
        return MinimumTorqueTrajectory(
            status, stuck or message, None, None, iterations, time.perf_counter() - begin, solver
        )
    share, limit = max((share, name) for name, share in _shares(pepper, trajectory, limits).items())
    if status is MinimumTorqueStatus.SOLVED and share > 1.0 + _EXCESS:
        status = MinimumTorqueStatus.LIMITS_EXCEEDED
    figures = figures_of(pepper, trajectory, limits.loads)
    message = (
        f"A motion of {duration:.3g} s with an effort of {figures.effort:.4g} s after {iterations} steps; "
        f"it uses up to {share:.1%} of the limits, of {limit} most."
    )
    return MinimumTorqueTrajectory(
        status, message, trajectory, figures, iterations, time.perf_counter() - begin, solver
    )


def _limits(pepper: PepperModel, loads: Loads) -> Limits:
    return Limits(
        pepper.velocity_limits, pepper.acceleration_limits, pepper.effort_limits, balance=None, loads=loads,
        wheels=wheel_limits(pepper),
    )  # fmt: skip


def _shares(pepper: PepperModel, trajectory: Trajectory, limits: Limits) -> dict[str, float]:
    """Return the largest fraction of each kind of limit that a motion uses."""
    duration, wheels = trajectory.duration, limits.wheels
    state = trajectory(sample_times(duration, examination_step(duration)))
    use = measure_use(pepper, state, replace(limits, wheels=None))
    found = {name: float(part.max()) for name, part in use.share.items()}
    if wheels is not None:
        found["wheel speed"] = float(wheels.shares(state.position, state.velocity).max())
        found["wheel acceleration"] = float(np.abs(wheels.accelerations(*state)).max() / wheels.acceleration)
    return found


def _motionless(pepper: PepperModel, moving: NDArray[np.bool_], limits: Limits) -> str:
    """Return a sentence on a joint that must move but cannot, or ""; `moving` is a mask, shape (n,)."""
    stuck = [
        (pepper.effort_limits == 0, "effort", "and all joints are moved"),
        (moving & (limits.velocity == 0), "velocity", "and start and goal differ there"),
        (moving & (limits.acceleration == 0), "acceleration", "and start and goal differ there"),
    ]
    for mask, quantity, why in stuck:
        if mask.any():
            return f"The {quantity} limit of {pepper.joint_names[int(np.argmax(mask))]} is 0, {why}."
    return ""


def _end(pepper: PepperModel, value: ArrayLike, name: str) -> Array:
    """Return start or goal of a motion after checks [rad or m], shape (n,).

    Args:
        pepper: The robot.
        value: Joint positions [rad or m], shape (n,).
        name: Name of the configuration in messages.

    Raises:
        InvalidValueError: for a wrong shape, NaN or infinity.
        LimitError: for a position beyond its joint's limits.
    """
    q = as_joint_vector(pepper, value, name)
    check_within_limits(pepper, q, name)
    return q


class _Request(NamedTuple):
    """A request for a motion.

    Attributes:
        pepper: The robot.
        first: Joint positions at the start [rad or m], shape (n,).
        last: Joint positions at the end [rad or m], shape (n,).
        duration: Duration [s].
        intervals: Number of intervals of the spline, or of the transcription.
        max_iterations: Maximum number of iterations of the solver.
        solver: One of `SOLVERS`; CasADi has the same names for "ipopt" and "fatrop".
        limits: Limits, with carried loads.
    """

    pepper: PepperModel
    first: Array
    last: Array
    duration: float
    intervals: int
    max_iterations: int
    solver: str
    limits: Limits


def _by_newton(request: _Request) -> tuple[MinimumTorqueStatus, Trajectory | None, int]:
    """Search by the Newton method on a spline; return status, motion and number of iterations."""
    from pepper_kin.motion.optimization.spline_problem import SplineProblem  # loads Numba: only here

    pepper, first, last, duration, intervals, max_iterations, _, limits = request
    still = np.zeros((2, pepper.n))
    straight = Samples(
        pepper.joint_names, np.array([0.0, duration]), np.stack([first, last]), still, still,
        pepper.joint_units,
    ).to_trajectory()  # fmt: skip
    weights = Cost(time=0.0, jerk=0.0, effort=1.0)
    problem = SplineProblem(pepper, straight, None, weights, limits, 0.0, intervals, all_joints=True)
    found = problem.descend(duration, max_iterations, float("inf"))
    if found.status is OptimizationStatus.START_INFEASIBLE:
        return MinimumTorqueStatus.INFEASIBLE, None, found.iterations
    good = found.status is OptimizationStatus.CONVERGED
    status = MinimumTorqueStatus.SOLVED if good else MinimumTorqueStatus.NOT_CONVERGED
    return status, problem.trajectory(found), found.iterations


def _by_casadi(request: _Request) -> tuple[MinimumTorqueStatus, Trajectory | None, int]:
    """Search by a general solver on a transcription of CasADi; return status, motion and iterations."""
    from pepper_kin.motion.optimization.carried import carrying_inverse_dynamics

    pepper, first, last, duration, intervals, max_iterations, solver, limits = request
    torque, still = carrying_inverse_dynamics(pepper, limits.loads), np.zeros(pepper.n)
    bounds = Bounds(
        pepper.lower_limits, pepper.upper_limits, pepper.velocity_limits, pepper.acceleration_limits
    )
    scale = np.where(np.isfinite(pepper.effort_limits), pepper.effort_limits, 1.0)
    found = minimum_effort(
        torque, (first, still), (last, still), duration, bounds,
        pepper.effort_limits, scale=scale, intervals=intervals, solver=solver, max_iterations=max_iterations,
    )  # fmt: skip
    status = {
        EffortStatus.SOLVED: MinimumTorqueStatus.SOLVED,
        EffortStatus.INFEASIBLE: MinimumTorqueStatus.INFEASIBLE,
    }.get(found.status, MinimumTorqueStatus.NOT_CONVERGED)
    if found.violation > 1e-5:
        ended = MinimumTorqueStatus.NOT_CONVERGED if found.status is EffortStatus.SOLVED else status
        return ended, None, found.iterations
    resting = ~free_joints(pepper, limits)  # so far up to rounding, but zero limits hold exactly
    q, v, a = found.position.copy(), found.velocity.copy(), found.acceleration.copy()
    q[:, resting], v[:, resting], a[:, resting] = first[resting], 0.0, 0.0
    samples = Samples(pepper.joint_names, found.time, q, v, a, pepper.joint_units)
    return status, samples.to_trajectory(), found.iterations
