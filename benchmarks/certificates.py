"""Are certificates right?  Limits that are just kept or exceeded, and thin, fast things."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from harness import figures

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, PepperKinError
from pepper_kin.trajectory.balance import balance_margin, support_polygon

RIGHT, WRONG = 1e-3, 2e-3  # of a limit
BALANCE = 0.1  # [m], of which the same shares are left or missing
TICK, BATCH = 1e-5, 50_000
LIMITS = ("torque", "hand_speed", "balance")


def motions(count, seed):
    """Yield robots and motions."""
    rng, pepper = np.random.default_rng(seed), pk.load_pepper()
    robots = pepper, pepper.with_requirements("limits")
    while count:
        low, high = pepper.lower_limits, pepper.upper_limits
        postures = [low + (high - low) * rng.uniform(0.2, 0.8, pepper.n) for _ in range(rng.integers(1, 4))]
        robot = robots[count % 2]
        try:
            yield robot, pk.retime(robot, [pepper.posture("Stand"), *postures], balance=0.01)
        except PepperKinError:  # a posture that cannot be held still, or tips over
            continue
        count -= 1


def extremes(pepper, motion):
    """Return the greatest share of a torque limit, speed of the left hand [m/s] and least balance [m]."""
    share, speed, balance = 0.0, 0.0, np.inf
    time = np.arange(0.0, motion.duration, TICK)
    for begin in range(0, time.size, BATCH):
        q, v, a = motion(time[begin : begin + BATCH])
        share = max(
            share, np.max(np.abs(pk.dynamics.inverse_dynamics(pepper, q, v, a)) / pepper.effort_limits)
        )
        jacobian = pk.kinematics.frame_jacobian(pepper, q, "LArm_effector")[:, :3]
        speed = max(speed, np.linalg.norm(np.einsum("tij,tj->ti", jacobian, v), axis=1).max())
        balance = min(balance, balance_margin(pepper, support_polygon(pepper), q, v, a).min())
    return share, speed, balance


@figures("trajectories.md", count=2)
def certificate_bounds(count: int, seed: int = 0) -> Iterator[str]:
    """Are certificates right?

    Motions through random postures are looked at every 0.01 ms.  Limits are set such that the torque that
    uses most, the speed of the left hand and the balance keep them by `RIGHT` there, and then such that they
    exceed them by `WRONG`.  Every other motion is timed with all of the torque.
    """
    refused, passed, torques = dict.fromkeys(LIMITS, 0), dict.fromkeys(LIMITS, 0), 0
    for pepper, motion in motions(count, seed):
        share, speed, balance = extremes(pepper, motion)

        def check(by, motion=motion, pepper=pepper, share=share, speed=speed, balance=balance):
            return motion.check(
                pepper, collisions=False, torque_scale=min(share / (1 + by), 1.0),
                hand_speed={"left": speed / (1 + by)}, balance=balance + by * BALANCE,
            )  # fmt: skip

        right, wrong = check(-RIGHT), check(WRONG)
        torques += share <= 1 - RIGHT
        for kind in LIMITS:
            # A torque at its full limit has no share to spare that could be asked for.
            told = kind != "torque" or share <= 1 - RIGHT
            refused[kind] += int(told and not getattr(right, kind).success)
            passed[kind] += getattr(wrong, kind).success
    yield f"{count} motions ({torques} of them with torque to spare); refused: {refused}; passed: {passed}"


MOTIONS = 20
SIZE, BEAD = 0.1, 0.0001  # [m]
NEAR = np.arange(-50, 51) * 1e-5  # [s]


def swings(pepper, rng):
    """Return fast motions of the left arm."""
    low, high = pepper.lower_limits, pepper.upper_limits
    arm, found = [pepper.joint_index(name) for name in pepper.joint_group("left_arm")], []
    while len(found) < MOTIONS:
        ends = np.tile(pepper.posture("Stand"), (2, 1))
        ends[:, arm] = rng.uniform(0.9 * low[arm], 0.9 * high[arm], (2, len(arm)))
        try:
            motion = pk.retime(pepper, ends)
        except InfeasibleError:
            continue
        if motion.check(pepper).success:
            found.append(motion)
    return found


def case(pepper, motion, rng):
    """Return a scene with the plate and the bead, and when they meet [s]."""
    at = (rng.integers(1000 * 0.2 * motion.duration, 1000 * 0.8 * motion.duration) + rng.uniform()) / 1000
    held = np.eye(4)
    held[:3, 3] = rng.uniform(0.15, 0.3) * np.array([1.0, *rng.uniform(-0.3, 0.3, 2)])
    hand = pk.kinematics.frame_pose(pepper, motion([at - 1e-4, at]).position, "LArm_effector")
    before, now = hand @ held
    way = now[:3, :3].T @ (now - before)[:3, 3]
    turn = np.linalg.svd((way / np.linalg.norm(way))[None])[2][::-1].T
    held[:3, :3] = turn if np.linalg.det(turn) > 0 else turn * [-1.0, 1.0, 1.0]
    gap = rng.choice([-rng.uniform(0.0, SIZE / 2), rng.uniform(0.0, 1e-4), rng.uniform(1e-3, 2e-3)])
    place = (hand[1] @ held @ np.array([SIZE / 2 + BEAD + gap, 0.0, 0.0, 1.0]))[:3]
    scene = pk.Scene().add_sphere("bead", BEAD, place)
    scene = scene.add_box("plate", (SIZE, SIZE, rng.uniform(2e-4, 2e-3)), (0.0, 0.0, 3.0))
    touched = [link for link in pepper.link_names if link != "Tibia"]  # of the robot only the plate matters
    return scene.attach("plate", "LArm_effector", held, touch_links=touched), at


@figures("trajectories.md", cases=5)
def thin_and_fast(cases: int, seed: int = 0) -> Iterator[str]:
    """Are thin, fast things certified rightly?

    A hand swings a plate of 0.2 to 2 mm past a bead of 0.1 mm, at a time between two milliseconds: into it,
    beside it by up to 0.1 mm, or by 1 to 2 mm.  Each case is certified by `check`.  Coal, asked for the
    distance every 0.01 ms around that time, says whether they touch; those that keep 1 mm do so at every 0.01
    ms.
    """
    pepper, rng = pk.load_pepper(), np.random.default_rng(seed)
    swung, (touching, certified, kept, refused) = swings(pepper, rng), (0, 0, 0, 0)
    for _ in range(cases):
        motion = swung[rng.integers(MOTIONS)]
        scene, at = case(pepper, motion, rng)
        found = motion.check(pepper, scene).obstacle_clearance.success
        least = pk.collision.clearance(pepper, motion(at + NEAR).position, scene, to="obstacles").min()
        touching, certified = touching + (least <= 0.0), certified + (found and least <= 0.0)
        if least >= 1e-3:
            fine = motion(np.arange(0.0, motion.duration, 1e-5)).position
            if pk.collision.least_clearance(pepper, fine, scene, to="obstacles").distance >= 1e-3:
                kept, refused = kept + 1, refused + (not found)
    yield f"{cases:,} cases; {touching:,} touch, of which {certified} are certified"
    yield f"{kept:,} keep 1 mm, of which {refused} are refused"
