"""Minimum distance along a sequence of configurations, without measuring at every one of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision.bodies import CollisionBody
from pepper_kin.collision.checked_shapes import CheckedShapes, PairsTo
from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.contact import Clearance, ClosestPair
from pepper_kin.collision.motion_tree import Hull, motion_bounds_of
from pepper_kin.collision.movers import Movers, checked_times, movers_of
from pepper_kin.collision.scene import Scene
from pepper_kin.core.certificates.clearance import (
    DEEPEST,
    DONE,
    FIRST,
    GROW,
    MIDDLE,
    PLACEMENT,
    PLACES,
    ROUNDING,
    SOLID,
    TO_MEASURE,
    Bodies,
    ClearanceSearch,
    Poses,
    search_least,
)
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.model.moving_tree import moving_tree

Indices = NDArray[np.intp]

_FAR = 1e9
"""Distance that is added to pairs that do not count [m]."""
_GROWING = ("kept", "kept_bounds")  # arrays of the search that are enlarged if too small


@dataclass(frozen=True, eq=False)
class LeastClearance(BriefRepr):
    """Minimum distance of bodies along a sequence of configurations.

    Attributes:
        distance: The minimum distance [m], negative where shapes overlap; inf if no pair is checked.
        index: Index of the configuration at which it was found.
        pair: The nearest pair there; None if no pair is checked.
        forbidden: Index of the first configuration that a table of joint ranges forbids (see `in_collision`),
            which has no distance; None if all are allowed.
        measured: Number of configurations at which distances were measured; all others are proven to be no
            nearer.
    """

    distance: float
    index: int
    pair: ClosestPair | None
    forbidden: int | None
    measured: int


def least_clearance(
    pepper: PepperModel,
    q: ArrayLike,
    scene: Scene | None = None,
    times: ArrayLike | None = None,
    *,
    to: PairsTo = "all",
) -> LeastClearance:
    """Return the minimum of `clearance(pepper, q, scene, to=to)`, and where, without computing all values.

    Between configurations q and q', the bodies a and b of a pair come nearer by at most

        sum over joints j that move one against the other of |q'_j - q_j| l_j(q),

    where l_j is the maximum distance of a point of the body that j moves from the axis of j (1 for a
    prismatic joint).  Proof: go from q to q' by rotating one joint after the other, starting at the base.
    When j rotates, the joints behind it are still at q, and they alone determine the distance of the body
    from the axis of j; so none of its points moves by more than |q'_j - q_j| l_j(q).  A body lies in the
    sphere around its shape: with that sphere's center c and radius r, and the column (v, w) of the Jacobian
    of j about the world's origin, l_j <= |v + w x c| + r |w|.

    So a distance at q is a lower bound, after subtraction, for an interval of configurations around q.
    Intervals are halved, each with the pairs that are still open in it, until no bound is below the minimum
    distance found.  For most pairs a lower bound of the distance at q suffices
    (`pepper_kin.core.certificates.clearance`); coal measures the pairs that may be the nearest of all.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (T, n).  Successive ones should be near each other: the result is
            correct if they are not, but then more configurations have to be measured.
        scene: The world around it, with attached objects; None for the robot against itself only.
        times: Times of the configurations [s], one number or shape (T,): moving obstacles are where they are
            then, at a distance less the growth of their uncertainty.  None: all stand as at time 0.
        to: Which pairs count, as in `clearance`; tables of joint ranges count for all but "obstacles".

    Returns:
        The minimum distance, to the accuracy of coal's distances (2e-6 m), and its configuration; if several
        are equal to that accuracy, one of them.

    Raises:
        InvalidValueError: for a q of wrong shape, without configurations, or with NaN or infinity; a negative
            time; or another word for `to`.
    """
    path = as_joint_vectors(pepper, q, "q")
    if path.ndim != 2 or not len(path):
        raise InvalidValueError("q", f"shape {path.shape}", f"one or more of them, shape (T, {pepper.n})")
    groups = () if times is None or to == "self" else movers_of(pepper, scene)
    if groups and scene is not None and times is not None:
        nearest, when = least_clearance(pepper, path, scene.standing, to=to), checked_times(times, len(path))
        forbidden, measured = nearest.forbidden, nearest.measured
        for movers in groups:
            found = least_clearance_of_movers(movers, movers.states(path, when), when, nearest.distance)
            nearest, measured = min(nearest, found, key=attrgetter("distance")), measured + found.measured
        return replace(nearest, forbidden=forbidden, measured=measured)
    checker = checker_for(pepper, scene)
    violated = np.zeros(len(path), dtype=bool)
    for table in checker.dependent_ranges if to != "obstacles" else ():
        violated |= table.violated(path)
    search = _LeastClearanceSearch(checker, path, to=to)
    search.run()
    pair = checker.closest_pair(path[search.index], to)
    return LeastClearance(
        distance=float("inf") if pair is None else pair.distance,
        index=search.index,
        pair=pair,
        forbidden=int(np.argmax(violated)) if violated.any() else None,
        measured=search.measured,
    )


def clearance_along(
    pepper: PepperModel, q: ArrayLike, scene: Scene | None = None, times: ArrayLike | None = None
) -> Clearance:
    """Return the minimum distances to itself and to obstacles along configurations; see `least_clearance`.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (T, n).
        scene: The world around it, with attached objects; None for the robot against itself only.
        times: Times of the configurations [s], one number or shape (T,), as in `least_clearance`.

    Returns:
        Both distances; the one to itself is at most 0 if a table of joint ranges forbids a configuration.

    Raises:
        InvalidValueError: for an invalid q or time, as in `least_clearance`.
    """
    own = least_clearance(pepper, q, scene, to="self")
    around = least_clearance(pepper, q, scene, times, to="obstacles")
    itself = own.distance if own.forbidden is None else min(own.distance, 0.0)
    return Clearance(float(itself), float(around.distance))


def least_clearance_of_movers(
    movers: Movers, states: Array, times: Array, known: float = np.inf
) -> LeastClearance:
    """Return the minimum distance of the robot to moving obstacles, less the growth of their uncertainties.

    Args:
        movers: The obstacles.
        states: Configurations of `movers.robot`, shape (T, n + 6 k).
        times: Times of the configurations [s], shape (T,).
        known: Distance above which none is searched for [m].

    Returns:
        The minimum distance; if nothing is nearer than `known`, that distance without a pair.
    """
    checker = checker_for(movers.robot, movers.scene)
    uncertainty = {item.name: item.uncertainty for item in movers.items}
    owners = [uncertainty.get(body.owner, 0.0) for body in checker._shapes.bodies]
    growth = np.array(owners)[np.array(checker._shapes.pairs)].max(axis=0)
    search = _LeastClearanceSearch(checker, states, times, growth, known)
    search.run()
    nearest = checker.closest_pair(states[search.index]) if search.best < known else None
    return LeastClearance(search.best, search.index, nearest, None, search.measured)


def approach_speed(pepper: PepperModel, rates: ArrayLike, scene: Scene | None = None) -> float:
    """Return a bound on the speed at which any checked pair of bodies comes nearer to one another [m/s].

    The bodies of a pair come nearer at most at sum_j l_j |dq_j/dt|, over the joints j that move one against
    the other, with l_j the motion bounds of `pepper_kin.collision.motion_tree`, at any joint positions.

    Args:
        pepper: The robot.
        rates: Bounds on |dq/dt| [rad/s or m/s], shape (m, n); the largest result counts.
        scene: The world around it, with moving obstacles; None for the robot against itself only.

    Returns:
        The bound; 0 if no pair is checked.
    """
    groups = movers_of(pepper, scene)
    if groups and scene is not None:
        own = np.atleast_2d(np.asarray(rates, dtype=float))
        fastest = approach_speed(pepper, own, scene.standing)
        for movers in groups:
            alone = movers.joined(own, np.zeros((len(own), movers.columns.size - pepper.n)))
            to_movers = approach_speed(movers.robot, alone, movers.scene) + movers.speed + movers.uncertainty
            fastest = max(fastest, to_movers)
        return fastest
    checker = checker_for(pepper, scene)
    if not checker.pair_count:
        return 0.0
    full = np.asarray(rates, dtype=float) @ np.abs(np.asarray(pepper.full_map)).T
    bounds, moving = _known(checker.pepper, checker._shapes).motion_bounds, full.any(axis=0)
    if not moving.all():  # columns of obstacles do not move here, and the bounds of many pairs are equal
        bounds, full = np.unique(bounds[:, moving], axis=0), full[:, moving]
    return float((bounds @ full.T).max(initial=0.0))


class _LeastClearanceSearch:
    """Search for the minimum distance along a path.

    Args:
        checker: The checker.
        path: Joint positions [rad or m], shape (T, n).
        times: Times of the configurations [s], shape (T,); all 0 if omitted.
        growth: Rate at which distances of pairs shrink with time [m/s], shape (p,).
        known: Distance above which none is searched for [m].
        to: Which pairs count.

    Attributes:
        best: The minimum distance measured, or `known` [m].
        index: Index of the configuration where it was measured.
        measured: Number of configurations at which distances were measured.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        path: Array,
        times: Array | None = None,
        growth: Array | None = None,
        known: float = np.inf,
        to: PairsTo = "all",
    ) -> None:
        self._counted = checker._shapes.counted(to)
        self.checker, self.path = checker, np.ascontiguousarray(checker.pepper.to_full(path))
        self.times = np.zeros(len(path)) if times is None else np.asarray(times, dtype=float)
        self.bodies = _known(checker.pepper, checker._shapes).bodies
        if growth is not None:
            self.bodies = self.bodies._replace(growth=growth)
        if to != "all":
            self.bodies = self.bodies._replace(paddings=self.bodies.paddings - _FAR * ~self._counted)
        self.best, self.index, self.measured = known, 0, 0

    def run(self) -> None:
        """Find the configuration at which the bodies come nearest."""
        if not self._counted.any():
            return
        poses, search = self._workspace()
        while (status := search_least(self.bodies, self.path, self.times, poses, search)) != DONE:
            if status == GROW:
                more = {name: np.resize(getattr(search, name), 2 * search.kept.size) for name in _GROWING}
                search = search._replace(**more)
            else:
                self._measure(search)

    def _workspace(self) -> tuple[Poses, ClearanceSearch]:
        joints, solids, pairs = len(self.bodies.parents), len(self.bodies.carriers), self.checker.pair_count
        roots = 2 * (len(self.path) // FIRST + 1)
        poses = Poses(
            joints=np.empty((joints, PLACEMENT)),
            bodies=np.empty((solids, 12)),
            motion_bounds=np.zeros((solids, joints)),
            used=np.empty(solids, dtype=bool),
        )
        search = ClearanceSearch(
            at=np.zeros(PLACES, dtype=np.int64),
            best=np.array([self.best]),
            roots=np.zeros((roots, 4), dtype=np.int64),
            root_bounds=np.empty(roots),
            waiting=np.zeros((DEEPEST, 4), dtype=np.int64),
            waiting_bounds=np.empty(DEEPEST),
            kept=np.empty(4 * pairs, dtype=np.int64),
            kept_bounds=np.empty(4 * pairs),
            pair=np.empty(pairs, dtype=np.int64),
            low=np.empty(pairs),
            high=np.empty(pairs),
            near=np.empty((pairs, 2)),
            steps=np.empty((2, joints)),
        )
        return poses, search

    def _measure(self, search: ClearanceSearch) -> None:
        """Measure pairs at one configuration, until none of the rest can be the nearest."""
        import pinocchio

        index, count = int(search.at[MIDDLE]), int(search.at[TO_MEASURE])
        data, queries = self.checker._data
        pinocchio.forwardKinematics(self.checker.pepper.inner_model, data, self.path[index])
        queries.place(data)
        self.measured += 1
        bounds = (search.low[:count] - search.near[:count].max(axis=1)).tolist()
        for k, pair in enumerate(search.pair[:count].tolist()):
            if bounds[k] >= self.best + ROUNDING:
                continue
            found = queries.distance(pair).min_distance - self.bodies.paddings[pair]
            found -= self.times[index] * self.bodies.growth[pair]
            search.low[k] = found
            if found < self.best:
                self.best, self.index = float(found), index
        search.best[0] = self.best


class _Known:
    """Constant data of the search about the shapes and pairs of checkers."""

    def __init__(self, pepper: PepperModel, shapes: CheckedShapes) -> None:
        self._pepper, self._shapes = pepper, shapes

    @cached_property
    def bodies(self) -> Bodies:
        """Joints, bodies and pairs."""
        tree = moving_tree(self._pepper)
        turns = tree.rotations[1:].reshape(-1, 9)
        shapes, count = self._shapes, len(self._shapes.pairs[0])
        solids = [_solid(body) for body in shapes.bodies]
        entries = [np.argwhere(moves) for moves in self._against]
        sides = np.repeat([0, 1], [len(each) for each in entries])
        pair, joint = np.concatenate(entries).T
        order = np.argsort(pair, kind="stable")
        return Bodies(
            parents=np.array(tree.parents[1:], dtype=np.int64) - 1,
            slides=np.array(tree.slides[1:]),
            placements=np.concatenate([tree.positions[1:], turns, tree.axes[1:]], axis=1),
            carriers=np.array([body.joint for body in shapes.bodies], dtype=np.int64) - 1,
            solids=np.array([numbers for numbers, _ in solids]).reshape(-1, SOLID),
            exact=np.array([exact for _, exact in solids], dtype=bool),
            flat=np.array([body.is_half_space for body in shapes.bodies], dtype=bool),
            pairs=np.ascontiguousarray(np.transpose(shapes.pairs), dtype=np.int64),
            paddings=shapes.paddings,
            growth=np.zeros(count),
            first=np.searchsorted(pair[order], np.arange(count + 1)).astype(np.int64),
            joints=joint[order].astype(np.int64),
            sides=sides[order].astype(np.int64),
        )

    @cached_property
    def motion_bounds(self) -> Array:
        """Bounds on how much a unit of each joint brings pairs nearer, at any positions, one row each."""
        shapes, solids = self._shapes, self.bodies.solids
        placed = zip(shapes.bodies, solids[:, :3], solids[:, -1], strict=True)
        hulls = [Hull(body.joint, center[np.newaxis], float(radius)) for body, center, radius in placed]
        bounds, (first, second) = motion_bounds_of(self._pepper, hulls), self._against
        pairs = shapes.pairs
        against = np.where(first, bounds[pairs[0]], 0.0) + np.where(second, bounds[pairs[1]], 0.0)
        bounds = np.unique(against, axis=0)
        exceeded = [((bounds >= own).all(axis=1) & (bounds > own).any(axis=1)).any() for own in bounds]
        return bounds[~np.array(exceeded, bool)]

    @cached_property
    def _against(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether each joint moves the first body of a pair and not the second, and the opposite."""
        carried = moving_tree(self._pepper).carried()
        joints = np.array([body.joint for body in self._shapes.bodies], dtype=int)
        first, second = carried[joints[self._shapes.pairs[0]]], carried[joints[self._shapes.pairs[1]]]
        return first & ~second, second & ~first


@kept_for_robot(most=64)
def _known(pepper: PepperModel, shapes: CheckedShapes) -> _Known:
    """Return the search's data about a robot's shapes and pairs, cached."""
    return _Known(pepper, shapes)


def _solid(body: CollisionBody) -> tuple[Array, bool]:
    """Return the solid around a body, shape (SOLID,), and whether it equals the body."""
    import coal

    placed, numbers = body.geometry_object, np.zeros(SOLID)
    shape, place, exact = placed.geometry, placed.placement, True
    if body.is_half_space:
        numbers[:3], numbers[9:12] = place.act(np.array(shape.n) * shape.d), place.rotation @ shape.n
        return numbers, True
    numbers[:3], numbers[3:12] = place.act(np.array(shape.aabb_center)), np.ravel(place.rotation.T)
    match shape:
        case coal.Sphere():
            numbers[15] = shape.radius
        case coal.Capsule():
            numbers[14], numbers[15] = shape.halfLength, shape.radius
        case coal.Box():
            numbers[12:15] = shape.halfSide
        case _:
            box = shape.aabb_local
            numbers[12:15], exact = (np.array(box.max_) - np.array(box.min_)) / 2, False
    numbers[16] = shape.aabb_radius
    return numbers, exact
