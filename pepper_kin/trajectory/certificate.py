"""Certificate of a trajectory, from an independent examination."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array, BriefRepr, FrozenArrays, kept_read_only
from pepper_kin.exceptions import beside_limits


@dataclass(frozen=True, eq=False)
class LimitCheck(FrozenArrays):
    """Distance of each joint from its limits in one quantity; arrays are indexed by joint.

    Position, velocity, acceleration and jerk are polynomials, and their exact extremes are compared.  Torques
    are known at the states examined, and between these states to `resolution`, which counts.

    Attributes:
        quantity: "position", "velocity", "acceleration", "jerk" or "torque".
        joint_names: Names of the joints.
        units: Unit of each joint's margin, value and limits.
        margin: Minimum distance to the nearer limit, negative if it is exceeded, inf without a limit.
        value: Value of the quantity at that instant.
        lower: Lower limits.
        upper: Upper limits.
        time: Time of that instant [s].
        tolerance: Violation that is attributed to rounding.
        resolution: Proven bound on how much nearer to its limit the quantity may be between the states
            examined; zero where exact extremes are known.
        allowance: Distance beyond the limit that is allowed for the bound between states.
    """

    quantity: str
    joint_names: tuple[str, ...]
    units: tuple[str, ...]
    margin: Array
    value: Array
    lower: Array
    upper: Array
    time: Array
    tolerance: Array
    resolution: Array
    allowance: Array

    def __post_init__(self) -> None:
        for name in ("margin", "value", "lower", "upper", "time", "tolerance", "resolution", "allowance"):
            object.__setattr__(self, name, kept_read_only(getattr(self, name)))

    @property
    def success(self) -> bool:
        """Whether all joints are within their limits at the states, and to `allowance` between them."""
        inside, proven = self.margin >= -self.tolerance, self.resolution <= self._room
        return bool(np.all(inside & proven))

    @property
    def _room(self) -> Array:
        """Maximum `resolution` that still proves the limit; a margin below zero counts as zero."""
        return np.maximum(self.margin, 0.0) + self.allowance

    @property
    def use(self) -> Array:
        """Fraction of the limit used at the worst instant: 1 at the limit, 0 in the middle or without one."""
        half = (self.upper - self.lower) / 2
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(half), 1.0 - self.margin / half, 0.0)

    @property
    def worst(self) -> int:
        """Index of the joint that uses the largest fraction of its limit."""
        return int(np.argmax(self.use))

    def sentence(self) -> str:
        """Say which joint comes nearest to its limit, and when."""
        unproven = (self.margin >= -self.tolerance) & (self.resolution > self._room)
        j = int(np.argmax(unproven)) if unproven.any() and not self.margin.min() < 0 else self.worst
        if not np.isfinite(self.margin[j]):
            return f"{self.quantity}: no joint has a limit"
        outside = bool(self.margin[j] < -self.tolerance[j])
        word = "OUTSIDE" if outside else "inside"
        value, *limits = beside_limits(self.value[j], self.lower[j], self.upper[j], outside=outside)
        between = _between(float(self.resolution[j]), self.units[j], "more", float(self._room[j]))
        return (
            f"{self.quantity}: {self.joint_names[j]} reaches {value} {self.units[j]} "
            f"at {self.time[j]:.3f} s, {abs(self.margin[j]):.3g} {self.units[j]} {word} "
            f"[{', '.join(limits)}]{between}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None stands for infinity."""
        joints = {
            name: {
                "margin": _plain(self.margin[j]),
                "value": float(self.value[j]),
                "lower": _plain(self.lower[j]),
                "upper": _plain(self.upper[j]),
                "unit": self.units[j],
                "time": float(self.time[j]),
                "resolution": _plain(self.resolution[j]),
            }
            for j, name in enumerate(self.joint_names)
        }
        return {"success": self.success, "worst_joint": self.joint_names[self.worst], "joints": joints}


@dataclass(frozen=True)
class ScalarCheck:
    """A scalar quantity that is compared with a required value.

    Attributes:
        quantity: Name of the quantity.
        margin: Distance of the worst value over the trajectory from the required one, negative if violated
            [unit]; for clearance, of the bound that is proven between the states examined too.
        value: Value at the worst instant [unit].
        time: Time of that instant [s].
        unit: Unit of the value.
        detail: Meaning of the value, in words.
        resolution: Proven bound on how much worse the value may be between the states examined [unit].
        limit: Maximum speed, or minimum clearance, allowed [unit]; None where it is not stated.
        allowance: Distance beyond the requirement that is allowed for the bound between states [unit];
            infinite where `margin` already includes the bound, or there is nothing between states.
    """

    quantity: str
    margin: float
    value: float
    time: float
    unit: str
    detail: str
    resolution: float = 0.0
    limit: float | None = None
    allowance: float = float("inf")

    @property
    def success(self) -> bool:
        """Whether the requirement holds at the states examined, and between them to `allowance`."""
        return self.margin >= 0.0 and self.resolution <= self.margin + self.allowance

    def sentence(self) -> str:
        """Say the worst value and when it occurs."""
        word = "" if self.success else "VIOLATED: " if self.margin < 0.0 else "NOT PROVEN: "
        room = self.margin + self.allowance if self.margin >= 0.0 else float("inf")
        between, limit = _between(self.resolution, self.unit, "worse", room), ""
        if self.limit is None:
            value = f"{self.value:.3g}"
        else:
            value, limit = beside_limits(self.value, self.limit, outside=self.margin < 0.0)
            least = self.quantity.endswith("clearance")
            limit = f", {limit} {self.unit} asked" if least else f", limit {limit} {self.unit}"
        words = f"{word}{value} {self.unit} {self.detail}{limit}"
        return f"{self.quantity.replace('_', ' ')}: {words}, at {self.time:.3f} s{between}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None stands for infinity."""
        return {
            "success": self.success,
            "margin": _plain(self.margin),
            "value": _plain(self.value),
            **({} if self.limit is None else {"limit": self.limit}),
            "unit": self.unit,
            "time": self.time,
            "resolution": _plain(self.resolution),
        }


