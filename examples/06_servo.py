"""Follow a moving point: the left hand draws a circle while the gaze stays on the hand."""

import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper()
servo = pk.servo.Servo(pepper, pepper.posture("Ready"), rate=100.0)


def point_on_circle(time):
    angle = 2 * np.pi * time / 4.0
    return np.array([0.30, 0.20, 0.95]) + 0.06 * np.array([0.0, np.cos(angle), np.sin(angle)])


path, misses = [servo.q], []
for _ in range(800):
    target = point_on_circle(servo.time)
    servo.set_target([pk.ik.HandPosition("left", target), pk.ik.LookAt(target)])
    state = servo.step()  # a robot would be sent state.q now, every 10 ms
    path.append(state.q)
    hand = pk.kinematics.frame_pose(pepper, state.q, "LArm_effector")[:3, 3]
    misses.append(np.linalg.norm(hand - point_on_circle(state.time)))
print(state.report())
print(f"after 3 s the hand is never more than {1000 * max(misses[300:]):.2f} mm off the moving point")

# No more commands: after the timeout it brakes as hard as the motors may, and rests.
while state.status is not pk.servo.ServoStatus.RESTING:
    state = servo.step()
    path.append(state.q)
print(state.report())

acceleration = np.abs(np.diff(path, 2, axis=0)) * servo.rate**2
assert max(misses[300:]) < 0.5e-3
assert np.all(acceleration <= pepper.acceleration_limits * (1 + 1e-8))
assert not pk.collision.in_collision(pepper, np.array(path)).any()
