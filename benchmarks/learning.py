"""Environments: their rates beside MuJoCo's, their rows beside single twins, their memory."""

import resource
import time
from collections.abc import Iterator

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode
from harness import Times, figures
from mujoco import rollout
from twin import MujocoRobot

import pepper_kin as pk
from pepper_kin.collision import Scene
from pepper_kin.learning import TASKS, Oracle, PepperVectorEnv
from pepper_kin.learning.episode import _TwinBody as TwinBody
from pepper_kin.learning.task import REACH, STEPS
from pepper_kin.model.export_mjcf import mjcf_text
from pepper_kin.twin import Twin, TwinBatch
from pepper_kin.twin.sensors import BatchInertial, BatchRanges
from pepper_kin.twin.world import World

H = 0.001
SAME = AutoresetMode.SAME_STEP
TABLE, TOP = ((0.5, 0.8, 0.05), (0.55, 0.0, 0.675)), 0.7
PARCEL, MASS, PLACE = (0.2, 0.2, 0.15), 0.4, (0.5, 0.0, 0.775)
SENSORS = ("sonar_front", "sonar_back", "laser_right", "laser_front", "laser_left")


class Commands:
    """The cubics to targets as arrays of positions and velocities, for the peers."""

    def __init__(self, pepper, count, speed):
        self.command, self.speed = np.tile(pepper.neutral(), (count, 1)), np.zeros((count, pepper.n))
        self.fastest, self.strongest = speed * pepper.velocity_limits, pepper.acceleration_limits

    def to(self, target):
        way, u = target - self.command, self.speed
        steady = np.maximum(1.5 * np.abs(way) / self.fastest, np.sqrt(3.0 * np.abs(way) / self.strongest))
        duration = np.maximum(np.maximum(steady, np.abs(u) / self.strongest), H)
        t = np.minimum((np.arange(STEPS) + 1)[:, None] * H, duration[:, None])
        second = ((3 * way - 2 * u * duration) / duration**2)[:, None]
        third = ((u * duration - 2 * way) / duration**3)[:, None]
        position = self.command[:, None] + t * (u[:, None] + t * (second + t * third))
        velocity = u[:, None] + t * (2 * second + t * 3 * third)
        self.command, self.speed = position[:, -1].copy(), velocity[:, -1].copy()
        return position, velocity


class MujocoTwins:
    """Robots in MuJoCo, stepped as a `TwinBatch` is."""

    def __init__(self, pepper, count, robot):
        self.pepper, self.count, self.robot, self.timestep = pepper, count, robot, H
        self.commands = None
        self.q, self.v = np.zeros((count, robot.model.nq)), np.zeros((count, robot.model.nv))
        self.home = robot.model.qpos0.copy()
        self.home[: pepper.n] = pepper.neutral()
        self.reset()

    @property
    def position(self):
        return self.q[:, : self.pepper.n].copy()

    @property
    def velocity(self):
        return self.v[:, : self.pepper.n].copy()

    def reset(self, q=None, rows=None):
        rows = np.arange(self.count) if rows is None else rows
        self.q[rows], self.v[rows] = self.home, 0.0
        if q is not None:
            self.q[rows, : self.pepper.n] = q
        if self.commands is not None:
            self.commands.command[rows], self.commands.speed[rows] = self.q[rows, : self.pepper.n], 0.0

    def step(self, targets, steps=STEPS, *, speed=1.0, threads=1):
        if self.commands is None:
            self.commands = Commands(self.pepper, self.count, speed)
        target = np.clip(targets, self.pepper.lower_limits, self.pepper.upper_limits)
        controls = self.robot.controls(*self.commands.to(target))
        state = np.concatenate([np.zeros((self.count, 1)), self.q, self.v], axis=1)
        states, _ = rollout.rollout(self.robot.model, [self.robot.data], state, controls)
        nq = self.q.shape[1]
        self.q, self.v = states[:, -1, 1 : 1 + nq].copy(), states[:, -1, 1 + nq :].copy()
        return np.isfinite(self.q).all(axis=1)


