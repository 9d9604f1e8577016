"""Robots that are no longer used are collected, whatever was computed with them; what is kept is bounded."""

import gc
import pickle
import weakref

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import base_placement, batch, collision, dynamics, ik, kinematics, motion, symbolic
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.model import kept_for_robot
from pepper_kin.trajectory import OnlineMotion
from pepper_kin.twin import Twin, TwinBatch
from pepper_kin.twin.base import BalanceMonitor
from pepper_kin.twin.sensors import Camera, SensorSuite
from pepper_kin.twin.world import World

POINT = (0.38, 0.22, 0.82)


def make_scene():
    return pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))


def quantities(pepper):
    q, v = pepper.neutral(), np.zeros(pepper.n)
    for states in (q, np.tile(q, (32, 1))):
        zero = np.zeros_like(states)
        kinematics.frame_pose(pepper, states, "LArm_effector")
        kinematics.frame_jacobian(pepper, states, "LArm_effector")
        dynamics.inverse_dynamics(pepper, states, zero, zero)
        dynamics.forward_dynamics(pepper, states, zero, zero)
        dynamics.mass_matrix(pepper, states)
        dynamics.center_of_mass(pepper, states)
        dynamics.potential_energy(pepper, states)
        dynamics.zero_moment_point(pepper, states, zero, zero)
        dynamics.centroidal_momentum(pepper, states, zero)
    dynamics.newton_euler(pepper, q, v, v)
    symbolic.function(pepper, "mass_matrix")
    batch.kernel(pepper, "gravity_torque")


def inverse_kinematics(pepper):
    tasks = [ik.HandPosition("left", POINT), ik.LookAt(POINT)]
    for solver in ("fast", "placo", "proxsuite"):
        ik.solve(pepper, tasks, solver=solver, scene=make_scene())
    ik.solve(pepper, [ik.HandPosition("left", POINT), ik.CenterOfMassOverWheels(0.01)])
    ik.solve_batch(pepper, ik.HandPosition("left", np.tile(POINT, (4, 1))))


def collisions(pepper):
    q, scene = pepper.neutral(), make_scene()
    collision.in_collision(pepper, q, scene)
    collision.in_collision(pepper, np.tile(q, (64, 1)), scene)
    collision.clearance(pepper, q, scene)
    collision.near_pairs(pepper, q, 0.1, scene)
    fast_checker_for(pepper, scene, 0.01).in_collision(q)


def motions(pepper):
    scene, tasks = make_scene(), [ik.HandPosition("left", POINT)]
    plan = pk.plan(pepper, pepper.posture("Stand"), tasks, scene, payload={"left": 0.3}, balance=0.005)
    trajectory = pk.retime(pepper, plan, balance=0.005, payload={"left": 0.3})
    trajectory.check(pepper, scene=scene)
    motion.optimize(pepper, plan, scene)


def twins(pepper):
    q, world = pepper.neutral(), World(pepper, make_scene())
    world.add_box("parcel", size=(0.1, 0.1, 0.1), mass=0.5, position=(0.5, 0.0, 0.8))
    twin = Twin(pepper, timestep=0.001, world=world)
    twin.reset(q)
    for _ in range(3):
        twin.step(q)
    turned = pepper.joint_vector({"HeadYaw": 0.2})
    TwinBatch(pepper, 4).execute(pk.retime(pepper, np.array([q, turned])))


def sensors(pepper):
    q, still = pepper.neutral(), np.zeros(pepper.n)
    SensorSuite(pepper, seed=1, scene=make_scene()).read(0.0, q, still, still, scene=make_scene())
    Camera(pepper, "camera_depth").depth(q, make_scene())
    BalanceMonitor(pepper)


def servos(pepper):
    servo = pk.servo.Servo(pepper, pepper.posture("Stand"), scene=make_scene())
    servo.set_target(ik.HandPosition("left", POINT))
    servo.step()
    online = OnlineMotion(pepper, pepper.posture("Stand"))
    online.set_target(pepper.joint_vector({"HeadYaw": 0.5}))
    online.step(0.01)


def constrained(pepper):
    level = ik.AxisAlignment("LArm_effector", (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    start = ik.solve(pepper, [ik.HandPosition("left", POINT), level])
    motion.plan_constrained(
        pepper,
        start.q,
        [ik.HandPosition("left", (0.38, 0.2, 0.86))],
        None,
        [level],
        joints="left_arm",
        timeout=5.0,
    )
    kinematics.reach_map(pepper, "LArm_effector", samples=1000)


def places(pepper):
    base_placement.place_base(pepper, [ik.HandPosition("left", (1.0, 0.2, 0.8))], scene=make_scene())


ROOMS = (quantities, inverse_kinematics, collisions, motions, twins, sensors, servos, constrained, places)


@pytest.mark.thorough
@pytest.mark.parametrize("use", ROOMS)
def test_a_robot_that_is_no_longer_used_is_collected(pepper, use):
    robot = pickle.loads(pickle.dumps(pepper))  # a robot of our own
    use(robot)
    gone = weakref.ref(robot)
    del robot
    gc.collect()
    assert gone() is None


def test_a_memory_forgets_what_was_asked_for_longest_ago(pepper):
    calls = []

    @kept_for_robot(most=3)
    def build(robot, number):
        calls.append(number)
        return object()

    for number in (1, 2, 3, 1, 4, 1):
        build(pepper, number)
    assert calls == [1, 2, 3, 4]
    build(pepper, 2)
    assert calls == [1, 2, 3, 4, 2]


def test_a_memory_is_bounded_in_bytes(pepper):
    @kept_for_robot(most=100, most_bytes=1000, size_of=lambda value: value)
    def build(robot, size):
        calls.append(size)
        return size

    calls = []
    for size in (400, 500, 300, 5000, 5000, 300):
        build(pepper, size)
    assert calls == [400, 500, 300, 5000, 300]
