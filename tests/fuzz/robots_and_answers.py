"""Robots that differ in one thing each, and answers of every room that has machine code.

    python robots_and_answers.py NAME...

prints the answers for these robots one after the other, in one process, as JSON lines.  A name with "later "
before it stands for a robot that is made of one that is used first.
"""

import json
import pickle
import sys

import numpy as np

import pepper_kin as pk
from pepper_kin import collision, dynamics, ik, kinematics, motion
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.model import load_robot
from pepper_kin.trajectory import OnlineMotion
from pepper_kin.twin import Twin, TwinBatch
from pepper_kin.twin.base import BalanceMonitor
from pepper_kin.twin.sensors import SensorSuite

POINT = (0.38, 0.22, 0.82)


def change_mass(model):
    model.inertias[model.getJointId("LWristYaw")].mass += 3.0


def change_placement(model):
    place = model.jointPlacements[model.getJointId("LElbowYaw")]
    place.translation = place.translation + np.array([0.05, 0.0, 0.01])


def change_frame(model):
    frame = model.frames[model.getFrameId("LArm_effector")]
    frame.placement.translation = frame.placement.translation + np.array([0.04, 0.0, 0.0])


def change_gravity(model):
    model.gravity.linear = np.array([0.0, 0.0, -3.7])


def change_rotor(model):
    model.rotorInertia[model.joints[model.getJointId("HipPitch")].idx_v] = 0.5


IN_PLACE = {
    "a heavier hand": change_mass,
    "another joint placement": change_placement,
    "another place of a frame": change_frame,
    "another gravity": change_gravity,
    "another rotor": change_rotor,
}


def another_description():
    text = pk.load_pepper().urdf
    begin = text.index('<joint name="LElbowYaw"')
    place = text.index('xyz="', begin) + len('xyz="')
    end = text.index('"', place)
    x, *rest = text[place:end].split()
    return load_robot(text[:place] + " ".join([str(float(x) + 0.03), *rest]) + text[end:])


ROBOTS = {
    "as it is": lambda: pickle.loads(pickle.dumps(pk.load_pepper())),
    "other masses": lambda: pk.load_pepper().with_masses({"l_wrist": 3.0}),
    "other limits": lambda: pk.load_pepper().with_limits(
        upper={"HipPitch": 0.1}, velocity=0.5 * pk.load_pepper().velocity_limits
    ),
    "other efforts": lambda: pk.load_pepper().with_limits(effort=0.6 * pk.load_pepper().effort_limits),
    "another description": another_description,
    "a planar base": lambda: pk.load_pepper(base="planar"),
    "mimic hands": lambda: pk.load_pepper(hands="mimic"),
}
NAMES = (*ROBOTS, *IN_PLACE)


def scene_of(pepper, shift=0.0):
    return pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47 + shift, 0.05, 0.715))


def states_of(pepper, count):
    rng = np.random.default_rng(3)
    low, high = np.maximum(pepper.lower_limits, -1.0), np.minimum(pepper.upper_limits, 1.0)
    return rng.uniform(low, high, (count, pepper.n))


def quantities(pepper):
    q = states_of(pepper, 40)
    v, a = 0.3 * q[::-1], 0.5 * q
    yield dynamics.inverse_dynamics(pepper, q, v, a)
    yield dynamics.mass_matrix(pepper, q)
    yield dynamics.center_of_mass(pepper, q)
    yield dynamics.inverse_dynamics(pepper, q[0], v[0], a[0])
    yield kinematics.frame_pose(pepper, q, "LArm_effector")


def inverse_kinematics(pepper):
    reach, hips = ik.HandPosition("left", POINT), ik.LookAt(POINT)
    start = pepper.neutral()
    for tasks in ([reach, hips], [reach, ik.CenterOfMass((0.0, 0.0), weight=0.1)], [reach]):
        found = ik.solve(pepper, tasks, start, scene=scene_of(pepper), restarts=4, max_iterations=60)
        yield found.q
        yield [float(found.success)]
        met = [task.size(task.residual(pepper, found.q)) <= task.tolerance * (1.0 + 1e-6) for task in tasks]
        assert not found.success or all(met)  # as recomputed by the tasks in Python
    yield ik.solve_batch(pepper, ik.HandPosition("left", np.tile(POINT, (3, 1)))).q


