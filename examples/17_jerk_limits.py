"""One path, four jerk limits: their durations, and the jumps of acceleration that they avoid."""

import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper()
stand = pepper.posture("Stand")
raised = pepper.joint_vector({"RShoulderPitch": -0.2, "RElbowRoll": 1.0, "HeadYaw": -0.4})
aside = pepper.joint_vector({"RShoulderPitch": 0.3, "RShoulderRoll": -0.9, "HeadYaw": -0.9})
points = [stand, aside, raised]

timings = {"no limit": pk.retime(pepper, points)}
for jerk in ("brisk", "moderate", "gentle"):
    timings[jerk] = pk.retime(pepper, points, jerk=jerk)

# The greatest jump of the acceleration from one millisecond to the next, as a share of its limit.
jumps = {}
print(f"{'jerk':<10}{'duration':>10}{'greatest jump of acceleration in 1 ms':>40}")
for name, trajectory in timings.items():
    acceleration = trajectory.sample(0.001).acceleration / pepper.acceleration_limits
    jumps[name] = np.abs(np.diff(acceleration, axis=0)).max()
    print(f"{name:<10}{trajectory.duration:>8.2f} s{jumps[name]:>40.1%}")

durations = [trajectory.duration for trajectory in timings.values()]
assert durations == sorted(durations)
assert jumps["no limit"] > 0.5  # it switches from full acceleration to full braking
for jerk, factor in (("brisk", 30.0), ("moderate", 10.0), ("gentle", 5.0)):
    assert timings[jerk].check(pepper, jerk=jerk).success
    assert jumps[jerk] < 1.01 * factor * 0.001  # at most so many times the limit in a second
