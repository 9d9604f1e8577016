"""Are thin, fast things certified rightly?  `python benchmarks/thin_and_fast.py CASES [SEED]`.

A hand swings a plate of 0.2 to 2 mm past a bead of 0.1 mm, at a time between two milliseconds: into it,
beside it by up to 0.1 mm, or by 1 to 2 mm.  Each case is certified by `check`.  Coal, asked for the distance
every 0.01 ms around that time, says whether they touch; those that keep 1 mm do so at every 0.01 ms.
"""

import sys

import numpy as np

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError

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


def main():
    """Print counts."""
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    pepper, cases = pk.load_pepper(), int(sys.argv[1])
    motions = swings(pepper, rng)
    touching = certified = kept = refused = 0
    for _ in range(cases):
        motion = motions[rng.integers(MOTIONS)]
        scene, at = case(pepper, motion, rng)
        found = motion.check(pepper, scene).obstacle_clearance.success
        least = pk.collision.clearance(pepper, motion(at + NEAR).position, scene, to="obstacles").min()
        touching, certified = touching + (least <= 0.0), certified + (found and least <= 0.0)
        if least >= 1e-3:
            fine = motion(np.arange(0.0, motion.duration, 1e-5)).position
            if pk.collision.least_clearance(pepper, fine, scene, to="obstacles").distance >= 1e-3:
                kept, refused = kept + 1, refused + (not found)
    print(f"{cases:,} cases; {touching:,} touch, of which {certified} are certified")
    print(f"{kept:,} keep 1 mm, of which {refused} are refused")


if __name__ == "__main__":
    main()
