"""Which pairs of links never touch: the pairs that `urdf/pepper.srdf` disables."""

from __future__ import annotations

import csv
import functools
import itertools
import multiprocessing
import re
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import coal
import numpy as np
from harness import figures, timed

import pepper_kin as pk
from pepper_kin.collision.checker import coal_geometry
from pepper_kin.model import Capsule, Sphere
from pepper_kin.model.kinematic_tree import kinematic_tree

MARGIN = 0.010
NEAR = 0.05  # pairs whose first attack ends nearer than this are attacked harder
HARD = 2  # how often
HAND_MARGIN = 0.0002  # fingers of one hand keep a fixed gap of 1 to 3 mm as they close side by side
BATCH = 20_000
HANDS = ("locked", "mimic", "independent")


def segment_distance(p, u, q, v):
    """Distance of segments p + s u and q + t v, s and t in [-1, 1], each argument shape (k, 3) [m].

    Ericson, Real-Time Collision Detection, 5.1.9, with the end clamped anew after each step.
    """
    r = p - q
    a, e, b = (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)
    c, f = (u * r).sum(1), (v * r).sum(1)
    tiny = 1e-14
    determinant = a * e - b * b
    s = np.where(determinant > tiny, (b * f - c * e) / np.maximum(determinant, tiny), 0.0)
    s = np.clip(s, -1, 1)
    t = np.clip(np.where(e > tiny, (b * s + f) / np.maximum(e, tiny), 0.0), -1, 1)
    s = np.clip(np.where(a > tiny, (b * t - c) / np.maximum(a, tiny), 0.0), -1, 1)
    t = np.clip(np.where(e > tiny, (b * s + f) / np.maximum(e, tiny), 0.0), -1, 1)
    return np.linalg.norm(r + s[:, None] * u - t[:, None] * v, axis=1)


@dataclass
class Solid:
    """A collision shape on its moving joint."""

    link: str
    body: str  # the link that carries the moving joint above it
    pose: np.ndarray  # in the frame of `body`
    half: float  # half length of the segment, -1 for a box
    radius: float  # of the capsule or sphere
    bound: float  # of the bounding sphere
    coal: object = field(repr=False)


class Robot:
    """Batched kinematics and exact distances of one variant of Pepper."""

    def __init__(self, hands: str) -> None:
        self.pepper = pk.load_pepper(hands=hands)
        self.tree = kinematic_tree(self.pepper.document)
        self.solids: dict[str, list[Solid]] = {}
        for shape in self.pepper.collision_shapes:
            body, pose = self.body_of(shape.link)
            pose = pose @ shape.transform_shape_to_link
            geometry = shape.geometry
            if isinstance(geometry, Capsule):
                half, radius = geometry.length / 2, geometry.radius
                bound = half + radius
            elif isinstance(geometry, Sphere):
                half, radius = 0.0, geometry.radius
                bound = radius
            else:
                half, radius, bound = -1.0, 0.0, float(np.linalg.norm(geometry.size)) / 2
            solid = Solid(shape.link, body, pose, half, radius, bound, coal_geometry(geometry))
            self.solids.setdefault(shape.link, []).append(solid)

    def body_of(self, link):
        """Return the link at the lower end of the moving joint above `link`, and `link`'s pose in it."""
        pose = np.eye(4)
        while link in self.tree.joints and self.tree.joints[link].joint.type == "fixed":
            placed = self.tree.joints[link]
            pose, link = placed.transform_child_to_parent @ pose, placed.joint.parent
        return link, pose

    def draw(self, rng, count):
        pepper = self.pepper
        return rng.uniform(pepper.lower_limits, pepper.upper_limits, size=(count, pepper.n))

    def poses(self, q, bodies):
        """Poses of bodies, each (k, 4, 4), at q (k, n)."""
        found = pk.kinematics.frame_poses(self.pepper, q, bodies)
        return dict(zip(bodies, np.moveaxis(found, 1, 0), strict=True))


@functools.cache
def robot_with(hands):
    return Robot(hands)


