"""Are certificates right?  `python benchmarks/certificate_bounds.py COUNT [SEED]`.

COUNT motions through random postures are looked at every 0.01 ms.  Limits are set such that the torque that
uses most, the speed of the left hand and the balance keep them by `RIGHT` there, and then such that they
exceed them by `WRONG`.  Every other motion is timed with all of the torque.
"""

import sys

import numpy as np

import pepper_kin as pk
from pepper_kin.exceptions import PepperKinError
from pepper_kin.trajectory.balance import balance_margin, support_polygon

RIGHT, WRONG = 1e-3, 2e-3  # of a limit
BALANCE = 0.1  # [m], of which the same shares are left or missing
STEP, BATCH = 1e-5, 50_000
KINDS = ("torque", "hand_speed", "balance")


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
    time = np.arange(0.0, motion.duration, STEP)
    for begin in range(0, time.size, BATCH):
        q, v, a = motion(time[begin : begin + BATCH])
        share = max(
            share, np.max(np.abs(pk.dynamics.inverse_dynamics(pepper, q, v, a)) / pepper.effort_limits)
        )
        jacobian = pk.kinematics.frame_jacobian(pepper, q, "LArm_effector")[:, :3]
        speed = max(speed, np.linalg.norm(np.einsum("tij,tj->ti", jacobian, v), axis=1).max())
        balance = min(balance, balance_margin(pepper, support_polygon(pepper), q, v, a).min())
    return share, speed, balance


def main(count, seed=0):
    """Print how many certificates are wrong."""
    refused, passed, torques = dict.fromkeys(KINDS, 0), dict.fromkeys(KINDS, 0), 0
    for pepper, motion in motions(count, seed):
        share, speed, balance = extremes(pepper, motion)
        right = motion.check(
            pepper, collisions=False, torque_scale=min(share / (1 - RIGHT), 1.0),
            hand_speed={"left": speed / (1 - RIGHT)}, balance=balance - RIGHT * BALANCE,
        )  # fmt: skip
        wrong = motion.check(
            pepper, collisions=False, torque_scale=share / (1 + WRONG),
            hand_speed={"left": speed / (1 + WRONG)}, balance=balance + WRONG * BALANCE,
        )  # fmt: skip
        torques += share <= 1 - RIGHT
        for kind in KINDS:
            # A torque at its full limit has no share to spare that could be asked for.
            told = kind != "torque" or share <= 1 - RIGHT
            refused[kind] += int(told and not getattr(right, kind).success)
            passed[kind] += getattr(wrong, kind).success
    print(f"{count} motions ({torques} of them with torque to spare); refused: {refused}; passed: {passed}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
