"""The same motions on the twin and in MuJoCo, which steps the exported robot: greatest distance of a joint.

    python benchmarks/mujoco_motions.py

MuJoCo is commanded as the recipe "Play a motion in MuJoCo" says, with the file as it is exported: servos,
gravity compensation, contacts with itself, stops; without the floor, in which other robots' bases stand.
"""

import mujoco
import numpy as np
from collision_verdicts import robot_of

import pepper_kin as pk
from pepper_kin.model.export_mjcf import mjcf_text

TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
ASKED = 10.0  # [mrad or mm]
HOLD = 0.3  # [s]


def distance(robot: pk.PepperModel, motion: pk.Trajectory, timestep: float) -> tuple[float, float]:
    """Return the greatest distances of twin and MuJoCo, on the way and at its end [mrad or mm]."""
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot, floor=False))
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    places = [model.joint(name).qposadr[0] for name in robot.joint_names]
    every = [model.joint(name).qposadr[0] for name in list(robot.inner_model.names)[1:]]
    run = pk.Twin(robot, timestep).execute(motion, hold_time=HOLD)
    data.qpos[every] = robot.to_full(motion.start)
    found = np.empty((len(run.time) - 1, robot.n))
    for row in found:
        state = motion(min(data.time, motion.duration))
        data.ctrl[:] = np.concatenate([state.position, state.velocity])
        mujoco.mj_step(model, data)
        row[:] = data.qpos[places]
    apart = 1e3 * np.abs(found - run.position[1:])
    return float(apart.max()), float(apart[-1].max())


def reach(pepper: pk.PepperModel, point: tuple[float, float, float]) -> pk.Trajectory:
    tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
    return pk.retime(pepper, pk.plan(pepper, pepper.posture("Stand"), tasks, TABLE, seed=0))


def between_random_states(robot: pk.PepperModel) -> pk.Trajectory:
    """Return a planned motion of all joints between two configurations that touch nothing."""
    low, high = np.maximum(robot.lower_limits, -1.0), np.minimum(robot.upper_limits, 1.0)
    states = np.random.default_rng(0).uniform(low, high, (200, robot.n))
    free = states[~pk.collision.in_collision(robot, states)]
    return pk.retime(robot, pk.plan(robot, free[0], free[1], seed=0), acceleration_limits=5.0)


def main() -> None:
    """Print the table."""
    pepper = pk.load_pepper()
    everything = pk.load_pepper(base="planar", hands="mimic")
    drive = {
        "BaseX": 0.5,
        "BaseY": 0.2,
        "BaseYaw": 0.8,
        "HipPitch": -0.2,
        "LShoulderPitch": 0.4,
        "LHand": 0.1,
    }
    motions = [
        ("gesture: wave", pepper, pk.motion.gesture(pepper, "wave")),
        ("gesture: wave, half tempo", pepper, pk.motion.gesture(pepper, "wave", tempo=0.5)),
        ("gesture: bow (whole body)", pepper, pk.motion.gesture(pepper, "bow")),
        ("gesture: here-you-are, with hands", everything, pk.motion.gesture(everything, "here-you-are")),
        ("planned reach over a table", pepper, reach(pepper, (0.4, 0.2, 0.85))),
        ("another reach", pepper, reach(pepper, (0.45, -0.1, 0.9))),
        (
            "driving, bowing, opening a hand", everything,
            pk.retime(everything, [everything.posture("Stand"), everything.joint_vector(drive)]),
        ),
    ]  # fmt: skip
    for name in ("panda", "ur5"):
        robot = robot_of(name, None)
        motions.append((f"{name}, a plan of all joints", robot, between_random_states(robot)))
    print(f"MuJoCo {mujoco.__version__}; greatest distance of a joint from the twin's [mrad or mm]\n")
    print("| motion | duration [s] | h = 1 ms | at the end | h = 2 ms | asked | ok |\n|" + 7 * "---|")
    for what, robot, motion in motions:
        (apart, end), (coarse, _) = (distance(robot, motion, h) for h in (0.001, 0.002))
        ok = "yes" if apart <= ASKED else "**no**"
        print(
            f"| {what} | {motion.duration:.2f} | {apart:.2f} | {end:.4f} | {coarse:.2f} | {ASKED:g} | {ok} |"
        )


if __name__ == "__main__":
    main()
