"""The tables of a path whose timing is sought: the path on a grid, and what limits its speed there."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.timing.grid import coefficient_states, fill_grid, frame_states, interval_count
from pepper_kin.core.timing.parameterization import motion_polynomials
from pepper_kin.core.timing.tables import PathEffects, PathGrid, PathLimits, PathRows, ProfileSpace
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import LimitedQuantities, Limits
from pepper_kin.trajectory.payload import AtFrames
from pepper_kin.trajectory.trajectory import Trajectory, known_trajectory

Array = NDArray[np.float64]

_GREATEST = 1e12  # squared speed where no velocity limit acts, in path lengths squared a second squared

_memory = threading.local()


class TimingProblem:
    """A path on its grid with the limits along it.

    The tables are views of memory that each thread keeps, for new pages would take long: a problem is valid
    until the next one is made in the same thread.

    Attributes:
        grid: The path.
        effects: Torques, edge moments and frame speeds at its nodes.
        limits: Limits of the joints.
        rows: Room for the constraints.
        space: Work space of the search.
        quantities: What limits look at, for other states.
        payload: Masses held, by frame [kg].
    """

    def __init__(
        self, pepper: PepperModel, breaks: Array, coefficients: Array, intervals: int, limits: Limits
    ) -> None:
        self._names, self._units = pepper.joint_names, pepper.joint_units
        self.quantities, self.payload = LimitedQuantities(pepper, limits), limits.payload
        n, torques, edges = pepper.n, self.quantities.torque_limit.size, self.quantities.edges
        size, r = interval_count(breaks, intervals), n + torques + edges
        nodes = size + len(breaks) - 1
        workspace = _Workspace(
            nodes * (3 * n + 3 * r) + size * (4 * n + 3 * (r - n) + 2 * r + 10)
            + max(9 * nodes * n, size * 3 * (2 * r + 1)) + 10
        )  # fmt: skip
        take = workspace.take
        self.grid = PathGrid(
            take(size), np.empty(size, np.int64), take(size + 1), take(3, nodes, n), take(size, 4, n)
        )
        fill_grid(breaks, coefficients, intervals, self.grid)
        self.rows = PathRows(
            take(nodes, r), take(nodes, r), take(nodes, r), take(3, size, r - n), take(size, r), take(size,
            r), take(size + 1),
        )  # fmt: skip
        span, reach, x, best = take(size, 3), take(size + 1, 2), take(size + 1), take(size + 1)
        begin = workspace.used
        self.effects = self._effects(take(3, 3 * nodes, n) if torques or edges else None)
        workspace.used = begin  # these states are not needed any more
        lines = take(size, 3, 2 * r + 1)
        self.space = ProfileSpace(lines, span, reach, np.ones(size, np.bool_), x, best)
        self.limits = PathLimits(
            np.array(limits.velocity, dtype=float), np.array(limits.acceleration, dtype=float),
            self.quantities.torque_limit, _GREATEST * float(breaks[-1] - breaks[0]) ** 2,
        )  # fmt: skip

    def _effects(self, states: Array | None) -> PathEffects:
        quantities, nodes, n = self.quantities, self.grid.at.shape[1], self.grid.at.shape[2]
        torque = moments = np.empty((3, nodes, 0))
        if states is not None:
            coefficient_states(self.grid.at, states)
            torque = quantities.torque(*states).reshape(3, nodes, quantities.torque_limit.size)
            moments = quantities.moments(*states).reshape(3, nodes, quantities.edges)
        if not quantities.frames:
            return PathEffects(torque, moments, np.empty((nodes, 0)), np.empty((self.grid.step.size, 0)))
        posture = np.empty((2, nodes + self.grid.step.size, n))
        frame_states(self.grid, posture)
        speed = quantities.speed(*posture)
        return PathEffects(torque, moments, speed[:nodes], speed[nodes:])

    def share(self, point: int) -> float:
        """Return how far along the path a grid point is, from 0 to 1."""
        s = self.grid.s
        return float((s[point] - s[0]) / (s[-1] - s[0]))

    def trajectory(self, x: Array, stretch: float = 1.0) -> Trajectory:
        """Return the motion with given squared speeds at the grid points, made slower."""
        size, _, n = self.grid.taylor.shape
        breaks, coefficients = np.empty(size + 1), np.empty((size, 7, n))
        motion_polynomials(self.grid, x, stretch, breaks, coefficients)
        return known_trajectory(self._names, self._units, breaks, coefficients)

    def infeasible(self, failed_at: int | None) -> InfeasibleError:
        """Say why there is no trajectory: with velocity and acceleration alone there always is one.

        Args:
            failed_at: Grid point at which the search ended.
        """
        torque, limit = self.effects.torque[0], self.limits.torque
        use = np.abs(torque) / limit
        if use.size and use.max() >= 1.0:
            node, joint = np.unravel_index(int(np.argmax(use)), use.shape)
            reason = (
                f"{self._names[joint]} needs {torque[node, joint]:.4g} N m to hold still against gravity"
                f"{_load(self.payload)} {self._node_share(node):.0%} along the path, "
                f"and its limit is {limit[joint]:.4g} N m"
            )
            advice = "choose a path with less load on that joint" + (
                ", or carry less" if self.payload else ""
            )
            return InfeasibleError("trajectory", reason, advice)
        moments = self.effects.moments[0]
        if moments.size and moments.min() < 0:
            node = np.argmin(moments.min(axis=1))
            reason = f"{self._node_share(node):.0%} along the path the robot would tip over even at rest"
            nearer = (
                "choose a path whose center of mass is nearer to the middle of the wheels, or less balance"
            )
            return InfeasibleError("trajectory", reason, nearer)
        where = "" if failed_at is None else f" from {self.share(failed_at):.0%} of it on"
        return InfeasibleError(
            "trajectory",
            f"no speed along the path obeys all limits{where}",
            "raise the scales, use more grid points, or smooth the path",
        )

    def _node_share(self, node: np.intp) -> float:
        """Return how far along the path a node is."""
        interval = int(np.searchsorted(self.grid.first, node, side="right")) - 1
        return self.share(interval + int(node - self.grid.first[interval]))


class _Workspace:
    """Memory that a thread keeps."""

    def __init__(self, size: int) -> None:
        kept = getattr(_memory, "room", None)
        if kept is None or kept.size < size:
            kept = _memory.workspace = np.empty(2 * size)
        self._memory, self.used = kept, 0

    def take(self, *shape: int) -> Array:
        """Return an array of no content."""
        begin = self.used
        for_all = 1
        for length in shape:
            for_all *= length
        self.used = begin + for_all
        return np.asarray(self._memory[begin : self.used].reshape(shape))


def _load(payload: AtFrames) -> str:
    """Name what is carried."""
    return "".join(f" with {mass:.4g} kg at {frame}" for frame, mass in payload)
