"""Speed of the twin, alone, among things and in batches, against MuJoCo and Pinocchio with the same servos.

python benchmarks/twin.py [--quick]

Peers run in the same process, interleaved; ratios are medians over repeats.  All follow the same movement
without contacts, at steps of 1 ms, and their final states are compared.  With contacts and sensors, time is
also that of the processor, which other programs disturb less.  Prints Markdown.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio
from mujoco import rollout

import pepper_kin as pk
from pepper_kin.jobs import demo_scene, run_demo
from pepper_kin.model.export_mjcf import mjcf_text
from pepper_kin.twin import Recorder, actuator_parameters
from pepper_kin.twin.sensors import SensorSuite
from pepper_kin.twin.world import World

H = 0.001


def movement(pepper: pk.PepperModel) -> pk.Trajectory:
    """Both arms and the head, there and back."""
    away = {
        "LShoulderPitch": 0.4,
        "LElbowRoll": -0.9,
        "RShoulderPitch": 0.6,
        "HeadYaw": 0.6,
        "HipPitch": -0.2,
    }
    stand = pepper.posture("Stand")
    return pk.retime(pepper, [stand, pepper.joint_vector(away), stand], solver="toppra")


class MujocoRobot:
    """The exported robot, which has the twin's servos, without contacts and sensors."""

    def __init__(self, pepper: pk.PepperModel) -> None:
        model = mujoco.MjModel.from_xml_string(mjcf_text(pepper, floor=False))
        assert model.nu == 2 * model.nv == 2 * pepper.n
        model.actuator_ctrllimited[:] = 0
        model.dof_damping[:] = model.dof_armature[:] = 0.0
        model.opt.timestep = H
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_SENSOR
        self.model, self.data = model, mujoco.MjData(model)

    def controls(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Servo targets; MuJoCo compares them with positions at the start of a step."""
        return np.concatenate([position - H * velocity, velocity], axis=-1)

    def loop(self, start: np.ndarray, controls: np.ndarray) -> np.ndarray:
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start
        states = np.empty((len(controls), model.nq))
        for k in range(len(controls)):
            data.ctrl[:] = controls[k]
            mujoco.mj_step(model, data)
            states[k] = data.qpos
        return states

    def batch(self, start: np.ndarray, controls: np.ndarray, count: int) -> np.ndarray:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = start
        state = np.empty(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(self.model, self.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states, _ = rollout.rollout(self.model, [self.data], np.tile(state, (count, 1)), controls[np.newaxis])
        return states


def pinocchio_loop(
    pepper: pk.PepperModel, start: np.ndarray, position: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """The same scheme as the twin's, with the articulated-body algorithm called from Python."""
    servo = actuator_parameters(pepper)
    model = pinocchio.Model(pepper.inner_model)
    data = model.createData()
    model.armature = np.array(model.armature) + H * H * servo.stiffness + H * servo.damping
    q, v, states = start.copy(), np.zeros(pepper.n), np.empty_like(position)
    for k in range(len(position)):
        tau = servo.stiffness * (position[k] - q - H * v) + servo.damping * (velocity[k] - v)
        tau += pinocchio.computeGeneralizedGravity(model, data, q)
        v = v + H * pinocchio.aba(model, data, q, v, tau)
        q = q + H * v
        states[k] = q
    return states


def medians(repeats: int, jobs: dict[str, Callable[[], object]]) -> dict[str, list[float]]:
    """Times of each job [s], taken in turn."""
    for job in jobs.values():
        job()
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            begin = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - begin)
    return times


def table(
    title: str, times: dict[str, list[float]], steps: int, ours: str, asked: float, ratio: float | None
) -> None:
    """Print the time of one step of each job, and how many times as long as ours it takes."""
    print(f"\n{title}\n\n| job | a step [us] | of ours | asked | ok |\n|---|---|---|---|---|")
    for name, values in times.items():
        each = 1e6 * statistics.median(values) / steps
        times_ours = statistics.median(a / b for a, b in zip(values, times[ours], strict=True))
        if name == ours:
            print(f"| **{name}** | {each:.3f} | 1x | {asked} us | {'yes' if each <= asked else '**no**'} |")
        else:
            wanted = "" if ratio is None else f"{ratio:g}x"
            verdict = "" if ratio is None else "yes" if times_ours >= ratio else "**no**"
            print(f"| {name} | {each:.3f} | {times_ours:.1f}x | {wanted} | {verdict} |")