@dataclass(frozen=True, eq=False)
class Certificate(BriefRepr):
    """Limits, continuity, balance and clearances of a trajectory, by code independent of what made it.

    Attributes:
        duration: Duration of the trajectory [s].
        samples: Number of states examined for torque, balance and speeds.
        step: Time between regular states [s]; both sides of every knot are examined in addition.
        position: Positions compared with the position limits.
        velocity: Velocities compared with the velocity limits.
        acceleration: Accelerations compared with the acceleration limits.
        torque: Torques compared with the effort limits, computed by `pepper_kin.dynamics.newton_euler`.
        position_continuity: Largest jump of a joint's position at a knot.
        velocity_continuity: Largest jump of a joint's velocity at a knot.
        balance: Distance of the zero-moment point from the edge of the wheels' triangle, negative outside;
            None for a robot without Pepper's wheels, and with `balance=None`.
        obstacle_clearance: Minimum distance to the objects of the scene; it succeeds if its bound is above
            zero, or keeps the margin asked, everywhere; None with `collisions=False` and where the scene is
            empty.
        self_clearance: Minimum distance between the robot's own parts and attached objects; None with
            `collisions=False`.
        jerk: Jerk compared with the jerk limits; None if none were given.
        acceleration_continuity: Largest jump of a joint's acceleration at a knot; None without jerk limits.
        hand_speed: Speeds of frames compared with their limits; None if none were given.
        wheel_speed: Speed of the planar base's wheel that is nearest to its limit; None for other robots.
        wheel_acceleration: Acceleration of the wheel that is nearest to its limit.
        base_speed: Speed of a planar base compared with its limit.
    """

    duration: float
    samples: int
    step: float
    position: LimitCheck
    velocity: LimitCheck
    acceleration: LimitCheck
    torque: LimitCheck
    position_continuity: ScalarCheck
    velocity_continuity: ScalarCheck
    balance: ScalarCheck | None
    obstacle_clearance: ScalarCheck | None
    self_clearance: ScalarCheck | None
    jerk: LimitCheck | None = None
    acceleration_continuity: ScalarCheck | None = None
    hand_speed: ScalarCheck | None = None
    wheel_speed: ScalarCheck | None = None
    wheel_acceleration: ScalarCheck | None = None
    base_speed: ScalarCheck | None = None

    @property
    def clearance(self) -> ScalarCheck | None:
        """The smaller of the obstacle and self clearance; None if neither was examined."""
        examined = [one for one in (self.obstacle_clearance, self.self_clearance) if one is not None]
        return min(examined, key=lambda check: check.value, default=None)

    @property
    def checks(self) -> dict[str, LimitCheck | ScalarCheck]:
        """All checks that were made, by name."""
        found: dict[str, LimitCheck | ScalarCheck | None] = {
            "position": self.position,
            "velocity": self.velocity,
            "acceleration": self.acceleration,
            "torque": self.torque,
            "position_continuity": self.position_continuity,
            "velocity_continuity": self.velocity_continuity,
            "balance": self.balance,
            "obstacle_clearance": self.obstacle_clearance,
            "self_clearance": self.self_clearance,
            "jerk": self.jerk,
            "acceleration_continuity": self.acceleration_continuity,
            "hand_speed": self.hand_speed,
            "wheel_speed": self.wheel_speed,
            "wheel_acceleration": self.wheel_acceleration,
            "base_speed": self.base_speed,
        }
        return {name: check for name, check in found.items() if check is not None}

    @property
    def success(self) -> bool:
        """Whether every check passed."""
        return all(check.success for check in self.checks.values())

    @property
    def failures(self) -> tuple[str, ...]:
        """Names of the checks that did not pass."""
        return tuple(name for name, check in self.checks.items() if not check.success)

    def report(self) -> str:
        """Return the results in words, one line per check."""
        verdict = "passes every check" if self.success else f"fails: {', '.join(self.failures)}"
        head = (
            f"Trajectory of {self.duration:.3f} s, {self.samples} states examined "
            f"(every {self.step * 1e3:g} ms and both sides of every knot): {verdict}."
        )
        names = ("balance", "obstacle_clearance", "self_clearance", "jerk")
        missing = [name.replace("_", " ") for name in names if getattr(self, name) is None]
        lines = [f"  {check.sentence()}" for check in self.checks.values()]
        return "\n".join([head, *lines, *(f"  {name}: not examined" for name in missing)])

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "success": self.success,
            "duration": self.duration,
            "samples": self.samples,
            "step": self.step,
            **{name: check.as_dict() for name, check in self.checks.items()},
        }


def _between(resolution: float, unit: str, word: str, room: float) -> str:
    """Return words on the bound between the states examined; empty if the resolution is zero."""
    if resolution == 0.0:
        return ""
    if not np.isfinite(resolution):
        return "; nothing is known between the states examined"
    more = f", which proves no limit: {room:.2g} would" if resolution > room else ""
    return f"; between the states examined at most {resolution:.2g} {unit} {word}{more}"


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
