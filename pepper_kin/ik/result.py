"""Result of an inverse-kinematics call, with its certificate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.exceptions import ModelError
from pepper_kin.ik.tasks.task import words_for
from pepper_kin.status import ResultStatus

if TYPE_CHECKING:
    from pepper_kin.collision import Clearance


class IKStatus(ResultStatus):
    """How a call ended."""

    SOLVED = "solved", "Use q."
    CLOSEST_UNREACHABLE = (
        "closest_unreachable",
        "No posture of the joints that may move was found to reach it, even without joint limits: bring the "
        "targets nearer or closer together, move the base, let more joints move, or loosen a "
        "tolerance.",
    )
    CLOSEST_LIMITS = (
        "closest_limits",
        "Only the joint limits are in the way: move the target or the base, let more joints move, or "
        "ask for less (a position without an orientation, a wider tolerance).",
    )
    CLOSEST_COLLISION = (
        "closest_collision",
        "It is reached only in collision: move the target or the obstacle, approach from another "
        "side, or give more restarts.",
    )
    TIMED_OUT = (
        "timed_out",
        "Time ran out before the search was done: give more time or a start nearer the target.",
    )


CONFLICT_ADVICE = (
    "Each of the tasks that are named can be met, but not all together: leave one out, bring their targets "
    "together, widen a tolerance, or say by `hard` or weights which counts most."
)
"""Advice of results with a `conflict`."""

NOT_EXAMINED = "collisions were not examined"
"""Line in the reports of calls with `collisions=False`."""


@dataclass(frozen=True)
class TaskError:
    """Error of one task, recomputed from q.

    Attributes:
        label: Part that the task moves.
        frame: Frame of the task; None for a posture.
        value: Error [unit].
        tolerance: Maximum allowed error [unit].
        unit: Unit of the error, such as "m" or "rad".
        shortfall: Error in words, with the target.
        attained: Reached value in words.
        name: Task in words, such as "orientation of left hand"; if empty, the label is used.
        hard: Whether the task is hard.
    """

    label: str
    frame: str | None
    value: float
    tolerance: float
    unit: str
    shortfall: str
    attained: str
    name: str = ""
    hard: bool = False

    @property
    def met(self) -> bool:
        """Whether the error is within the tolerance."""
        return self.value <= self.tolerance


@dataclass(frozen=True)
class TorqueUse:
    """Joint with the largest ratio of gravity torque to effort limit.

    Attributes:
        joint: Name of the joint.
        ratio: |gravity torque| / effort limit; above 1 the robot cannot hold the posture.
        allowed: Maximum ratio that motions leave for holding still; see `MotionRequirements`.
    """

    joint: str
    ratio: float
    allowed: float = 1.0


@dataclass(frozen=True)
class IKCertificate:
    """Properties of q, computed from the problem and q alone; `IKResult` describes the attributes."""

    errors: tuple[TaskError, ...]
    active_limits: tuple[str, ...]
    blocking_limits: tuple[str, ...]
    clearance: Clearance | None
    in_collision: bool | None
    torque_use: TorqueUse
    proof: str
    balance: float | None = None
    stands: bool = True
    note: str = ""
    aside: tuple[str, ...] = ()


class SearchResult(NamedTuple):
    """Result of a search before certification.

    Attributes:
        q: Joint positions within the limits [rad or m], shape (n,), read-only.
        status: Status of the search.
        iterations: Number of steps over all starts.
        restarts: Number of starts used after the first.
    """

    q: Array
    status: IKStatus
    iterations: int
    restarts: int


@dataclass(frozen=True, eq=False, init=False)
class IKResult(FrozenArrays):
    """Best configuration found, with a certificate recomputed from it instead of the solver's own values.

    The certificate is computed at its first use and cached.

    Attributes:
        status: Status of the call.
        q: Joint positions within all limits [rad or m], shape (n,), read-only.
        iterations: Number of steps over all starts.
        restarts: Number of starts used after the first.
        time: Wall-clock time of the call, without the loading or compiling of code [s].
        solver: Name of the solver.
        seed: Seed of the restarts.
        evidence: Function that computes the certificate.
        hint: Further findings, such as that more joints would help or, after a timeout, that the target is
            proven out of reach; may be empty.
        conflict: Names of tasks that cannot be met all together, although any fewer of them can; empty if
            that is not the reason.
    """

    status: IKStatus
    q: Array
    iterations: int
    restarts: int
    time: float
    solver: str
    seed: int
    evidence: Callable[[], IKCertificate] = field(repr=False)
    hint: str = ""
    conflict: tuple[str, ...] = ()

    def __init__(
        self,
        status: IKStatus,
        q: Array,
        iterations: int,
        restarts: int,
        time: float,
        solver: str,
        *,
        seed: int,
        evidence: Callable[[], IKCertificate],
        hint: str = "",
        conflict: tuple[str, ...] = (),
    ) -> None:
        # One update: the generated constructor of a frozen class, attribute by attribute, takes a
        # microsecond.
        self.__dict__.update(
            status=status, q=q, iterations=iterations, restarts=restarts, time=time, solver=solver, seed=seed,
            evidence=evidence, hint=hint, conflict=conflict,
        )  # fmt: skip

    @cached_property
    def certificate(self) -> IKCertificate:
        """Certificate of q, recomputed from the tasks, the robot and the scene.

        Raises:
            ModelError: if the status is better than the errors: the search used another robot model.
        """
        certificate = self.evidence()
        worse = [error for error in certificate.errors if not error.met]
        if self.success and worse:
            error = worse[0]
            size, allowed = words_for(error.value, error.unit), words_for(error.tolerance, error.unit)
            raise ModelError(
                f"the search took {error.name or error.label} for met, but its error is {size}, {allowed} "
                "allowed: if the model was changed after its first use, load it again and change it before"
            )
        return certificate

    @property
    def proof(self) -> str:
        """Proof in words of how near a frame comes to its target at best; empty without a proof."""
        return self.certificate.proof

    @property
    def errors(self) -> tuple[TaskError, ...]:
        """Error of each task, groups split into their parts."""
        return self.certificate.errors

    @property
    def active_limits(self) -> tuple[str, ...]:
        """Names of the movable joints that are at a limit."""
        return self.certificate.active_limits

    @property
    def blocking_limits(self) -> tuple[str, ...]:
        """Names of the joints at a limit against which unmet tasks push."""
        return self.certificate.blocking_limits

    @property
    def clearance(self) -> Clearance | None:
        """Distances to obstacles and between the robot's links [m]; None with `collisions=False`."""
        return self.certificate.clearance

    @property
    def in_collision(self) -> bool | None:
        """Whether the robot touches itself or the scene at q; None with `collisions=False`."""
        return self.certificate.in_collision

    @property
    def balance(self) -> float | None:
        """Distance of the center of mass from the edges of the wheels' triangle [m]; None if not required."""
        return self.certificate.balance

    @property
    def torque_use(self) -> TorqueUse:
        """Joint with the largest ratio of gravity torque to effort limit."""
        return self.certificate.torque_use

    def __getstate__(self) -> dict[str, Any]:
        """Return the state with the certificate instead of the function that computes it."""
        certificate = self.certificate
        return {**self.__dict__, "certificate": certificate, "evidence": None}

    @property
    def success(self) -> bool:
        """Whether every task is met."""
        return self.status is IKStatus.SOLVED

    @property
    def hard_met(self) -> bool:
        """Whether every hard task is met; True without hard tasks."""
        return all(error.met for error in self.errors if error.hard)

    @property
    def met(self) -> tuple[str, ...]:
        """Names of the tasks that are met, such as "position of left hand", groups split into their parts."""
        return tuple(error.name or error.label for error in self.errors if error.met)

    @property
    def unmet(self) -> tuple[str, ...]:
        """Names of the tasks that are not met."""
        return tuple(error.name or error.label for error in self.errors if not error.met)

    @property
    def advice(self) -> str:
        """Advice on what to do next, in one sentence; two if only hard tasks are met."""
        if self._is_proven_out_of_reach:
            return f"Time ran out, but more of it would not help.  {IKStatus.CLOSEST_UNREACHABLE.advice}"
        advice = CONFLICT_ADVICE if self._is_contradictory else self.status.advice
        if self._only_hard_met:
            return f"Use q if the soft tasks may fall short.  Otherwise: {advice}"
        return advice

    @property
    def _is_proven_out_of_reach(self) -> bool:
        return self.status is IKStatus.TIMED_OUT and bool(self.hint)

    @property
    def _is_contradictory(self) -> bool:
        return bool(self.conflict) and self.status is IKStatus.CLOSEST_UNREACHABLE

    @property
    def _only_hard_met(self) -> bool:
        return not self.success and self.hard_met and any(error.hard for error in self.errors)

    def report(self) -> str:
        """Return the result in plain words, one fact a line."""
        lines = [self._headline()]
        if self.met and self.unmet:
            lines.append(f"met: {', '.join(self.met)}; not met: {', '.join(self.unmet)}")
        lines += [self._line(error) for error in self.errors]
        if self.conflict:
            lines.append(f"{listed(self.conflict)} contradict each other: any fewer of them can be met.")
        if self.hint:
            lines.append(f"{self.hint}.")
        if not self.success:
            lines += self._extent()
        if self.clearance is not None:
            touching = "; it touches" if self.in_collision else ""
            note = f".  {self.certificate.note}" if self.certificate.note else ""
            lines.append(f"clearance: {self.clearance.sentence()}{touching}{note}")
        else:
            lines.append(NOT_EXAMINED)
        if self.certificate.aside:
            lines.append(f"no task moves {listed(self.certificate.aside)}: to keep clear, or in balance")
        lines.append(self._torque())
        if self.balance is not None and not self.certificate.stands:
            lines.append(self._standing(self.balance))
        lines.append(
            f"{self.solver}: {self.iterations} iterations, {self.restarts} restarts (seed {self.seed}), "
            f"{1000 * self.time:.1f} ms"
        )
        if not self.success:
            lines.append(self.advice)
        return "\n".join(lines)

    def _headline(self) -> str:
        """Return the first line of the report."""
        words = {
            IKStatus.SOLVED: "solved: every task is met",
            IKStatus.CLOSEST_UNREACHABLE: "not reached: beyond reach; this is the closest found",
            IKStatus.CLOSEST_LIMITS: "not reached: blocked by joint limits; this is the closest found",
            IKStatus.CLOSEST_COLLISION: "not reached: blocked by collision; this is the closest found",
            IKStatus.TIMED_OUT: "not reached: time ran out; this is the closest found so far",
        }[self.status]
        if self._is_proven_out_of_reach:
            words = "not reached: time ran out, but it is beyond reach; this is the closest found so far"
        if self._is_contradictory:
            words = "not reached: tasks contradict each other; this is the closest found"
        if self._only_hard_met:
            return words.replace("not reached", "every hard task is met, not every soft one")
        if self.success or self.hard_met:
            return words
        return words.replace("not reached", "not reached, not even every hard task")

    def _line(self, error: TaskError) -> str:
        """Return the line of a task: its error and the reached value, with blocking limits if it is unmet."""
        if error.met:
            hard = " (hard)" if error.hard else ""
            return f"{error.label}{hard}: error {words_for(error.value, error.unit)}, {error.attained}"
        limits = self.blocking_limits
        their = "its limit" if len(limits) == 1 else "their limits"
        blocked = f": {listed(limits)} at {their}" if limits else ""
        return f"{error.shortfall}{blocked}; comes to {error.attained}"

    def _extent(self) -> list[str]:
        """Return lines on what is proven and what was only searched."""
        proven = (
            [f"proven by the lengths of the links: {self.proof}."]
            if self.proof not in ("", self.hint)
            else []
        )
        starts = f"{self.restarts + 1} start{'s' if self.restarts else ''}"
        return [*proven, f"this is the best of {starts}: that there is no closer one is not proven."]

    def _torque(self) -> str:
        """Return the line on the joint with the largest ratio of gravity torque to effort limit."""
        use = self.torque_use
        line = f"gravity uses at most {100 * use.ratio:.0f} % of a motor's torque ({use.joint})"
        if use.ratio <= use.allowed:
            return line
        if use.ratio > 1:
            return line + ": the robot cannot hold this posture"
        return f"{line}: motions leave {100 * use.allowed:.3g} % for holding still"

    def _standing(self, inside: float) -> str:
        """Return the line on a center of mass without the required balance."""
        where = f"{words_for(abs(inside), 'm')} {'inside' if inside >= 0 else 'outside'} the wheels' triangle"
        what = "less than motions keep" if inside >= 0 else "it would tip over"
        sought = ", and no other posture was found" if self.success else ""
        return f"the robot's center of mass is {where}: {what}{sought}"


def listed(names: tuple[str, ...]) -> str:
    """Return names joined for a sentence: "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
