"""Certificate of a result, computed from the problem and q alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.checked_world import LEFT_EMPTY, is_left_empty
from pepper_kin.collision.own_contacts import advice_on_own_links
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import suspect_millimeters
from pepper_kin.ik.collisions import Collisions, torque_ratios
from pepper_kin.ik.problem import OUT_OF_THE_WAY, TaskProblem, joints_used, make_problem, moved_aside
from pepper_kin.ik.reach_bound import why_beyond_reach
from pepper_kin.ik.result import IKCertificate, TaskError, TorqueUse
from pepper_kin.ik.standing import distance_inside, stands
from pepper_kin.ik.tasks.line_through_point import LineThroughPoint
from pepper_kin.ik.tasks.look_at import LookAt
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

# Maximum distance from a bound at which a joint counts as at it [rad or m].
AT_LIMIT = 1e-4

# Minimum ratio of the tasks' gradient along a joint to the weighted residual at which its limit blocks.
PUSH = 1e-3


class CertificateInputs(NamedTuple):
    """Inputs of a certificate, which is computed at its first use.

    Attributes:
        pepper: The robot.
        tasks: The tasks, groups split into their parts.
        q0: Start of the search, shape (n,) [rad or m].
        movable: Joints that may move, shape (n,); None for all.
        scene: The scene; None if collisions are not checked.
        q: Joint positions to certify, shape (n,) [rad or m].
        balance: Required distance from the edges of the wheels' triangle [m]; None for none.
        loads: Carried objects; None for the objects with a mass attached in the scene.
    """

    pepper: PepperModel
    tasks: tuple[Task, ...]
    q0: Array
    movable: np.ndarray | None
    scene: Scene | None
    q: Array
    balance: float | None = None
    loads: Loads | None = None

    def certificate(self) -> IKCertificate:
        """Return the certificate."""
        movable = np.ones(self.pepper.n, dtype=bool) if self.movable is None else self.movable
        problem = make_problem(self.pepper, self.tasks, self.q0, movable, keep_idle=self.scene is None)
        around = Collisions(self.pepper, self.scene, loads=self.loads)
        return certify(problem, around, self.q, self.balance)


def certify(
    problem: TaskProblem, collisions: Collisions, q: Array, balance: float | None = None
) -> IKCertificate:
    """Return the certificate of q, shape (n,) [rad or m], and of a required balance [m]."""
    pepper = problem.pepper
    errors = tuple(
        TaskError(
            label=task.label,
            frame=task.frame,
            value=task.error(pepper, q),
            tolerance=task.tolerance,
            unit=task.unit_on(pepper),
            shortfall=task.shortfall(pepper, q),
            attained=task.attained(pepper, q),
            name=task.name,
            hard=task.hard,
        )
        for task in problem.tasks
    )
    at_lower = problem.movable & (q <= problem.lower + AT_LIMIT)
    at_upper = problem.movable & (q >= problem.upper - AT_LIMIT)
    residual = problem.stack(problem.residuals(q))
    distance = float(np.linalg.norm(residual))
    pull = -problem.jacobian(q).T @ residual
    blocking = (at_lower & (pull < -PUSH * distance)) | (at_upper & (pull > PUSH * distance))
    met = all(error.met for error in errors)
    if met:
        blocking[:] = False
    ratios = torque_ratios(pepper, q, collisions.loads)
    hardest = int(np.argmax(ratios))
    way, aside = np.where(problem.movable, np.abs(q - problem.q0), 0.0), tuple[str, ...]()
    if collisions.considered and (way > OUT_OF_THE_WAY).any():
        aside = moved_aside(pepper, ~joints_used(pepper, problem.tasks), way)
    in_collision = None if not collisions.considered else not collisions.free(q)
    note = LEFT_EMPTY if is_left_empty(collisions.scene) else ""
    # Gaze and line tasks are met at any distance; the hint covers points that have to be reached.
    points = [task.target for task in problem.tasks if isinstance(task, LookAt | LineThroughPoint)]
    note = note or suspect_millimeters(max((float(np.abs(point).max()) for point in points), default=0.0))
    if in_collision:
        note = note or advice_on_own_links(pepper)
    return IKCertificate(
        errors=errors,
        active_limits=_names(problem, at_lower | at_upper),
        blocking_limits=_names(problem, blocking),
        clearance=collisions.clearance(q),
        in_collision=in_collision,
        torque_use=TorqueUse(
            pepper.joint_names[hardest], float(ratios[hardest]), pepper.requirements.holding_share
        ),
        proof="" if met else why_beyond_reach(problem),
        balance=None if balance is None else float(distance_inside(pepper, q, collisions.loads)),
        note=note,
        aside=aside,
        stands=balance is None or bool(stands(pepper, q, balance, collisions.loads)),
    )


def _names(problem: TaskProblem, mask: np.ndarray) -> tuple[str, ...]:
    """Return the names of the joints where the mask, shape (n,), is true."""
    return tuple(problem.pepper.joint_names[i] for i in np.flatnonzero(mask))