def solid_distance(a: Solid, pa, b: Solid, pb):
    """Exact distances of two solids whose bodies have poses pa and pb, (k, 4, 4); below zero: overlap."""
    ta, tb = pa @ a.pose, pb @ b.pose
    if a.half >= 0 and b.half >= 0:
        gap = segment_distance(ta[:, :3, 3], a.half * ta[:, :3, 2], tb[:, :3, 3], b.half * tb[:, :3, 2])
        return gap - a.radius - b.radius
    request = coal.DistanceRequest()
    result = np.empty(len(ta))
    for k in range(len(ta)):
        answer = coal.DistanceResult()
        result[k] = coal.distance(
            a.coal, coal.Transform3s(ta[k, :3, :3], ta[k, :3, 3]),
            b.coal, coal.Transform3s(tb[k, :3, :3], tb[k, :3, 3]), request, answer,
        )  # fmt: skip
    return result


def touching(robot, poses, centers, first, second, stop_at_first):
    """Whether two links touch, (k,) bool, bounding spheres first; `stop_at_first`: one True is enough."""
    touch = None
    for a, b in itertools.product(robot.solids[first], robot.solids[second]):
        pa, pb = poses[a.body], poses[b.body]
        touch = np.zeros(len(pa), dtype=bool) if touch is None else touch
        gap = centers[id(a)][: len(pa)] - centers[id(b)][: len(pa)]
        near = np.flatnonzero(((gap * gap).sum(1) < (a.bound + b.bound) ** 2) & ~touch)
        size = 64 if min(a.half, b.half) < 0 else BATCH
        for start in range(0, len(near), size):
            part = near[start : start + size]
            touch[part] = solid_distance(a, pa[part], b, pb[part]) <= 0
            if stop_at_first and touch.any():
                return touch
    return touch


def candidate_pairs(robot, hands):
    """All pairs of links with shapes; with moving fingers only those of the hands (the rest is the same)."""
    pairs = list(itertools.combinations(sorted(robot.solids), 2))
    if hands == "locked":
        return pairs
    return [pair for pair in pairs if any(hand_of(link) for link in pair)]


def hand_of(link):
    """ "L", "R" or "" for a link that is no part of a hand."""
    if link.endswith("_wrist"):
        return link[0].upper()
    return link[0] if "Finger" in link or "Thumb" in link else ""


def in_one_hand(pair):
    return bool(hand_of(pair[0])) and hand_of(pair[0]) == hand_of(pair[1])


def mirrored(pair):
    def mirror(link):
        swap = {"L": "R", "R": "L", "l": "r", "r": "l"}
        sided = link[:2] in ("l_", "r_") or link[1:] in (
            "Shoulder", "Bicep", "Elbow", "ForeArm"
        ) or "Finger" in link or "Thumb" in link  # fmt: skip
        if link in ("WheelFL_link", "WheelFR_link"):
            return "WheelFR_link" if link == "WheelFL_link" else "WheelFL_link"
        return swap[link[0]] + link[1:] if sided else link

    return tuple(sorted(mirror(link) for link in pair))


def sample(job):
    """Sample one share of the configurations: pair -> (touched once, free once)."""
    hands, samples, seed = job
    robot, rng = Robot(hands), np.random.default_rng(seed)
    pairs = candidate_pairs(robot, hands)
    bodies = sorted({solid.body for solids in robot.solids.values() for solid in solids})
    outcomes = {pair: [False, False] for pair in pairs}
    left = samples
    while left > 0:
        count = min(BATCH, left)
        left -= count
        poses = robot.poses(robot.draw(rng, count), bodies)
        centers = {
            id(solid): poses[solid.body][:, :3, :3] @ solid.pose[:3, 3] + poses[solid.body][:, :3, 3]
            for solids in robot.solids.values()
            for solid in solids
        }
        for pair, (touched, free) in outcomes.items():
            if touched and free:
                continue
            moving = len({robot.body_of(link)[0] for link in pair}) > 1
            part = poses if moving else {body: pose[:1] for body, pose in poses.items()}
            touch = touching(robot, part, centers, *pair, stop_at_first=free)
            outcomes[pair] = [touched or bool(touch.any()), free or not touch.all()]
    return hands, outcomes