class RolloutEnv(PepperVectorEnv):
    """The same environment on MuJoCo's rollout."""

    def __init__(self, count):
        super().__init__(count, autoreset_mode=SAME)
        self.twins = MujocoTwins(self.pepper, count, MujocoRobot(self.pepper))


class MujocoParcel(MujocoRobot):
    """The robot before a table with a parcel, which it may touch; it does not touch itself."""

    def __init__(self, pepper):
        super().__init__(pepper)
        size, place = TABLE
        half = [" ".join(f"{length / 2:g}" for length in lengths) for lengths in (size, PARCEL)]
        squares = np.square(PARCEL)
        moments = " ".join(f"{MASS / 12 * (squares.sum() - square):g}" for square in squares)
        more = (
            f'<geom name="table" type="box" size="{half[0]}" pos="{" ".join(map(str, place))}"/>'
            f'<body name="parcel" pos="{" ".join(map(str, PLACE))}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="{MASS}" diaginertia="{moments}"/>'
            f'<geom name="parcel" type="box" size="{half[1]}"/></body>'
        )
        text = mjcf_text(pepper, floor=False).replace("</worldbody>", more + "</worldbody>")
        model, alone = mujoco.MjModel.from_xml_string(text), self.model
        model.actuator_ctrllimited[:] = 0
        model.dof_damping[:] = model.dof_armature[:] = 0.0
        model.opt.timestep, model.opt.integrator = H, alone.opt.integrator
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
        things = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in ("table", "parcel")]
        solid = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
        model.geom_contype[solid], model.geom_conaffinity[solid] = 1, 0
        model.geom_contype[things], model.geom_conaffinity[things] = 2, 3
        self.model, self.data = model, mujoco.MjData(model)


def parcel_world(pepper):
    world = World(pepper, Scene().add_box("table", *TABLE))
    world.add_box("parcel", PARCEL, MASS, PLACE)
    return world


def parcel(pepper, rng, count=256):
    """Return environment steps a second with a parcel on a table, ours and MuJoCo's, and the ratio."""
    joints = [pepper.joint_index(name) for name in pepper.resolve_joints("head")]
    ours = TwinBatch(pepper, count, world=parcel_world(pepper))
    theirs = MujocoTwins(pepper, count, MujocoParcel(pepper))
    found = []
    for _ in range(10):
        rates = []
        for twins, steps in ((ours, 12), (theirs, 3)):
            begin = time.process_time()
            for _ in range(steps):
                target = twins.position
                target[:, joints] += rng.uniform(-REACH, REACH, (count, len(joints)))
                twins.step(target, STEPS, speed=0.5)
            rates.append(steps * count / (time.process_time() - begin))
        found.append(rates)
    low = ours.body("parcel").position[:, 2]
    assert np.abs(low - PLACE[2]).max() < 2e-3, "the parcel stays on the table"
    assert np.abs(theirs.q[:, pepper.n + 2] - PLACE[2]).max() < 2e-3
    ours_rate, theirs_rate = np.median(found, axis=0)
    return ours_rate, theirs_rate, np.median([a / b for a, b in found])


class SensingEnv(PepperVectorEnv):
    """Reach with encoders, torques, inertial sensors, sonars and the three lasers among what is observed.

    Sonars and lasers are read ten times a second, as the robot's are.
    """

    def __init__(self, count):
        super().__init__(count, autoreset_mode=SAME)
        scene = Scene().add_box("shelf", (0.3, 2.0, 1.5), (1.2, 0.2, 0.75))
        self.ranges, self.inertial = BatchRanges(self.pepper, scene, SENSORS), BatchInertial(self.pepper)
        self._count, self._far = 0, None

    def step(self, actions):
        before = self.twins.velocity
        observations, *rest = super().step(actions)
        q, v = self.twins.position, self.twins.velocity
        felt = self.inertial.read(q, v, (v - before) / self.period)
        if self._count % 5 == 0:
            self._far = self.ranges.read(q)
        self._count += 1
        seen = [observations, q, self.twins.torque, felt, self._far]
        return (np.concatenate(seen, axis=1).astype(np.float32), *rest)


