"""The least distance along a sequence of configurations, without measuring at every one of them."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.contact import ClosestPair
from pepper_kin.collision.motion_tree import Hull, motion_bounds_of
from pepper_kin.collision.movers import Movers, checked_times, movers_of
from pepper_kin.collision.scene import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors

Indices = NDArray[np.intp]

_FIRST = 64  # configurations in one of the stretches that the search starts from
_STILL = 1e-9  # [m] a pair that moves no more than this has one distance
_ROUNDING = 2e-6  # [m] what two distances by coal may be off, one against the other


@dataclass(frozen=True, eq=False)
class LeastClearance:
    """Where along a sequence of configurations bodies come nearest to one another.

    Attributes:
        distance: The least distance [m], below zero where shapes overlap; inf where no pair is checked.
        index: The configuration at which it was found.
        pair: The nearest pair there; None where no pair is checked.
        forbidden: The first configuration that a table of joint ranges forbids (see `in_collision`), which
            has no distance; None where all are allowed.
        measured: Number of configurations at which distances were measured; all others are proven to be no
            nearer.
    """

    distance: float
    index: int
    pair: ClosestPair | None
    forbidden: int | None
    measured: int


def least_clearance(
    pepper: PepperModel, q: ArrayLike, scene: Scene | None = None, times: ArrayLike | None = None
) -> LeastClearance:
    """Return the least of `clearance(pepper, q, scene)` and its place, without computing all the others.

    Between configurations q and q', the bodies a and b of a pair come nearer by at most

        sum over joints j that move one against the other of |q'_j - q_j| l_j(q),

    where l_j is the greatest distance of a point of the body that j moves from the axis of j (1 for a joint
    that slides).  Proof: go from q to q' by turning one joint after the other, from the base on.  When j
    turns, the joints behind it still stand as in q, and they alone decide how far the body is from the axis
    of j; so none of its points moves by more than |q'_j - q_j| l_j(q).  A body lies in the ball around its
    shape: with that ball's center c and radius r, and the column (v, w) of the Jacobian of j about the
    world's origin, l_j <= |v + w x c| + r |w|.

    So a distance that was measured at q bounds from below what it can be in a stretch of configurations
    around q.  Stretches are searched in the order of these bounds and halved, each with the pairs that are
    still open in it, until no bound is below the least distance found.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (T, n).  Neighbors should be near each other: nothing is wrong
            if they are not, but then little can be left out.
        scene: The world around it, with what the robot holds; None for the robot against itself only.
        times: When the robot is there [s], one number or shape (T,): obstacles that move are where they are
            then, at a distance less what their uncertainty has grown by.  None: all stand as at time 0.

    Returns:
        What was found.  The distance is the least of all to the accuracy of coal's (2e-6 m); where several
        are equal to that accuracy, the configuration is one of them.

    Raises:
        InvalidValueError: for a q of wrong shape, without configurations, or with NaN or infinity; or a time
            below 0.
    """
    path = as_joint_vectors(pepper, q, "q")
    if path.ndim != 2 or not len(path):
        raise InvalidValueError("q", f"shape {path.shape}", f"one or more of them, shape (T, {pepper.n})")
    movers = None if times is None else movers_of(pepper, scene)
    if movers is not None and scene is not None and times is not None:
        still, when = least_clearance(pepper, path, scene.standing), checked_times(times, len(path))
        found = least_clearance_of_movers(movers, movers.states(path, when), when, still.distance)
        nearest = found if found.distance < still.distance else still
        return replace(nearest, forbidden=still.forbidden, measured=still.measured + found.measured)
    checker = checker_for(pepper, scene)
    violated = np.zeros(len(path), dtype=bool)
    for table in checker.dependent_ranges:
        violated |= table.violated(path)
    search = _Search(checker, path)
    index = search.run()
    pair = checker.closest_pair(path[index])
    return LeastClearance(
        distance=float("inf") if pair is None else pair.distance,
        index=index,
        pair=pair,
        forbidden=int(np.argmax(violated)) if violated.any() else None,
        measured=search.measured,
    )


def least_clearance_of_movers(
    movers: Movers, states: Array, times: Array, known: float = np.inf
) -> LeastClearance:
    """Return the least distance of the robot to obstacles that move, less what uncertainties have grown by.

    Args:
        movers: The obstacles.
        states: Configurations of `movers.robot`, shape (T, n + 6 k).
        times: Their times [s], shape (T,).
        known: A distance above which none is looked for [m].
    """
    checker = checker_for(movers.robot, movers.scene)
    search = _Search(checker, states)
    uncertainty = {item.name: item.uncertainty for item in movers.items}
    owners = [uncertainty.get(body.owner, 0.0) for body in checker._shapes.bodies]
    search.times, search.growth = times, np.array(owners)[np.array(checker._shapes.pairs)].max(axis=0)
    search.best = known
    index = search.run()
    return LeastClearance(search.best, index, checker.closest_pair(states[index]), None, search.measured)


def approach_speed(pepper: PepperModel, rates: ArrayLike, scene: Scene | None = None) -> float:
    """Return a bound on how fast any pair of bodies that is checked comes nearer to one another [m/s].

    The bodies of a pair come nearer by at most sum_j l_j |dq_j/dt|, over the joints j that move one against
    the other, with l_j the motion bounds of `pepper_kin.collision.motion_tree`, wherever the joints stand.

    Args:
        pepper: The robot.
        rates: Bounds on |dq/dt| [rad/s or m/s], shape (m, n), of which the worst counts.
        scene: The world around it, with what moves in it; None for the robot against itself only.

    Returns:
        The bound; 0 where no pair is checked.
    """
    movers = movers_of(pepper, scene)
    if movers is not None and scene is not None:
        own = np.atleast_2d(np.asarray(rates, dtype=float))
        joined = movers.joined(own, np.tile(np.abs(movers.rate), (len(own), 1)))
        to_movers = approach_speed(movers.robot, joined, movers.scene) + movers.uncertainty
        return max(approach_speed(pepper, own, scene.standing), to_movers)
    checker = checker_for(pepper, scene)
    if not checker.pair_count:
        return 0.0
    hulls = []
    for body, center, radius in zip(
        checker._shapes.bodies, checker._shapes.bounding_centers, _radii(checker), strict=True
    ):
        place = body.geometry_object.placement.act(np.asarray(center))
        hulls.append(Hull(body.joint, place[None], float(radius)))
    bounds, (first, second) = motion_bounds_of(pepper, hulls), _moves_against(checker)
    pairs = checker._shapes.pairs
    against = np.where(first, bounds[pairs[0]], 0.0) + np.where(second, bounds[pairs[1]], 0.0)
    full = np.asarray(rates, dtype=float) @ np.abs(np.asarray(pepper.full_map)).T
    return float((np.unique(against, axis=0) @ full.T).max())


@dataclass(order=True)
class _Stretch:
    """Configurations from `start` up to `end`, and the pairs that may be nearest in them.

    `bound` is the least of `bounds`, which bound the distances of the pairs from below.
    """

    bound: float
    start: int
    end: int
    pairs: Indices = field(compare=False)
    bounds: Array = field(compare=False)


class _Search:
    """Branch and bound over stretches of a path.

    Args:
        checker: The checker.
        path: Joint positions [rad or m], shape (T, n).

    Attributes:
        times: Of the configurations [s], shape (T,).
        growth: What distances of pairs lose with time [m/s], shape (p,).
    """

    def __init__(self, checker: CollisionChecker, path: Array) -> None:
        self.checker, self.path = checker, checker.pepper.to_full(path)
        self.model = checker.pepper.inner_model
        self.moves = _moves_against(checker)
        self.radii = _radii(checker)
        to_plane, normals = checker._shapes.planes
        self.normals: Array | None = None  # of the half-spaces, one for each pair
        if to_plane.size:
            self.normals, self.flat = np.zeros((checker.pair_count, 3)), np.zeros(checker.pair_count, bool)
            self.normals[to_plane], self.flat[to_plane] = normals, True
        self.best, self.index, self.measured = float("inf"), 0, 0
        self.times, self.growth = np.zeros(len(path)), np.zeros(checker.pair_count)

    def run(self) -> int:
        """Return the configuration at which the bodies come nearest."""
        pairs = np.arange(self.checker.pair_count)
        if not pairs.size:
            return self.index
        unknown = np.full(pairs.size, -np.inf)
        count = len(self.path)
        waiting = [
            _Stretch(-np.inf, i, min(i + _FIRST, count), pairs, unknown) for i in range(0, count, _FIRST)
        ]
        while waiting:
            stretch = heapq.heappop(waiting)
            if stretch.bound >= self.best + _ROUNDING:
                break
            for part in self._halves(stretch):
                heapq.heappush(waiting, part)
        return self.index

    def _halves(self, stretch: _Stretch) -> list[_Stretch]:
        """Measure in the middle of a stretch, and return what is left open of its two halves."""
        middle = (stretch.start + stretch.end) // 2
        pairs = stretch.pairs[stretch.bounds < self.best + _ROUNDING]
        centers, used, places = self._place(self.path[middle], pairs)
        halves = [(i, j) for i, j in ((stretch.start, middle), (middle + 1, stretch.end)) if i < j]
        approach = np.zeros((len(halves), pairs.size))
        if halves:
            motion_bounds = self._motion_bounds(centers, used)
            first, second = self.moves[0][pairs], self.moves[1][pairs]
            lever = motion_bounds[places[0]] * first + motion_bounds[places[1]] * second
            steps = [np.abs(self.path[i:j] - self.path[middle]).max(axis=0) for i, j in halves]
            approach = np.array(steps) @ lever.T
            later = [max(self.times[i:j].max() - self.times[middle], 0.0) for i, j in halves]
            approach += np.multiply.outer(later, self.growth[pairs])
        gaps = self._gaps(pairs, centers, places) - self.times[middle] * self.growth[pairs]
        distance = self._measure(middle, pairs, gaps, approach)
        parts = []
        for (start, end), nearer in zip(halves, approach, strict=True):
            bounds = distance - nearer
            left = (bounds < self.best + _ROUNDING) & (nearer > _STILL)
            if left.any():
                parts.append(_Stretch(float(bounds[left].min()), start, end, pairs[left], bounds[left]))
        return parts

    def _measure(self, index: int, pairs: Indices, gaps: Array, approach: Array) -> Array:
        """Return the distances of pairs at one configuration [m], or lower bounds where these are enough.

        Args:
            index: Of the configuration.
            pairs: Places of the pairs, shape (p,).
            gaps: Lower bounds of their distances [m], shape (p,).
            approach: How much nearer they may come in each half of the stretch [m], shape (halves, p).

        Returns:
            Shape (p,).
        """
        checker, queries = self.checker, self.checker._data[1]
        self.measured += 1
        found = gaps.copy()
        most = approach.max(axis=0) if len(approach) else np.zeros(pairs.size)
        for k in np.argsort(gaps).tolist():
            if gaps[k] - most[k] >= self.best + _ROUNDING:
                continue
            pair = int(pairs[k])
            result = queries.distance(pair)
            found[k] = result.min_distance - checker._shapes.paddings[pair]
            found[k] -= self.times[index] * self.growth[pair]
            if found[k] < self.best:
                self.best, self.index = float(found[k]), index
        return found

    def _place(self, q: Array, pairs: Indices) -> tuple[Array, Indices, tuple[Indices, Indices]]:
        """Place all shapes; return centers of balls, the bodies they are of, and where a pair's two are.

        Args:
            q: A configuration of Pinocchio's model [rad or m], shape (nq,).
            pairs: Places of the pairs, shape (p,).

        Returns:
            Centers in the world [m], shape (b, 3); bodies, shape (b,); rows of a pair's two, shape (p,) each.
        """
        import pinocchio

        checker, (data, queries) = self.checker, self.checker._data
        pinocchio.computeJointJacobians(self.model, data, q)
        queries.place(data)
        first, second = checker._shapes.pairs[0][pairs], checker._shapes.pairs[1][pairs]
        place = np.zeros(len(checker._shapes.bodies), dtype=int)
        place[first] = place[second] = 1
        used = np.flatnonzero(place)
        place[used] = np.arange(used.size)
        listed = used.tolist()
        balls = zip(listed, queries.poses(listed), strict=True)
        own = checker._shapes.bounding_centers
        centers = np.array([pose.act(own[i]) for i, pose in balls])
        return centers, used, (place[first], place[second])

    def _gaps(self, pairs: Indices, centers: Array, places: tuple[Indices, Indices]) -> Array:
        """Return the distances of the pairs' balls [m], shape (p,), a lower bound of those of the pairs.

        Args:
            pairs: Places of the pairs, shape (p,).
            centers: Centers of the balls in the world [m], shape (b, 3).
            places: Rows of each pair's two balls, shape (p,) each.
        """
        checker = self.checker
        apart = centers[places[0]] - centers[places[1]]
        gaps = np.sqrt(np.einsum("ij,ij->i", apart, apart))
        if self.normals is not None:
            heights = np.einsum("ij,ij->i", apart, self.normals[pairs])
            gaps = np.where(self.flat[pairs], heights, gaps)
        return np.asarray(gaps - checker._shapes.bounding_reach[pairs] - checker._shapes.paddings[pairs])

    def _motion_bounds(self, centers: Array, used: Indices) -> Array:
        """Return how far each joint moves each body at most, shape (bodies, joints) [m/rad or 1]."""
        jacobian = np.reshape(self.checker._data[0].J, (6, self.model.nv))
        linear, angular = jacobian[:3], jacobian[3:]
        x, y, z = centers.T[:, :, None]
        a, b, c = angular[:, None]
        speed = [linear[0] + b * z - c * y, linear[1] + c * x - a * z, linear[2] + a * y - b * x]
        turns = np.sqrt((angular**2).sum(axis=0))
        return np.asarray(np.sqrt(sum(s * s for s in speed)) + self.radii[used, None] * turns)


def _radii(checker: CollisionChecker) -> Array:
    """Return the radii of the bodies' balls [m], zero for half-spaces, which never move."""
    radii = np.zeros(len(checker._shapes.bodies))
    for k, body in enumerate(checker._shapes.bodies):
        if not body.is_half_space:
            radii[k] = float(body.geometry_object.geometry.aabb_radius)
    return radii


def _moves_against(checker: CollisionChecker) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which joints move the first body of each pair, and not the second, and the other way round."""
    model = checker.pepper.inner_model
    carried = np.zeros((model.njoints, model.nv), dtype=bool)
    for joint in range(1, model.njoints):
        for above in model.supports[joint].tolist()[1:]:
            carried[joint, model.joints[above].idx_v] = True
    joints = np.array([body.joint for body in checker._shapes.bodies], dtype=int)
    first, second = carried[joints[checker._shapes.pairs[0]]], carried[joints[checker._shapes.pairs[1]]]
    return first & ~second, second & ~first