def closest(job):
    """Attack one pair: the least distance that a shrinking random search finds [m]."""
    hands, pair, seed, hard = job
    robot, rng = robot_with(hands), np.random.default_rng(seed)
    bodies = sorted({solid.body for link in pair for solid in robot.solids[link]})

    def distance(q):
        poses = robot.poses(q, bodies)
        best = np.full(len(q), np.inf)
        for a, b in itertools.product(robot.solids[pair[0]], robot.solids[pair[1]]):
            pa, pb = poses[a.body], poses[b.body]
            ca = pa[:, :3, :3] @ a.pose[:3, 3] + pa[:, :3, 3]
            cb = pb[:, :3, :3] @ b.pose[:3, 3] + pb[:, :3, 3]
            bound = np.linalg.norm(ca - cb, axis=1) - a.bound - b.bound
            near = np.flatnonzero(bound < best)
            if len(near):
                best[near] = np.minimum(best[near], solid_distance(a, pa[near], b, pb[near]))
        return best

    lower, upper = robot.pepper.lower_limits, robot.pepper.upper_limits
    boxes = any(s.half < 0 for link in pair for s in robot.solids[link])
    count, keep, rounds = (300, 10, 14) if boxes else (3000, 30, 14)
    if hard:
        count, keep, rounds = 5 * count, 2 * keep, 24
    q = robot.draw(rng, count)
    # Least distances often lie at the ends of the joints' ranges: start a third of them there.
    ends = rng.random(q.shape) < 0.5
    q[: count // 3] = np.where(ends, lower, upper)[: count // 3]
    value = distance(q)
    width = 0.3
    for _ in range(rounds):
        order = np.argsort(value)[:keep]
        q, value = q[order], value[order]
        if value[0] <= 0:
            break
        steps = rng.normal(size=(8, *q.shape)) * width * (upper - lower)
        steps *= rng.random(steps.shape) < 0.5
        more = np.clip(q + steps, lower, upper).reshape(-1, q.shape[1])
        q, value = np.concatenate([q, more]), np.concatenate([value, distance(more)])
        width *= 0.65 if not hard else 0.8
    return hands, pair, float(value.min())


def adjacent_pairs():
    """Pairs of links with shapes that one joint joins (frames without shapes in between are skipped)."""
    found = set()
    for hands in ("locked", "mimic"):
        robot = Robot(hands)
        for child in robot.solids:
            parent = child
            while parent in robot.tree.joints:
                parent = robot.tree.joints[parent].joint.parent
                if parent in robot.solids:
                    found.add(tuple(sorted((parent, child))))
                    break
    return found


def decide(samples, seed, pool, processes):
    """Return pair -> (reason or "Checked", least distance found or "")."""
    shares = [samples // processes + (i < samples % processes) for i in range(processes)]
    seeds = iter(np.random.SeedSequence(seed).spawn(len(HANDS) * processes))
    jobs = [(hands, share, next(seeds)) for hands in HANDS for share in shares]
    state: dict[str, dict[tuple[str, str], list[bool]]] = {hands: {} for hands in HANDS}
    for hands, outcomes in pool.imap_unordered(sample, jobs):
        for pair, (touched, free) in outcomes.items():
            old = state[hands].setdefault(pair, [False, False])
            state[hands][pair] = [old[0] or touched, old[1] or free]
        print(f"  sampled a share of {hands}", flush=True)
    every = sorted({pair for outcomes in state.values() for pair in outcomes})
    touched = {pair for pair in every if any(outcomes.get(pair, [False])[0] for outcomes in state.values())}
    always = {p for p in every if p in touched and not any(s.get(p, [0, False])[1] for s in state.values())}
    grasp = {p for p in touched if in_one_hand(p) and state["mimic"].get(p, [False])[0]}
    touched = spread(touched, every)
    attacks = [
        (hands, pair, (seed, number, index), False)
        for number, hands in enumerate(HANDS)
        for index, pair in enumerate(every)
        if pair in state[hands] and pair not in touched
    ]
    print(f"  {len(touched)} pairs touched; attacking {len(attacks)} that did not", flush=True)
    least: dict[tuple[str, str], float] = {}
    for _, pair, value in pool.imap_unordered(closest, attacks, chunksize=4):
        least[pair] = min(least.get(pair, np.inf), value)
    hard = [
        (hands, pair, (*key, again), True)
        for hands, pair, key, _ in attacks
        for again in range(HARD)
        if MARGIN < least[pair] < NEAR and not in_one_hand(pair)
    ]
    print(f"  {len(hard)} harder attacks", flush=True)
    for _, pair, value in pool.imap_unordered(closest, hard):
        least[pair] = min(least[pair], value)
    sampled = set(touched)
    near = {pair for pair, value in least.items() if value <= (HAND_MARGIN if in_one_hand(pair) else MARGIN)}
    touched = spread(touched | near, every)
    print(f"  the search made {len(touched - sampled)} more pairs touch or come within {MARGIN} m")
    adjacent = adjacent_pairs()
    result = {}
    for pair in every:
        if pair in adjacent:
            reason = "Adjacent"
        elif pair in always:
            reason = "Always"
        elif pair in grasp or mirrored(pair) in grasp:
            reason = "Grasp"
        else:
            reason = "Checked" if pair in touched else "Never"
        result[pair] = (reason, least.get(pair, ""))
    return result


def spread(touched, every):
    """Add what must be checked as well: mirror images, and the whole hand where a part of it touches."""
    result = set(touched) | {mirrored(pair) for pair in touched}
    groups = {tuple(sorted(hand_of(link) or link for link in pair)) for pair in result}
    for pair in every:
        hands = [hand_of(link) for link in pair]
        parts = tuple(sorted(hand or link for hand, link in zip(hands, pair, strict=True)))
        if any(hands) and hands[0] != hands[1] and parts in groups:
            result.add(pair)
    return result & set(every)


def write_srdf(path, result):
    """Replace all lines from the marker on; pairs marked "DependentRange" keep that reason."""
    marker = "  <!-- Pairs of links that are not checked"
    head, tail = path.read_text(encoding="utf-8").split(marker)
    ranges = {
        tuple(sorted(pair))
        for pair in re.findall(r'link1="(\S+)" link2="(\S+)" reason="DependentRange"', tail)
    }
    note = tail.split("-->")[0]
    lines = [
        f'  <disable_collisions link1="{pair[0]}" link2="{pair[1]}" reason="{reason}"/>\n'
        for reason in ("DependentRange", "Adjacent", "Always", "Grasp", "Never")
        for pair, (found, _) in result.items()
        if reason == ("DependentRange" if pair in ranges else found)
    ]
    path.write_text(head + marker + note + "-->\n" + "".join(lines) + "</robot>\n", encoding="utf-8")


@figures("theory/sources.md", samples=100)
def allowed_collisions(
    samples=1_000_000, seed=0, processes=2, output=Path("pairs.csv"), srdf: Path | None = None
) -> Iterator[str]:
    """Which pairs of links never touch: sampling, then a search that tries to make the rest touch.

    Three robots are sampled, because a pair may be disabled only if it never touches in any of them: locked
    hands (fingers part of the wrist), hands driven by their opening, and 28 independent fingers.  A pair that
    has touched once is settled; of a pair that has not, every sample is checked.  What has never touched is
    then attacked: from the closest of random starts, a shrinking random search lowers the pair's distance.
    Only a pair that stays apart by more than MARGIN is reported as "Never".  A pair whose mirror image must
    be checked is checked too, and so is every part of a hand against what any part of it touches.

    "Always" pairs touch in every configuration; "Grasp" pairs are parts of one hand that touch as the hand
    closes on itself.  Pairs that the SRDF marks "DependentRange" keep that word.  The table of pairs is
    written to `output`; the list in `srdf`, if named, is written anew.
    """
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        result, spent = timed(decide, samples, seed, pool, processes, clock=time.perf_counter)
    with output.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["link_1", "link_2", "reason", "least_distance_m"])
        for pair, (reason, least) in result.items():
            writer.writerow([*pair, reason, least if least == "" else f"{least:.4f}"])
    if srdf:
        write_srdf(srdf, result)
    counts = dict(Counter(reason for reason, _ in result.values()))
    yield f"{len(HANDS)} x {samples} configurations, {spent:.0f} s: {counts}"
