"""Balance of a motion on the floor: base wrench, zero-moment point, forces on the wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, BriefRepr, read_only
from pepper_kin.collision.loads import checked_loads, load_wrench
from pepper_kin.dynamics import base_wrench
from pepper_kin.dynamics.load import Loads, carried_words
from pepper_kin.dynamics.support_polygon import (
    checked_polygon,
    distances_inside,
    inward_normals,
    wheel_contacts,
)
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_pose
from pepper_kin.kinematics.base_geometry import BaseGeometry
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_batch, as_finite, as_joint_vectors
from pepper_kin.model.requirements import WHEELS


@dataclass(frozen=True)
class BalanceEvent:
    """The first time at which the zero-moment point is outside the polygon of the wheels.

    Attributes:
        time: Time [s].
        index: Row of the series.
        edge: Names of the two wheels over whose line the robot begins to tip; empty if the floor would have
            to pull.
        margin: Distance outside, below zero [m].
    """

    time: float
    index: int
    edge: tuple[str, str] | tuple[()]
    margin: float

    def __str__(self) -> str:
        if not self.edge:
            return f"at {self.time:.3f} s the floor would have to pull"
        outside = f"{-1000 * self.margin:.1f} mm outside the line {self.edge[0]} - {self.edge[1]}"
        return f"at {self.time:.3f} s the zero-moment point is {outside}"


@dataclass(frozen=True, eq=False)
class BalanceReport(BriefRepr):
    """Balance over a motion; arrays are read-only.

    Attributes:
        time: Times [s], shape (T,).
        wrench: Force [N], then moment about the world's origin [N m], of the floor on the robot, in world
            axes, shape (T, 6).
        point: Zero-moment point in the frame of the base [m], shape (T, 2); NaN if the floor would have to
            pull.
        distances: Distance of the point from the line through wheels k and k + 1 [m], positive inside, -inf
            if the floor would have to pull, shape (T, k).
        friction: Minimum coefficient of friction that keeps the wheels from sliding: horizontal over vertical
            force, inf if the floor would have to pull, shape (T,).
        wheel_forces: Vertical force on each of three wheels [N], shape (T, 3), below zero if the wheel would
            have to be held down; None for more wheels, where it is not determined.
        event: First sample outside; None if there is none.
        loads: Carried loads, which are part of the wrench.
    """

    time: Array
    wrench: Array
    point: Array
    distances: Array
    friction: Array
    wheel_forces: Array | None
    event: BalanceEvent | None
    loads: Loads = ()

    @property
    def margin(self) -> Array:
        """Minimum of the distances [m], shape (T,): positive inside, below zero outside."""
        return np.asarray(self.distances.min(axis=1))

    @property
    def balanced(self) -> bool:
        """Whether the point stays inside."""
        return self.event is None

    def report(self) -> str:
        """Return the result in words."""
        worst = int(np.argmin(self.margin))
        carrying, verdict = carried_words(self.loads), self.event or "kept throughout"
        lines = [
            f"Balance over {self.time[-1] - self.time[0]:.3f} s{carrying}: {verdict}",
            f"  least margin {1000 * self.margin[worst]:.1f} mm at {self.time[worst]:.3f} s; "
            f"least friction coefficient needed {self.friction.max():.3f}",
        ]
        if self.wheel_forces is not None:
            low, high = self.wheel_forces.min(), self.wheel_forces.max()
            lines.append(f"  force on a wheel between {low:.1f} N and {high:.1f} N")
        return "\n".join(lines)


class BalanceMonitor:
    """Monitor of a motion's balance.

    Args:
        pepper: The robot.
        geometry: The robot's wheels; from its description if omitted.  Their contacts must be the corners of
            a convex polygon, in any order.
        base_frame: Name of the frame that the wheels move with.

    Raises:
        InvalidValueError: for contacts that are not a convex polygon, or without them for a robot whose
            wheels are not known.
        UnknownNameError: for a frame that the robot lacks.
    """

    def __init__(
        self,
        pepper: PepperModel,
        geometry: BaseGeometry | None = None,
        base_frame: str = "base_footprint",
    ) -> None:
        pepper.frame_id(base_frame)
        self.pepper, self.base_frame = pepper, base_frame
        if geometry is None:
            names = tuple(wheel.removesuffix("_link") for wheel in WHEELS)
            contacts = wheel_contacts(pepper, "geometry")
        else:
            names, contacts = geometry.wheel_names, geometry.contacts
        around = contacts - contacts.mean(axis=0)
        order = np.argsort(np.arctan2(around[:, 1], around[:, 0]))
        self.wheel_names = tuple(names[k] for k in order)
        self.contacts = read_only(checked_polygon(contacts[order]))
        self._inward = inward_normals(self.contacts)

    def edge(self, number: int) -> tuple[str, str]:
        """Return the wheels at the ends of an edge, counter-clockwise."""
        return self.wheel_names[number], self.wheel_names[(number + 1) % len(self.wheel_names)]

    def assess_run(self, run: Any, external: ArrayLike | None = None) -> BalanceReport:
        """Return the balance over a run of the twin, with its loads and recorded external forces.

        Accelerations are differences of velocities: central, and one-sided at the ends.  Accordingly, the
        external forces of a state are the mean over the steps before and after it.

        Args:
            run: The run, of two or more states; or any object with `time`, `position` and `velocity`, without
                external forces if it has no `external_wrench`, and without loads if it has no `loads`.
            external: External force [N] and moment [N m] on the robot, shape (6,) or (T, 6), in place of the
                recorded ones; see `assess`.

        Raises:
            InvalidValueError: for a run of one state, or a run with joint loads of unknown force without
                `external`.
        """
        count = len(run.time)
        if count < 2:
            raise InvalidValueError("run", f"{count} states", "two states or more")
        a = np.gradient(run.velocity, run.time, axis=0)
        if external is None:
            steps = np.asarray(getattr(run, "external_wrench", np.zeros((count, 6))))[1:]
            unknown = int(np.isnan(steps).any(axis=1).sum())
            if unknown:
                got = f"loads on joints in {unknown} steps, of which no outside force is known"
                raise InvalidValueError("run", got, "the force and moment of all of them as `external`")
            external = (np.concatenate([steps[:1], steps]) + np.concatenate([steps, steps[-1:]])) / 2
        held = getattr(run, "loads", ())
        return self.assess(run.time, run.position, run.velocity, a, external, loads=held)

    def assess(
        self,
        time: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        external: ArrayLike | None = None,
        *,
        loads: Loads = (),
    ) -> BalanceReport:
        """Return the balance over a motion.

        Args:
            time: Times [s], shape (T,).
            q: Joint positions [rad or m], shape (T, n).
            v: Joint velocities [rad/s or m/s], shape (T, n).
            a: Joint accelerations [rad/s^2 or m/s^2], shape (T, n).
            external: External force [N] and moment about the world's origin [N m] on the robot, in world
                axes, shape (6,) or (T, 6); none if omitted.
            loads: Carried loads: `pepper_kin.collision.loads_of(pepper, scene, payload)`.

        Raises:
            InvalidValueError: for wrong shapes, NaN or infinity, or invalid loads.
            UnknownNameError: for a load at a frame that the robot lacks.
        """
        times = as_finite(time, "time", (None,))
        states = []
        for quantity, value in (("q", q), ("v", v), ("a", a)):
            rows = as_joint_vectors(self.pepper, value, quantity)
            if rows.shape != (len(times), self.pepper.n):
                raise InvalidValueError(
                    quantity, f"shape {rows.shape}", f"shape {(len(times), self.pepper.n)}"
                )
            states.append(rows)
        held = checked_loads(self.pepper, loads)
        wrench = base_wrench(self.pepper, *states)
        if held:
            wrench = wrench + load_wrench(self.pepper, held, *states)
        if external is not None:
            checked = as_batch(external, "external", (6,))
            if checked.shape not in ((6,), (len(times), 6)):
                raise InvalidValueError(
                    "external", f"shape {checked.shape}", f"shape (6,) or {(len(times), 6)}"
                )
            wrench = wrench - checked
        point, distances, forces = self._support(wrench, states[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            friction = np.hypot(wrench[:, 0], wrench[:, 1]) / wrench[:, 2]
        friction = np.where(wrench[:, 2] > 0, friction, np.inf)
        times, wrench, point = read_only(times), read_only(wrench), read_only(point)
        distances, friction = read_only(distances), read_only(friction)
        forces, event = None if forces is None else read_only(forces), self._event(times, distances)
        return BalanceReport(times, wrench, point, distances, friction, forces, event, held)

    def _support(self, wrench: Array, q: Array) -> tuple[Array, Array, Array | None]:
        """Return zero-moment point, its distances inside the edges, and the forces on three wheels.

        Args:
            wrench: Wrench of the floor on the robot, force [N], then moment [N m], shape (T, 6).
            q: Joint positions [rad or m], shape (T, n).

        Returns:
            Point [m], shape (T, 2), distances [m], shape (T, k), and forces [N], shape (T, 3), or None.
        """
        poses = frame_pose(self.pepper, q, self.base_frame)
        vertical = wrench[:, 2]
        pressed = vertical > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            world = np.column_stack([-wrench[:, 4], wrench[:, 3]]) / vertical[:, None]
        point = np.einsum("tji,tj->ti", poses[:, :2, :2], world - poses[:, :2, 3])
        point[~pressed] = np.nan
        inside = distances_inside(self.contacts, self._inward, point)
        distances = np.where(pressed[:, None], inside, -np.inf)
        if len(self.contacts) != 3:
            return point, distances, None
        # Force and moments about the base's axes: sum f = f_z, sum f c = f_z point (kept finite at f_z = 0).
        local = np.einsum("tji,tj->ti", poses[:, :2, :2], np.column_stack([-wrench[:, 4], wrench[:, 3]]))
        local -= vertical[:, None] * np.einsum("tji,tj->ti", poses[:, :2, :2], poses[:, :2, 3])
        balance = np.vstack([np.ones(3), self.contacts.T])
        forces = np.linalg.solve(balance, np.column_stack([vertical, local]).T).T
        return point, distances, forces

    def _event(self, time: Array, distances: Array) -> BalanceEvent | None:
        """Return the first time at which the point is outside, None if there is none.

        Args:
            time: Times [s], shape (T,).
            distances: Distances of the point inside the edges [m], shape (T, k).
        """
        margin = distances.min(axis=1)
        outside = np.flatnonzero(margin < 0)
        if not len(outside):
            return None
        index = int(outside[0])
        edge = self.edge(int(np.argmin(distances[index]))) if np.isfinite(margin[index]) else ()
        return BalanceEvent(float(time[index]), index, edge, float(margin[index]))
