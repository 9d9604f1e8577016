"""Sensor readings: depth, sonar, lasers, inertia and wheels, each beside the true value."""

import numpy as np

import pepper_kin as pk
from pepper_kin.model import Box, Sphere
from pepper_kin.twin.base import BalanceMonitor, BaseController, OmniBase, simulate_tipping, world_velocity
from pepper_kin.twin.sensors import Camera, SensorSuite

pepper = pk.load_pepper(base="planar")
scene = (
    pk.Scene()
    .add("wall", Box((0.1, 4.0, 2.0)), position=(2.5, 0.0, 1.0), color=(0.80, 0.84, 0.90, 1.0))
    .add("ball", Sphere(0.1), position=(1.5, 0.0, 1.1), color=(0.93, 0.36, 0.20, 1.0))
)

# Drive forward for two seconds, then let the commands cease: the base ramps, and stops by itself.
base = OmniBase(pepper)
controller = BaseController(base, command_timeout=0.5)
suite = SensorSuite(pepper, seed=1, scene=scene)
posture = pepper.joint_vector({"HeadPitch": 0.0})
readings = {}
before = np.zeros(pepper.n)
for step in range(4000):
    time = step * 0.001
    if time < 2.0:
        controller.command((0.3, 0.0, 0.1))
    twist = controller.step(0.001)
    q, v = posture.copy(), np.zeros(pepper.n)
    q[:3], v[:3] = controller.pose, world_velocity(twist, controller.pose[2])
    for name, reading in suite.read(time, q, v, (v - before) / 0.001, scene=scene).items():
        readings.setdefault(name, []).append(reading)
    before = v

print(f"{'sensor':<26}{'samples':>8}  last reading, and the true value")
for name in ("imu_torso_accelerometer", "sonar_front", "wheel_odometry"):
    last = readings[name][-1]
    print(f"{name:<26}{len(readings[name]):>8}  {np.round(last.value, 3)}  {np.round(last.truth, 3)}")
print(f"the base came to rest at x = {controller.pose[0]:.3f} m, y = {controller.pose[1]:.3f} m")

# The camera in the head shows the ball where a pinhole model predicts it.
camera = Camera(pepper, "camera_depth")
depth = camera.depth(posture, scene)
column, row, _ = camera.project(posture, [[1.5, 0.0, 1.1]])[0]
distance = depth[round(row), round(column)]
print(f"the ball is at pixel ({column:.1f}, {row:.1f}), {distance:.3f} m away")

# A blow from behind: the robot tilts over its front wheels and falls back, or falls over.
monitor = BalanceMonitor(pepper)
times = np.linspace(0.0, 3.0, 601)
standing = np.tile(posture, (601, 1))
report = monitor.assess(times, standing, 0 * standing, 0 * standing)
print(report.report())
front = next(k for k in range(3) if "WheelB" not in monitor.edge(k))
for rate in (0.3, 1.2):
    run = simulate_tipping(monitor, report, standing, start=(front, 0.0, rate))
    print(f"tilting at {rate} rad/s: {run.message}")

assert abs(distance - (1.5 - 0.1 - 0.013)) < 0.02
assert len(readings["joint_encoders"]) == 200
assert np.abs(readings["wheel_odometry"][-1].error[:2]).max() < 0.02
assert np.allclose(controller.twist, 0.0)
assert report.balanced
assert run.status.value == "fallen"
