"""500 Peppers that differ in mass, payload, gains and friction follow one motion: their tracking errors."""

import os

import numpy as np

import pepper_kin as pk
from pepper_kin.twin import actuator_parameters

COUNT = 500
pepper = pk.load_pepper()
trajectory = pk.motion.gesture(pepper, "wave")
actuators = actuator_parameters(pepper)
rng = np.random.default_rng(0)


def factors(low, high, size):
    """Draw factors; the first robot stays as it is described."""
    drawn = rng.uniform(low, high, size)
    drawn[0] = 1.0
    return drawn


payload = rng.uniform(0.0, 0.4, COUNT)  # [kg] in the waving hand
friction = rng.uniform(0.0, 0.1, (COUNT, 1))  # [N m]
payload[0] = friction[0] = 0.0
batch = pk.TwinBatch(
    pepper,
    COUNT,
    vary={
        "stiffness": actuators.stiffness * factors(0.6, 1.4, (COUNT, 1)),
        "damping": actuators.damping * factors(0.6, 1.4, (COUNT, 1)),
        "coulomb_friction": friction,
    },
    mass_scale={"right_arm": factors(0.7, 1.3, COUNT), "left_arm": factors(0.7, 1.3, COUNT)},
    payload={"RArm_effector": payload},
)
run = batch.execute(trajectory, hold_time=0.5, every=10, threads=os.cpu_count() or 1)
print(run.report())

# How far the waving hand is from where it should be, all along the motion.
wanted = pk.kinematics.frame_pose(pepper, run.reference_position[0], "RArm_effector")[:, :3, 3]
hands = np.array([pk.kinematics.frame_pose(pepper, q, "RArm_effector")[:, :3, 3] for q in run.position])
errors = np.linalg.norm(hands - wanted, axis=-1)
worst = errors.max(axis=1)
print(f"the hand of the robot as described is off by at most {1000 * worst[0]:.1f} mm,")
print(
    f"of half of the others by {1000 * np.median(worst):.1f} mm, of the worst by {1000 * worst.max():.1f} mm"
)
correlation = np.corrcoef(payload, worst)[0, 1]
print(f"the payload explains most of the error: correlation {correlation:.2f}")

# The first robot does what a single twin does.
alone = pk.Twin(pepper).execute(trajectory, hold_time=0.5)
apart = np.abs(alone.position_at(run.time) - run.position[0]).max()
print(f"the first robot and a single twin: {apart:.1e} rad apart")

assert run.success.all()
assert apart < 1e-9
assert correlation > 0.5
assert worst[0] < np.median(worst)
