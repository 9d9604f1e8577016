"""Warnings on the pages: contact, torques beyond their limits, and tipping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Contact, Scene, contacts, loads_of
from pepper_kin.collision.loads import inverse_dynamics_with
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.balance import balance_margin, support_polygon
from pepper_kin.viewer.server.merging import carriers_of
from pepper_kin.viewer.server.readings import torque_use
from pepper_kin.viewer.server.words import contact_words, joint_words, length_words, sentence
from pepper_kin.viewer.touching import touching_names

STAYS = 2.0
"""Time for which an ended warning stays, so that it can be read [s]."""


@dataclass(frozen=True)
class _Violation:
    """A violation of a limit.

    Attributes:
        still: Whether gravity alone causes it, without any motion.
        amount: Size: ratio to the torque limit, or distance outside the wheels [m].
        joint: Name of the joint; empty for balance.
    """

    still: bool
    amount: float
    joint: str = ""


@dataclass
class _Warning:
    """The worst violation of a kind, the time of the last one [s], and whether it still holds."""

    worst: _Violation
    last_time: float
    holds: bool = True


class Alerts:
    """Checks a moving robot, and keeps the warnings.

    Args:
        pepper: Model of the robot.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._pepper = pepper
        self._polygon = support_polygon(pepper)
        self._carriers = {link: carrier for link, (carrier, _) in carriers_of(pepper).items()}
        self._warnings: dict[str, _Warning] = {}
        self._before: dict[str, _Violation] = {}
        self._contacts: tuple[Contact, ...] = ()

    def strain(self, now: float, q: Array, v: Array, a: Array, scene: Scene | None = None) -> None:
        """Check torques and balance at joint positions, velocities and accelerations.

        Violations by motion count if they occur twice in a row: one tick of the servo is too short.

        Args:
            now: Present time [s].
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,).
            a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
            scene: Scene around the robot, with attached objects; None for none.
        """
        self.pass_time(now)
        loads = loads_of(self._pepper, scene)
        violations = {"torque": self._torque(q, v, a, loads), "balance": self._balance(q, v, a, loads)}
        found = {kind: violation for kind, violation in violations.items() if violation is not None}
        for kind in self._warnings.keys() - found.keys():
            self._warnings[kind].holds = False
        for kind, violation in found.items():
            if violation.still or kind in self._before:
                self._warn(kind, violation, now)
        self._before = found

    def calm(self) -> None:
        """Remove warnings of torques and balance."""
        self._warnings, self._before = {}, {}

    def touch(self, q: Array, scene: Scene) -> None:
        """Find the contacts at joint positions q, shape (n,) [rad or m]."""
        self._contacts = contacts(self._pepper, q, scene)

    def pass_time(self, now: float) -> None:
        """Remove warnings that ended more than `STAYS` ago."""
        self._warnings = {
            kind: warning
            for kind, warning in self._warnings.items()
            if warning.holds or now - warning.last_time < STAYS
        }

    @property
    def pending(self) -> bool:
        """Whether an ended warning is still shown."""
        return any(not warning.holds for warning in self._warnings.values())

    def as_list(self) -> list[dict[str, str]]:
        """Return kind ("contact", "torque" or "balance") and text of each warning, for JSON."""
        warnings = [
            {"kind": kind, "text": _TEXTS[kind](warning.worst)} for kind, warning in self._warnings.items()
        ]
        touching = contact_words(self._pepper, self._contacts)
        return ([{"kind": "contact", "text": touching}] if touching else []) + sorted(
            warnings, key=lambda alert: alert["kind"]
        )

    def touching(self, scene: Scene) -> dict[str, list[str]]:
        """Return the touching bodies of the robot, by their names in poses, and the touching objects."""
        bodies, objects = touching_names(self._contacts, self._carriers, scene)
        return {"bodies": list(bodies), "objects": list(objects)}

    def _warn(self, kind: str, violation: _Violation, now: float) -> None:
        known = self._warnings.get(kind)
        if known is None or violation.still != known.worst.still or violation.amount > known.worst.amount:
            self._warnings[kind] = _Warning(violation, now)
        else:
            known.last_time, known.holds = now, True

    def _torque(self, q: Array, v: Array, a: Array, loads: Loads) -> _Violation | None:
        """Return the violation of torque limits, or None.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,).
            a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
            loads: Loads that the robot carries.
        """
        use = torque_use(self._pepper, inverse_dynamics_with(self._pepper, loads, q, v, a))
        if use.max() <= 1.0:
            return None
        rest = np.zeros_like(q)
        held = torque_use(self._pepper, inverse_dynamics_with(self._pepper, loads, q, rest, rest))
        still = bool(held.max() > 1.0)
        shares = held if still else use
        return _Violation(still, float(shares.max()), self._pepper.joint_names[int(shares.argmax())])

    def _balance(self, q: Array, v: Array, a: Array, loads: Loads) -> _Violation | None:
        """Return the violation of balance, the zero-moment point outside the wheels, or None.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,).
            a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
            loads: Loads that the robot carries.
        """
        if self._polygon is None:
            return None
        rest = np.zeros_like(q)
        states = (np.stack([q, q]), np.stack([v, rest]), np.stack([a, rest]))
        moving, held = balance_margin(self._pepper, self._polygon, *states, loads)
        if min(moving, held) >= 0:
            return None
        return _Violation(bool(held < 0), float(-(held if held < 0 else moving)))


def _torque_words(violation: _Violation) -> str:
    share = f"{np.ceil(10 * violation.amount) * 10:.0f} % of its torque limit"
    if violation.still:
        return f"{sentence(joint_words(violation.joint))} cannot hold this: it would need {share}."
    return f"Too fast for {joint_words(violation.joint)}: it would need {share}."


def _balance_words(violation: _Violation) -> str:
    if violation.still:
        away = length_words(np.ceil(100 * violation.amount) / 100)
        return f"The robot would tip over: its center of mass is {away} outside its wheels."
    if not np.isfinite(violation.amount):
        return "So fast, the robot would leave the floor."
    away = length_words(np.ceil(100 * violation.amount) / 100)
    return f"So fast, the robot would tip over: its zero-moment point is {away} outside its wheels."


_TEXTS: dict[str, Any] = {"torque": _torque_words, "balance": _balance_words}