class SingleEnv(gymnasium.Env):
    """The same environment with calls of `mj_step`, as most are written."""

    def __init__(self):
        self.batch = RolloutEnv(1)
        self.action_space = self.batch.single_action_space
        self.observation_space = self.batch.single_observation_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        found = self.batch.reset(seed=seed)[0][0]
        self.batch.twins.commands = Commands(self.batch.pepper, 1, self.batch.speed)
        return found, {}

    def step(self, action):
        env, robot = self.batch, self.batch.twins.robot
        twins = env.twins
        target = twins.position[0]
        target[env.joints] += REACH * np.clip(action, -1.0, 1.0)
        controls = robot.controls(*twins.commands.to(target[np.newaxis]))[0]
        for row in controls:
            robot.data.ctrl[:] = row
            mujoco.mj_step(robot.model, robot.data)
        twins.q[0], twins.v[0] = robot.data.qpos, robot.data.qvel
        state = env.state
        score = env.task.score(state, env.task.achieved_goal(state), env.task.desired_goal(state))
        return env._observations(state)[0], -float((score.distance + score.cost)[0]), False, False, {}


def rate(env, steps, rng, clock=time.process_time):
    """Return environment steps a second of processor time, or another clock, with random actions."""
    env.reset(seed=0)
    shape = env.action_space.shape
    actions = rng.uniform(-1.0, 1.0, (8, *shape)).astype(np.float32)
    env.step(actions[0])
    begin = clock()
    for k in range(steps):
        env.step(actions[k % 8])
    return steps * shape[0] / (clock() - begin)


def held_targets(pepper, count=1024):
    """Return the time of a step of raw commands, which jump by up to 0.1 rad and saturate the motors [us]."""
    twins, rng, times = pk.TwinBatch(pepper, count), np.random.default_rng(0), Times()
    for _ in range(5):
        target = twins.position + rng.uniform(-0.1, 0.1, (count, pepper.n))
        target = np.repeat(np.clip(target, pepper.lower_limits, pepper.upper_limits)[:, None], STEPS, axis=1)
        times("follow", twins.follow, target)
    return times.at("follow", unit=1e6) / count


def scores():
    """Yield how the oracle and a random policy do in each task."""
    rng = np.random.default_rng(0)
    for name in TASKS:
        env = PepperVectorEnv(256, name, autoreset_mode=SAME)
        shape = env.action_space.shape
        policies = {"oracle": Oracle(env), "random": lambda shape=shape: rng.uniform(-1.0, 1.0, shape)}
        found = {}
        for policy, act in policies.items():
            env.reset(seed=1)
            ends = []
            while len(ends) < 512:
                *_, terminated, truncated, infos = env.step(act())
                ended = terminated | truncated
                if ended.any():
                    ends += infos["final_info"]["is_success"][ended].tolist()
            found[policy] = np.mean(ends)
        yield "task | oracle {:.3f} | random {:.3f}", name, found["oracle"], found["random"]


def rates(rounds, rows):
    """Yield environment steps a second of each task and of the peers."""
    rng = np.random.default_rng(0)
    ours = {name: PepperVectorEnv(rows, name, autoreset_mode=SAME) for name in TASKS}
    ours["with sensors"] = SensingEnv(rows)
    single = gymnasium.vector.SyncVectorEnv([SingleEnv] * 8)
    peers = {"mujoco.rollout": RolloutEnv(256), "SyncVectorEnv": single}
    found = {name: [] for name in (*ours, *peers)}
    for _ in range(rounds):
        for name, env in ours.items():
            found[name].append(rate(env, 10 if name == "Push" else 60, rng))
        for name, env in peers.items():
            found[name].append(rate(env, 12, rng))
    for name, rates in found.items():
        ratio = np.median(np.array(found["Reach"]) / np.array(rates))
        yield (
            "environment | steps a second and core {:.0f} | Reach over it {:.2f}",
            name, np.median(rates), ratio,
        )  # fmt: skip
    pepper = ours["Reach"].pepper
    yield "parcel on a table: {:.0f} beside MuJoCo's {:.0f}: {:.2f} times".format(*parcel(pepper, rng))
    two, one = (PepperVectorEnv(4 * rows, autoreset_mode=SAME, threads=count) for count in (2, 1))
    ratios = [
        np.divide(*(rate(env, 20, rng, time.perf_counter) for env in (two, one))) for _ in range(rounds)
    ]
    yield f"two threads over one: {np.median(ratios):.2f}"
    spent = held_targets(pepper)
    yield f"held random targets of 0.1 rad: {spent:.0f} us, {1e6 / spent:.0f} environment steps/s and core"


