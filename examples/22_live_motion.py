"""Live motion: the arm goes back and forth while a ball crosses its way; it stops, waits and goes on."""

import numpy as np

import pepper_kin as pk
from pepper_kin.motion import LiveMotion, LiveStatus
from pepper_kin.twin import Twin

pepper = pk.load_pepper()
pepper = pepper.with_limits(
    velocity=0.3 * pepper.velocity_limits, acceleration=0.3 * pepper.acceleration_limits
)
low = pepper.joint_vector({"LShoulderPitch": 1.0, "LShoulderRoll": 0.3, "LElbowRoll": -0.8})
high = pepper.joint_vector({"LShoulderPitch": 0.0, "LShoulderRoll": 0.3, "LElbowRoll": -0.8})
hand = pk.kinematics.frame_pose(pepper, (low + high) / 2, "l_gripper")[:3, 3]
PERIOD, TRACKED, DURATION = 0.03, np.array([0.0, -0.25, 0.0]), 4.5


def seen(now):
    """What a tracker says of the ball: where it is, how fast, and how sure that is [m/s]."""
    place = hand + np.array([0.0, 0.9, 0.0]) + now * TRACKED
    return pk.Scene().add_sphere("ball", 0.1, place, velocity=TRACKED, uncertainty=0.05)


twin, live = Twin(pepper), LiveMotion(pepper, low, seen(0.0), rate=1.0 / PERIOD)
twin.reset(low)
goals, times, states = [high, low] * 20, [], []


def command(measured):
    """Return where the joints should be at the next tick; what the ball does is looked at in each."""
    live.set_scene(seen(measured.time), measured.time)
    live.set_state(measured.position, measured.time)
    if not states or states[-1].status is LiveStatus.REACHED:
        live.set_goal(goals.pop(0))
    times.append(measured.time)
    states.append(live.step(measured.time))
    return states[-1].at(measured.time + PERIOD).position


positions = []
timing = twin.run_real_time(
    command, period=PERIOD, duration=DURATION, on_state=lambda s: positions.append(s.position)
)
print(timing.report())
waits = [state for state in states if state.status in (LiveStatus.STOPPING, LiveStatus.WAITING)]
print(f"{len(waits) * PERIOD:.1f} s of {DURATION:g} s it waited: {waits[0].reason}")
gaps = []
for at, q in zip(times, positions, strict=True):
    pairs = pk.collision.near_pairs(pepper, q, 2.0, seen(at + PERIOD))
    apart = zip(pairs.distances, pairs.names, strict=True)
    gaps.append(min(distance for distance, names in apart if "ball" in names))
print(f"never nearer to the ball than {1000 * min(gaps):.0f} mm")

assert waits
assert len(goals) < 38
assert min(gaps) > 0.0