def checks(pepper):
    q = states_of(pepper, 300)
    for shift in (0.0, 0.05):
        scene = scene_of(pepper, shift)
        yield collision.in_collision(pepper, q, scene)
        yield fast_checker_for(pepper, scene, 0.01).in_collision(q)
        yield collision.clearance(pepper, q[:4], scene)


def planning(pepper):
    start = pepper.joint_vector(
        {"LShoulderPitch": 1.4, "RShoulderPitch": 1.4, "LElbowRoll": -0.2, "RElbowRoll": 0.2}
    )
    plan = pk.plan(
        pepper, start, [ik.HandPosition("left", POINT)], scene_of(pepper), payload={"left": 0.2}, timeout=60.0
    )
    yield [float(plan.success)]
    yield plan.path


def timing(pepper):
    path = np.array([pepper.neutral(), 0.2 * states_of(pepper, 1)[0]])
    trajectory = pk.retime(pepper, path, payload={"left": 0.2})
    yield [trajectory.duration]
    yield trajectory.coefficients


def twins(pepper):
    q = pepper.neutral()
    twin, batch = Twin(pepper), TwinBatch(pepper, 3)
    twin.reset(q)
    for _ in range(5):
        state = twin.step(q + 0.02)
    yield state.position
    path = np.array([q, pepper.joint_vector({"HeadYaw": 0.1})])
    batch.execute(pk.retime(pepper, path))
    yield batch.position


def sensors(pepper):
    q, still = pepper.neutral(), np.zeros(pepper.n)
    readings = SensorSuite(pepper, seed=1).read(0.0, q, still, still, scene=scene_of(pepper))
    for name in sorted(readings):
        yield np.ravel(np.asarray(readings[name].truth, dtype=float))
    BalanceMonitor(pepper)


def servos(pepper):
    servo = pk.servo.Servo(pepper, pepper.joint_vector({"LShoulderPitch": 1.0}), scene=scene_of(pepper))
    servo.set_target(ik.HandPosition("left", POINT))
    for _ in range(3):
        yield servo.step().q
    online = OnlineMotion(pepper, pepper.neutral())
    online.set_target(pepper.joint_vector({"HeadYaw": 0.3}))
    yield online.step(0.05).position


def optimization(pepper):
    path = np.array([pepper.neutral(), pepper.joint_vector({"LShoulderPitch": 0.4, "HeadYaw": 0.5})])
    yield motion.optimize(pepper, path, scene_of(pepper), timeout=60.0).trajectory.coefficients


KINDS = {
    kind.__name__: kind
    for kind in (
        quantities,
        inverse_kinematics,
        checks,
        timing,
        twins,
        sensors,
        servos,
        planning,
        optimization,
    )
}


def answers(pepper, kinds):
    """Return the numbers of each kind; an error of the library is an answer too."""
    found = {}
    for kind in kinds:
        try:
            parts = [np.ravel(np.asarray(part, dtype=float)) for part in KINDS[kind](pepper)]
            found[kind] = np.concatenate(parts).tolist()
        except pk.PepperKinError as error:
            found[kind] = str(error)
    return found


def main(kinds, *names):
    for name in names:
        short = name.removeprefix("later ")
        if short in ROBOTS:
            robot = ROBOTS[short]()
        else:
            robot = ROBOTS["as it is"]()
            if short != name:
                answers(robot, kinds.split())
            model = robot.pinocchio_model
            IN_PLACE[short](model)
            robot = robot.with_pinocchio_model(model)
        print(json.dumps(answers(robot, kinds.split())), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