def one(pepper: pk.PepperModel, trajectory: pk.Trajectory, repeats: int) -> None:
    twin, robot = pk.Twin(pepper, H), MujocoRobot(pepper)
    motors = pk.Twin(pepper, H, actuators=actuator_parameters(pepper, "motor"))
    run = twin.execute(trajectory)
    start, steps = run.position[0], len(run) - 1
    q_ref, v_ref = run.reference_position[1:], run.reference_velocity[1:]
    controls = robot.controls(q_ref, v_ref)
    peers = {"MuJoCo": robot.loop(start, controls), "Pinocchio": pinocchio_loop(pepper, start, q_ref, v_ref)}
    far = {name: np.abs(states - run.position[1:]).max() for name, states in peers.items()}
    print(f"Greatest difference from ours over {steps} steps [rad]:", end=" ")
    print(", ".join(f"{name} {difference:.1e}" for name, difference in far.items()))
    times = medians(
        repeats,
        {
            "Twin.execute": lambda: twin.execute(trajectory),
            "Twin.execute, with friction, rotors, encoders": lambda: motors.execute(trajectory),
            "MuJoCo, mj_step from Python": lambda: robot.loop(start, controls),
            "MuJoCo, rollout of one": lambda: robot.batch(start, controls, 1),
            "Pinocchio, ABA from Python": lambda: pinocchio_loop(pepper, start, q_ref, v_ref),
        },
    )
    table("One twin, a trajectory executed in one call:", times, steps, "Twin.execute", 1.5, None)


def many(pepper: pk.PepperModel, trajectory: pk.Trajectory, count: int, steps: int, repeats: int) -> None:
    time_points = H * np.arange(1, steps + 1)
    q_ref, v_ref, _ = trajectory(time_points)
    robot = MujocoRobot(pepper)
    controls, start = robot.controls(q_ref, v_ref), trajectory.start
    few = count // 16
    batch = pk.TwinBatch(pepper, count, H)
    varied = pk.TwinBatch(
        pepper,
        count,
        H,
        vary={
            "stiffness": actuator_parameters(pepper).stiffness * np.linspace(0.8, 1.2, count)[:, np.newaxis]
        },
        mass_scale={joint: np.linspace(0.8, 1.2, count) for joint in pepper.joint_names},
    )

    def ours(batch: pk.TwinBatch, **more: int) -> Callable[[], object]:
        def job() -> object:
            batch.reset(start)
            return batch.follow(q_ref, v_ref, **more)

        return job

    name = "TwinBatch, start and end recorded"
    times = medians(
        repeats,
        {
            name: ours(batch),
            "TwinBatch, every 10th state recorded": ours(batch, every=10),
            "TwinBatch, masses and gains varied": ours(varied),
            "MuJoCo rollout": lambda: robot.batch(start, controls, few),
        },
    )
    times["MuJoCo rollout"] = [t * count / few for t in times["MuJoCo rollout"]]
    title = f"{count} twins, {steps} steps, one thread (MuJoCo: {few}, scaled):"
    print(f"\n{title}\n\n| job | a step [us] | MuJoCo takes | asked | ok |\n|---|---|---|---|---|")
    for job, values in times.items():
        each = 1e6 * statistics.median(values) / steps / count
        ratio = statistics.median(a / b for a, b in zip(times["MuJoCo rollout"], values, strict=True))
        asked = "0.25 us, 20x" if job == name else ""
        verdict = ("yes" if each <= 0.25 and ratio >= 20 else "**no**") if job == name else ""
        print(f"| {job} | {each:.3f} | {ratio:.1f}x | {asked} | {verdict} |")


def leaning(pepper: pk.PepperModel) -> tuple[World, np.ndarray, np.ndarray]:
    """A world in which both arms lean on a wall, beside a table with a free box; start and goal."""
    start = pepper.posture("Stand").copy()
    for side, sign in (("L", 1), ("R", -1)):
        for joint, angle in (
            ("ShoulderPitch", 0.3),
            ("ShoulderRoll", 0.12 * sign),
            ("ElbowRoll", -0.4 * sign),
        ):
            start[pepper.joint_index(side + joint)] = angle
    wrist = pk.kinematics.frame_pose(pepper, start, "l_wrist")[0, 3]
    scene = pk.Scene().add_box("wall", (0.1, 2, 2), (wrist + 0.195, 0, 1))
    world = World(pepper, scene.add_box("table", (0.4, 0.4, 0.04), (-0.8, 0, 0.68)))
    world.add_box("parcel", (0.12, 0.16, 0.14), 0.4, (-0.8, 0, 0.77))
    goal = start.copy()
    goal[pepper.joint_index("HipPitch")] -= 0.03
    return world, start, goal


