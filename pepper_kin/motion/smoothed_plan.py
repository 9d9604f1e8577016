"""Executable motion of a plan: path and timing optimized together, or retimed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pepper_kin.collision import Scene
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import ROBOT
from pepper_kin.motion.checks import Checks, checks_for
from pepper_kin.motion.optimization.optimize import optimize
from pepper_kin.motion.path_costs import PathCost
from pepper_kin.motion.plan_request import PlanOptions
from pepper_kin.motion.plan_request import moves_base as drives
from pepper_kin.motion.plan_result import Plan, along_trajectory
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.trajectory.balance import moves_base as wheels_move
from pepper_kin.trajectory.balance import support_polygon
from pepper_kin.trajectory.path import CubicPath

_LEAST_SHARE = 0.05  # minimum fraction of the timeout for the optimization


def refuse_costs(costs: Sequence[PathCost | Task | TaskGroup] | None) -> None:
    """Refuse soft costs together with smoothing, since the optimization would undo them.

    Raises:
        InvalidValueError: if soft costs are given.
    """
    if costs is not None:
        raise InvalidValueError("smooth", True, "False with soft costs: time such a plan with retime()")


def smoothed(pepper: PepperModel, plan: Plan, scene: Scene | None, options: PlanOptions) -> Plan:
    """Return a plan with a trajectory: optimized if that is better than retimed.

    The optimized motion is accepted only if it keeps everywhere what the curve of a plan keeps: half the
    margin, and holding torques.

    Args:
        pepper: The robot.
        plan: The plan; one without a curve is returned unchanged.
        scene: The world around the robot.
        options: Options of the plan; at least a twentieth of the time is left for the optimization.
    """
    balance, payload, timeout = options.balance, options.payload, options.timeout
    if plan.curve is None:
        return plan
    try:
        what = _not_optimized(
            pepper, plan.curve, None if balance == ROBOT else checked_balance(pepper, balance)
        )
        if what is not None:
            motion = retime(pepper, plan, payload=payload, scene=scene)
            message = f"{plan.message} It was timed along its own path, in {motion.duration:.3f} s: "
            return replace(plan, trajectory=motion, message=f"{message}{what} is not optimized.")
        if support_polygon(pepper) is None:
            balance = None
        left = max(timeout - plan.time, _LEAST_SHARE * timeout)
        found = optimize(
            pepper, plan, scene, margin=options.margin, timeout=left, balance=balance, payload=payload,
            torque_scale=options.torque_scale, constraints=options.constraints or (),
        )  # fmt: skip
    except InfeasibleError as error:
        return replace(plan, message=f"{plan.message} It cannot be timed: {error}")
    reason = found.message
    if found.success:
        checks = checks_for(pepper, scene, static_limits(pepper, None, payload, scene, options.torque_scale))
        if _keeps_what_plans_keep(checks, found.trajectory, options.margins):
            made = along_trajectory(pepper, plan, found.trajectory, scene, options.margin)
            message = f"{plan.message} Optimized: {reason[0].lower()}{reason[1:]}"
            errors, time = found.constraint_errors, plan.time + found.time
            return replace(made, message=message, optimized=found, constraint_errors=errors, time=time)
        reason = "The best found keeps less than half the margin, or cannot be held against gravity."
    message = f"{plan.message} Timed along its own path, in {found.before.duration:.3f} s: {reason}"
    return replace(
        plan, trajectory=found.before, optimized=found, message=message, time=plan.time + found.time
    )


def _not_optimized(pepper: PepperModel, curve: CubicPath, balance: float | None) -> str | None:
    """Return in words why `optimize` cannot handle a motion; None if it can."""
    if drives(pepper, np.flatnonzero((curve.coefficients[:, 1:] != 0.0).any(axis=(0, 1)))):
        return "a base that goes where it points"
    if balance is not None and support_polygon(pepper) is not None and wheels_move(pepper):
        return "balance over a base that moves"
    return None


def _keeps_what_plans_keep(checks: Checks, motion: Trajectory, margins: tuple[float, float]) -> bool:
    """Whether a whole motion keeps half the margins of its ends, and can be held."""
    moved = np.flatnonzero(motion.start != motion.end)
    kept, kept_self = checks.margins(motion.start, motion.end[None], moved, margins[0])
    kept, strictly = max(kept / 2, margins[1]), margins[1] > 0.0
    return is_clear_along(checks, motion, (kept, kept_self / 2), strictly=strictly)
