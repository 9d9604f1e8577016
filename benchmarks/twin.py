"""The twin: steps, contacts, sensors, and motions beside MuJoCo."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator

import mujoco
import numpy as np
import pinocchio
from harness import both_clocks, example_robot, figures, in_turn, table, timed
from mujoco import rollout

import pepper_kin as pk
from pepper_kin.jobs import demo_scene, run_demo
from pepper_kin.model.export_mjcf import mjcf_text
from pepper_kin.twin import Recorder, Twin, actuator_parameters
from pepper_kin.twin.sensors import Camera, RobotRays, SensorSuite
from pepper_kin.twin.world import World

H = 0.001


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


def pinocchio_loop(pepper, start, position, velocity) -> np.ndarray:
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


def one(pepper: pk.PepperModel, trajectory: pk.Trajectory, repeats: int) -> Iterator[tuple | str]:
    twin, robot = pk.Twin(pepper, H), MujocoRobot(pepper)
    motors = pk.Twin(pepper, H, actuators=actuator_parameters(pepper, "motor"))
    run = twin.execute(trajectory)
    start, steps = run.position[0], len(run) - 1
    q_ref, v_ref = run.reference_position[1:], run.reference_velocity[1:]
    controls = robot.controls(q_ref, v_ref)
    peers = {"MuJoCo": robot.loop(start, controls), "Pinocchio": pinocchio_loop(pepper, start, q_ref, v_ref)}
    far = (f"{name} {np.abs(found - run.position[1:]).max():.1e}" for name, found in peers.items())
    yield f"Greatest difference from ours over {steps} steps [rad]: {', '.join(far)}"
    jobs = {
        "Twin.execute": lambda: twin.execute(trajectory),
        "Twin.execute, with friction, rotors, encoders": lambda: motors.execute(trajectory),
        "MuJoCo, mj_step from Python": lambda: robot.loop(start, controls),
        "MuJoCo, rollout of one": lambda: robot.batch(start, controls, 1),
        "Pinocchio, ABA from Python": lambda: pinocchio_loop(pepper, start, q_ref, v_ref),
    }
    times = in_turn(jobs, repeats, time.perf_counter)
    yield "One twin, a trajectory executed in one call:"
    for name, spent in times.items():
        each, first = 1e6 * np.median(spent) / steps, name == "Twin.execute"
        ratio = np.median(spent / times["Twin.execute"])
        yield (
            "job | a step [us] {:.3f} | of ours {:.1f}x | asked | ok",
            name, each, ratio, "1.5 us" if first else "", each <= 1.5 if first else "",
        )  # fmt: skip


def many(pepper, trajectory, count, steps, repeats) -> Iterator[tuple | str]:
    q_ref, v_ref, _ = trajectory(H * np.arange(1, steps + 1))
    robot = MujocoRobot(pepper)
    controls, start = robot.controls(q_ref, v_ref), trajectory.start
    few, spread = count // 16, np.linspace(0.8, 1.2, count)
    batch = pk.TwinBatch(pepper, count, H)
    stiffness = actuator_parameters(pepper).stiffness * spread[:, np.newaxis]
    scales = {joint: spread for joint in pepper.joint_names}
    varied = pk.TwinBatch(pepper, count, H, vary={"stiffness": stiffness}, mass_scale=scales)

    def ours(batch: pk.TwinBatch, **more: int) -> object:
        batch.reset(start)
        return batch.follow(q_ref, v_ref, **more)

    first, peer = "TwinBatch, start and end recorded", "MuJoCo rollout"
    jobs = {
        first: lambda: ours(batch),
        "TwinBatch, every 10th state recorded": lambda: ours(batch, every=10),
        "TwinBatch, masses and gains varied": lambda: ours(varied),
        peer: lambda: robot.batch(start, controls, few),
    }
    times = in_turn(jobs, repeats, time.perf_counter)
    times[peer] *= count / few
    yield f"{count} twins, {steps} steps, one thread (MuJoCo: {few}, scaled):"
    for job, spent in times.items():
        each, ratio = 1e6 * np.median(spent) / steps / count, np.median(times[peer] / spent)
        asked = ("0.25 us, 20x", bool(each <= 0.25 and ratio >= 20)) if job == first else ("", "")
        yield "job | a step [us] {:.3f} | MuJoCo takes {:.1f}x | asked | ok", job, each, ratio, *asked


def leaning(pepper: pk.PepperModel) -> tuple[World, np.ndarray, np.ndarray]:
    """A world in which both arms lean on a wall, beside a table with a free box; start and goal."""
    start = pepper.posture("Stand").copy()
    for side, sign in (("L", 1), ("R", -1)):
        angles = {"ShoulderPitch": 0.3, "ShoulderRoll": 0.12 * sign, "ElbowRoll": -0.4 * sign}
        for joint, angle in angles.items():
            start[pepper.joint_index(side + joint)] = angle
    wrist = pk.kinematics.frame_pose(pepper, start, "l_wrist")[0, 3]
    scene = pk.Scene().add_box("wall", (0.1, 2, 2), (wrist + 0.195, 0, 1))
    world = World(pepper, scene.add_box("table", (0.4, 0.4, 0.04), (-0.8, 0, 0.68)))
    world.add_box("parcel", (0.12, 0.16, 0.14), 0.4, (-0.8, 0, 0.77))
    goal = start.copy()
    goal[pepper.joint_index("HipPitch")] -= 0.03
    return world, start, goal


def among_things(pepper: pk.PepperModel, steps: int, repeats: int) -> Iterator[tuple | str]:
    """Yield how much faster than time one twin runs with contacts, and with sensors."""
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
    times = in_turn(rows, repeats, both_clocks)
    yield f"One twin at 1 ms, leaning on a wall beside a free box on a table ({touching}):"
    for name in rows:
        wall, work = np.median(times[name], axis=0) / steps
        asked = 50e-6 if name.startswith(by_steps) else H / 5
        yield (
            "job | a step [us] {:.0f} | of the processor {:.0f} | faster than time {:.1f}x | by the "
            "processor's {:.1f}x | asked {:.0f} us | ok",
            name, 1e6 * wall, 1e6 * work, H / wall, H / work, 1e6 * asked, wall <= asked,
        )  # fmt: skip


def recorded(pepper: pk.PepperModel, seconds: float) -> Iterator[tuple | str]:
    """Yield the size of a minute of the demonstration's movement, there and back again and again."""
    found = run_demo(pepper).trajectory
    assert found is not None
    there = found(np.arange(H, found.duration, H))
    back = [there[0][::-1], -there[1][::-1], there[2][::-1]]
    rounds = -(-round(seconds / H) // (2 * len(there[0])))
    q, v, a = (
        np.tile(np.concatenate([go, come]), (rounds, 1))[: round(seconds / H)]
        for go, come in zip(there, back, strict=True)
    )
    yield f"The demonstration's movement of {found.duration:.1f} s, over and over, recorded:"
    for name, sensed in (("commands and states", False), ("and all sensors but cameras", True)):
        twin = pk.Twin(pepper, H, sensors=SensorSuite(pepper, scene=demo_scene()) if sensed else None)
        twin.reset(found.start)
        with tempfile.TemporaryDirectory() as folder:
            recorder = Recorder(twin, folder)
            _, work = timed(recorder.follow, q, v, acceleration=a)
            size = recorder.recording.size * 60 / seconds / 1e6
        yield (
            "what | a minute [MB] {:.2f} | processor [s] {:.1f} | asked | ok",
            name, size, work * 60 / seconds, "< 20 MB", size < 20,
        )  # fmt: skip


@figures("benchmarks/twin.md", steps=500, seconds=10.0, rounds=3)
def twin(steps: int = 2000, seconds: float = 60.0, rounds: int = 9) -> Iterator[tuple | str]:
    """Speed of the twin, alone, among things and in batches, beside MuJoCo and Pinocchio.

    Peers run in the same process, interleaved; ratios are medians over repeats.  All follow the same movement
    without contacts, at steps of 1 ms, and their final states are compared.  With contacts and sensors, time
    is also that of the processor, which other programs disturb less.
    """
    pepper = pk.load_pepper().with_requirements("limits")
    away = dict(LShoulderPitch=0.4, LElbowRoll=-0.9, RShoulderPitch=0.6, HeadYaw=0.6, HipPitch=-0.2)
    stand = pepper.posture("Stand")
    trajectory = pk.retime(pepper, [stand, pepper.joint_vector(away), stand], solver="toppra")
    yield from one(pepper, trajectory, 2 * rounds + rounds // 2 + 3)
    yield from many(pepper, trajectory, 4096, steps // 10, rounds)
    yield from among_things(pepper, steps, rounds + rounds // 2 + 2)
    yield from recorded(pepper, seconds)


SECONDS = 2.0  # simulated, for the suite at its own rates


def rays_of_mujoco(pepper: pk.PepperModel, q: np.ndarray, origin: np.ndarray, directions: np.ndarray):
    """Return a function that casts the rays at the drawn body by MuJoCo, all in one call."""
    model = mujoco.MjModel.from_xml_string(pepper.export("mjcf"))
    model.geom_group[model.geom_type != mujoco.mjtGeom.mjGEOM_MESH] = 5
    data = mujoco.MjData(model)
    for name, value in zip(pepper.joint_names, q, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = value
    groups, count = np.array([1, 1, 1, 1, 1, 0], dtype=np.uint8), len(directions)
    geom, distance = np.empty(count, dtype=np.int32), np.empty(count)

    def cast() -> np.ndarray:
        mujoco.mj_kinematics(model, data)
        arguments = [groups, 1, -1, geom, distance]
        if "normal" in (mujoco.mj_multiRay.__doc__ or ""):
            arguments.append(None)
        mujoco.mj_multiRay(model, data, origin, directions.ravel(), *arguments, count, 100.0)
        return distance

    return cast


@figures("benchmarks/twin.md", rounds=3)
def sensors(rounds: int = 15) -> Iterator[tuple | str]:
    """Sensors: what a reading costs, and rays beside MuJoCo's in the same run."""
    pepper = pk.load_pepper()
    scene = (
        pk.Scene()
        .add_box("table", (0.6, 1.0, 0.04), (0.9, 0.0, 0.7))
        .add_sphere("ball", 0.08, (0.8, 0.1, 0.8))
        .add_box("wall", (0.1, 3.0, 2.0), (2.0, 0.0, 1.0))
    )
    q = pepper.joint_vector({"HeadPitch": 0.3, "LShoulderPitch": 0.3, "LElbowRoll": -1.0})
    suite, timed, clock = SensorSuite(pepper), SensorSuite(pepper), iter(range(10**6))

    def everything() -> None:
        k = next(clock)
        suite.read(float(k), q + 1e-6 * k, scene=scene)

    def at_their_rates() -> None:
        timed.reset()
        for step in range(int(SECONDS * 1000)):
            timed.read(step * 0.001, q, scene=scene)

    depth, color = Camera(pepper, "camera_depth"), Camera(pepper, "camera_top")
    grid = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 320), np.linspace(-0.6, 0.6, 240)), -1).reshape(-1, 2)
    origin = np.array([1.5, 0.0, 0.7])
    directions = np.column_stack([-np.ones(len(grid)), grid])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    body = RobotRays(pepper, "visual", floor=False)
    theirs = rays_of_mujoco(pepper, q, origin, directions)
    jobs: dict[str, Callable[[], object]] = {
        f"{len(suite.names)} sensors read once, without cameras": everything,
        f"{SECONDS:g} s of 1 ms steps, each sensor at its rate": at_their_rates,
        "depth picture, 320 x 240": lambda: depth.depth(q, scene),
        "color picture, 320 x 240": lambda: color.color(q, scene),
        "76 800 rays at the drawn body": lambda: body.distances(q, None, origin, directions),
        "the same rays by MuJoCo": theirs,
    }
    for name, spent in in_turn(jobs, rounds, both_clocks).items():
        yield "job | wall {:.2f} ms | processor {:.2f} ms", name, *1e3 * np.median(spent, axis=0)
    ours, other = body.distances(q, None, origin, directions), theirs()
    other = np.where(other < 0, np.inf, other)
    with np.errstate(invalid="ignore"):
        same = (ours == other) | (np.abs(ours - other) < 1e-5)
    yield f"{same.mean():.2%} of the rays agree to 1e-5 m; {np.isfinite(ours).mean():.1%} meet the body."


ROUNDS, STEPS = 20, 100


def stack(levels, solver):
    """Boxes on a floor, one on another; none: one box high in the air."""
    world = World(None, pk.Scene().add_half_space("floor", (0, 0, 1)), solver=solver)
    for k in range(max(levels, 1)):
        height = 0.05 + 0.1 * k if levels else 500.0
        world.add_box(f"box {k}", (0.1, 0.1, 0.1), 0.2, (0, 0, height), (0, 0, 0.2 * k))
    return lambda: world.advance_alone(H), world


def before_wall(points):
    """Pepper with its hands before a wall: far from it, or leaning on it."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand").copy()
    for side, sign in (("L", 1), ("R", -1)):
        q[pepper.joint_index(f"{side}ShoulderPitch")] = 0.3
        q[pepper.joint_index(f"{side}ElbowRoll")] = -0.4 * sign
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[0, 3]
    wall = hand + 0.195 if points else hand + 0.5
    world = World(pepper, pk.Scene().add_box("wall", (0.1, 2, 2), (wall, 0, 1)))
    twin = Twin(pepper, H, world=world)
    twin.reset(q)
    q[pepper.joint_index("HipPitch")] -= 0.03
    for _ in range(400):
        twin.step(q)
    state = twin.state
    mass, force = twin._integrator.linearized(
        state.position, state.velocity, q, np.zeros(pepper.n), twin._integrator.gravity_torque(state.position)
    )
    return lambda: world.advance(state.position, state.velocity, mass, force, H), world


@figures("benchmarks/twin.md", rounds=2)
def contacts(rounds: int = ROUNDS) -> Iterator[tuple]:
    """Time of one step of a world: with 0, 4 and 12 contact points, by either solver, and with the robot.

    Cases are run in turns, and medians compared, so that a busy machine disturbs all of them alike.  Every
    case also says that it rests: the greatest speed of a body that should not move (one in the air falls).
    """
    solvers = "compiled", "proxsuite"
    cases = {f"{4 * k} points, {solver}": stack(k, solver) for k in (0, 1, 3) for solver in solvers}
    cases |= {"robot, nothing near": before_wall(False), "robot, hands on a wall": before_wall(True)}
    jobs = {name: lambda step=step: [step() for _ in range(STEPS)] for name, (step, _) in cases.items()}
    times = in_turn(jobs, rounds, time.perf_counter)
    for name, (_, world) in cases.items():
        speed = max((np.abs(body.velocity).max() for body in world.bodies.values()), default=0.0)
        each = 1e6 * np.median(times[name]) / STEPS
        yield (
            "case | us a step {:.1f} | points | fastest body [m/s] {:.1e}",
            name, each, len(world.contacts), speed,
        )  # fmt: skip


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
    return pk.retime(pepper, pk.plan(pepper, pepper.posture("Stand"), tasks, table(), seed=0))


def between_random_states(robot: pk.PepperModel) -> pk.Trajectory:
    """Return a planned motion of all joints between two configurations that touch nothing."""
    low, high = np.maximum(robot.lower_limits, -1.0), np.minimum(robot.upper_limits, 1.0)
    states = np.random.default_rng(0).uniform(low, high, (200, robot.n))
    free = states[~pk.collision.in_collision(robot, states)]
    return pk.retime(robot, pk.plan(robot, free[0], free[1], seed=0), acceleration_limits=5.0)


@figures("benchmarks/twin.md", motions=1)
def mujoco_motions(motions: int = 9) -> Iterator[tuple | str]:
    """The same motions on the twin and in MuJoCo, which steps the exported robot: greatest distances.

    MuJoCo is commanded as the recipe "Play a motion in MuJoCo" says, with the file as it is exported: servos,
    gravity compensation, contacts with itself, stops; without the floor, in which other robots' bases stand.
    """
    pepper, full = pk.load_pepper(), pk.load_pepper(base="planar", hands="mimic")
    robots = {f"{name}, a plan of all joints": example_robot(name) for name in ("panda", "ur5")}
    drive = dict(BaseX=0.5, BaseY=0.2, BaseYaw=0.8, HipPitch=-0.2, LShoulderPitch=0.4, LHand=0.1)
    gesture = pk.motion.gesture
    ends = [full.posture("Stand"), full.joint_vector(drive)]
    made = [
        ("gesture: wave", pepper, lambda: gesture(pepper, "wave")),
        ("gesture: wave, half tempo", pepper, lambda: gesture(pepper, "wave", tempo=0.5)),
        ("gesture: bow (whole body)", pepper, lambda: gesture(pepper, "bow")),
        ("gesture: here-you-are, with hands", full, lambda: gesture(full, "here-you-are")),
        ("planned reach over a table", pepper, lambda: reach(pepper, (0.4, 0.2, 0.85))),
        ("another reach", pepper, lambda: reach(pepper, (0.45, -0.1, 0.9))),
        ("driving, bowing, opening a hand", full, lambda: pk.retime(full, ends)),
        *((what, robot, lambda robot=robot: between_random_states(robot)) for what, robot in robots.items()),
    ]
    yield f"MuJoCo {mujoco.__version__}; greatest distance of a joint from the twin's [mrad or mm]"
    for what, robot, make in made[:motions]:
        motion = make()
        (apart, end), (coarse, _) = (distance(robot, motion, h) for h in (0.001, 0.002))
        yield (
            "motion | duration [s] {:.2f} | h = 1 ms {:.2f} | at the end {:.4f} | h = 2 ms {:.2f} | asked "
            "{:g} | ok",
            what, motion.duration, apart, end, coarse, ASKED, apart <= ASKED,
        )  # fmt: skip