def rows_beside_twins(count, steps=10):
    """Yield by how much rows of batches differ from single twins that are sent the same targets."""
    head = "task | rows | most from single twins after 200 ms [rad] {:.1e}"
    for name in TASKS:
        env = PepperVectorEnv(count, name, autoreset_mode="Disabled")
        env.reset(seed=0)
        rng, task, start, batch = np.random.default_rng(0), env.task, env.twins.position, env.twins
        boxes = batch.body("box").position if name == "Push" else None
        sent, step = [], batch.step

        def recorded(targets, steps, *, sent=sent, step=step, **options):
            sent.append((targets.copy(), options))
            return step(targets, steps, **options)

        batch.step = recorded
        for _ in range(steps):
            env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))
        worst = 0.0
        for row in range(count):
            twin = task.twin(env.pepper)
            if name == "Carry":
                mass = float(task.extra_observation(env.state)[row, 2])
                twin = Twin(env.pepper, payload={task.hands[0]: mass})
            own = TwinBody(twin, env.pepper)
            own.reset(start[row])
            if boxes is not None:
                own.place("box", boxes[[row]], rows=None)
            for targets, options in sent:
                load = options.get("load")
                options = options | {"load": None if load is None else load[[row]]}
                own.step(targets[[row]], STEPS, **options)
            worst = max(worst, np.abs(own.position[0] - batch.position[row]).max())
        yield head, name, count, worst
    pepper, rng = pk.load_pepper().with_requirements("limits"), np.random.default_rng(0)
    low, high = pepper.lower_limits, pepper.upper_limits
    batch = TwinBatch(pepper, count, world=parcel_world(pepper))
    targets = np.clip(pepper.neutral() + rng.uniform(-0.3, 0.3, (steps, count, pepper.n)), low, high)
    for target in targets:
        batch.step(target, STEPS)
    worst = 0.0
    for row in range(count):
        own = TwinBody(Twin(pepper, world=parcel_world(pepper)), pepper)
        own.reset()
        for target in targets[:, [row]]:
            own.step(target, STEPS)
        worst = max(worst, np.abs(own.position[0] - batch.position[row]).max())
    yield head, "a parcel", count, worst


def memory(steps, count=1000):
    """Yield how much more memory the process holds after so many environment steps."""
    rng, env = np.random.default_rng(0), PepperVectorEnv(count, autoreset_mode=SAME)
    env.reset(seed=0)
    actions = rng.uniform(-1.0, 1.0, (8, *env.action_space.shape)).astype(np.float32)
    held = []
    for k in range(steps // count):
        env.step(actions[k % 8])
        if k in (200, steps // count - 1):
            held.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    yield f"{steps} environment steps: {held[1] - held[0]:.1f} MiB more than after {200 * count}"


@figures("learning.md", "the extra `learning`", robots=32, rounds=1)
def learning(robots: int = 1024, rounds: int = 5, rows: int = 0, steps: int = 0) -> Iterator[tuple | str]:
    """Environments a second of processor time, beside MuJoCo's rollout.

    One environment step is 20 ms of the twin, with commands shaped, observations, rewards and new episodes.
    The peers do the same task, with the same commands, by `mujoco.rollout` in batches, and as an environment
    of Gymnasium's `SyncVectorEnv` that calls `mj_step`.  Rates are measured in turn; ratios are medians.

    With `rows` as many rows of each task, 1,000 on the page, are compared with single twins instead; with
    `steps` an environment steps so often, ten million times on the page, and its memory is looked at.
    """
    if rows:
        yield from rows_beside_twins(rows)
    elif steps:
        yield from memory(steps)
    else:
        yield from scores()
        yield from rates(rounds, robots)
