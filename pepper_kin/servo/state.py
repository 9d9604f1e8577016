"""State of a servo after each tick."""

from __future__ import annotations

from dataclasses import dataclass

from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.collision import Clearance
from pepper_kin.ik.result import NOT_EXAMINED, listed
from pepper_kin.status import ResultStatus


class ServoStatus(ResultStatus):
    """Activity of a servo."""

    FOLLOWING = "following", "It follows the command; nothing to do."
    LIMITED = (
        "limited",
        "It follows as well as the named limits allow: command a slower or nearer motion if that matters.",
    )
    ARRIVED = "arrived", "Every task is within its tolerance."
    BLOCKED = (
        "blocked",
        "Joints brake, because they could not stop before a collision: command another direction, or "
        "accept a smaller margin.",
    )
    STOPPING = "stopping", "No recent command, so it brakes: command more often than `command_timeout`."
    RESTING = "resting", "It stands still and waits for a command."


@dataclass(frozen=True, eq=False)
class ServoState(FrozenArrays):
    """State of a servo after a tick.

    Attributes:
        tick: Number of ticks since the start.
        time: tick / rate [s].
        q: Joint positions to command [rad or m], shape (n,), read-only.
        v: Velocity of the tick, (q - last q) rate [rad/s or m/s], shape (n,), read-only.
        status: Activity of the servo.
        scale: Factor by which singularities reduce the commanded speed, of the task reduced most, 0 to 1.
        limited_by: Constraints active at the velocity, in words: "velocity of HeadYaw", "clearance of l_wrist
            and table", "singularity of left hand".
        relaxed: Constraints that braking cannot satisfy and that were relaxed, in words; limits of joint
            position, velocity and acceleration never are.
        errors: Error of each target task at the start of the tick [m or rad], in the order of the tasks, with
            groups expanded.
        aside: Joints that no target or twist moves and that move aside, such as "HeadYaw by 0.12 rad".
        clearance: Minimum distances at the start of the tick, to obstacles and to itself; inf if nothing is
            near, None with `collisions=False`.
    """

    tick: int
    time: float
    q: Array
    v: Array
    status: ServoStatus
    scale: float
    limited_by: tuple[str, ...]
    relaxed: tuple[str, ...]
    errors: tuple[float, ...]
    aside: tuple[str, ...]
    clearance: Clearance | None

    def report(self) -> str:
        """Return the state in plain words, one fact per line."""
        lines = [f"t = {self.time:.3f} s: {self.status.value}. {self.status.advice}"]
        if self.errors:
            lines.append("errors: " + ", ".join(f"{error:.4f}" for error in self.errors))
        if self.limited_by:
            lines.append("limited by " + ", ".join(self.limited_by))
        if self.relaxed:
            lines.append("relaxed: " + ", ".join(self.relaxed))
        if self.aside:
            lines.append(f"no task moves {listed(self.aside)}: to keep clear, or in balance")
        if self.scale < 1:
            lines.append(f"slowed to {100 * self.scale:.0f} % of the speed near a singularity")
        if self.clearance is None:
            lines.append(NOT_EXAMINED)
        else:
            near = {"obstacles": self.clearance.obstacles, "itself": self.clearance.itself}
            lines += [f"{1000 * d:.1f} mm from {name}" for name, d in near.items() if d < float("inf")]
        return "\n".join(lines)