def among_things(pepper: pk.PepperModel, steps: int, repeats: int) -> None:
    """Print how much faster than time one twin runs with contacts, and with sensors."""
    rows: dict[str, Callable[[], object]] = {}
    by_steps = "`step`, contacts and all sensors but cameras"

    def stepped(twin: pk.Twin, target: np.ndarray, read: bool) -> None:
        start = twin.state.time
        for row in target:
            twin.step(row)
        if read:
            twin.sensors.recorded(start)

    def placed(sensed: bool) -> tuple[pk.Twin, np.ndarray]:
        world, start, goal = leaning(pepper)
        twin = pk.Twin(pepper, H, world=world, sensors=SensorSuite(pepper, world=world) if sensed else None)
        twin.reset(start)
        target = np.tile(goal, (steps, 1))
        twin.follow(target)
        return twin, target

    # Twins of their own, since readings are worked out when they are asked for, by whoever asks.
    for name, sensed in (("contacts", False), ("contacts and all sensors but cameras", True)):
        twin, target = placed(sensed)
        rows[f"`follow`, {name}"] = lambda twin=twin, target=target: twin.follow(target)
    for name, read in (("none read", False), ("all read at the end", True)):
        twin, target = placed(True)
        rows[f"{by_steps}, {name}"] = lambda twin=twin, target=target, read=read: stepped(twin, target, read)
    found = twin.world.contacts
    touching = f"{len(found)} points, {sum(contact.force.any() for contact in found)} of them pressed"
    walls, works = [{name: [] for name in rows} for _ in range(2)]
    for _ in range(repeats):
        for name, job in rows.items():
            wall, work = time.perf_counter(), time.process_time()
            job()
            works[name].append((time.process_time() - work) / steps)
            walls[name].append((time.perf_counter() - wall) / steps)
    print(f"\nOne twin at 1 ms, leaning on a wall beside a free box on a table ({touching}):\n")
    print("| job | a step [us] | of the processor | faster than time | by the processor's | asked | ok |")
    print("|---|---|---|---|---|---|---|")
    for name in rows:
        wall, work = (statistics.median(times[name]) for times in (walls, works))
        asked = 50e-6 if name.startswith(by_steps) else H / 5
        verdict = "yes" if wall <= asked else "**no**"
        print(f"| {name} | {1e6 * wall:.0f} | {1e6 * work:.0f} | {H / wall:.1f}x | {H / work:.1f}x ", end="")
        print(f"| {1e6 * asked:.0f} us | {verdict} |")


def recorded(pepper: pk.PepperModel, seconds: float) -> None:
    """Print the size of a minute of the demonstration's movement, there and back again and again."""
    found = run_demo(pepper).trajectory
    assert found is not None
    there = found(np.arange(H, found.duration, H))
    back = [there[0][::-1], -there[1][::-1], there[2][::-1]]
    rounds = -(-round(seconds / H) // (2 * len(there[0])))
    q, v, a = (
        np.tile(np.concatenate([go, come]), (rounds, 1))[: round(seconds / H)]
        for go, come in zip(there, back, strict=True)
    )
    print(f"\nThe demonstration's movement of {found.duration:.1f} s, over and over, recorded:\n")
    print("| what | a minute [MB] | processor [s] | asked | ok |\n|---|---|---|---|---|")
    for name, sensed in (("commands and states", False), ("and all sensors but cameras", True)):
        twin = pk.Twin(pepper, H, sensors=SensorSuite(pepper, scene=demo_scene()) if sensed else None)
        twin.reset(found.start)
        with tempfile.TemporaryDirectory() as folder:
            recorder, begin = Recorder(twin, folder), time.process_time()
            recorder.follow(q, v, acceleration=a)
            work = time.process_time() - begin
            size = recorder.recording.size * 60 / seconds / 1e6
        each = work * 60 / seconds
        print(f"| {name} | {size:.2f} | {each:.1f} | < 20 MB | {'yes' if size < 20 else '**no**'} |")


def cold() -> None:
    """Print the time of the first step in a process, with and without machine code on disk."""
    code = (
        "import time, pepper_kin as pk; p = pk.load_pepper(); t = pk.Twin(p); "
        "begin = time.perf_counter(); t.step(p.posture('Stand')); print(time.perf_counter() - begin)"
    )
    print("\nFirst step in a process:\n\n| way | time [s] |\n|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        kept = {**os.environ, "PEPPER_KIN_CACHE": folder}
        for name in ("nothing on disk", "machine code on disk"):
            done = subprocess.run(
                [sys.executable, "-c", code],
                capture_output=True, text=True, check=True, env=kept,
            )  # fmt: skip
            print(f"| {name} | {float(done.stdout):.2f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    pepper = pk.load_pepper().with_requirements("limits")
    trajectory = movement(pepper)
    one(pepper, trajectory, 5 if quick else 25)
    many(pepper, trajectory, 4096, 50 if quick else 200, 3 if quick else 9)
    among_things(pepper, 500 if quick else 2000, 3 if quick else 15)
    recorded(pepper, 10.0 if quick else 60.0)
    if not quick:
        cold()


if __name__ == "__main__":
    main()
