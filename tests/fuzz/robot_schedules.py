"""Random schedules of what goes wrong while a simulated robot moves, and the laws that hold all the same."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any
from unittest import mock

import numpy as np
from simulated_robot import FakeQi, Network, SimulatedRobot, World
from simulated_ros import SimulatedTransport

import pepper_kin as pk
from pepper_kin.exceptions import PepperKinError
from pepper_kin.naoqi import Robot, RobotMotionResult, RobotMotionStatus
from pepper_kin.naoqi.link import RobotLink
from pepper_kin.ros import RobotClient, RobotNode
from pepper_kin.supervision import MotionState, Supervisor

METHODS = ("stream", "bezier", "base", "drive", "move_to", "ros")

STATES = (MotionState.CHECKING, MotionState.HANDED_OVER, MotionState.MOVING, MotionState.STOPPING)

LOST = ("kill", "freeze", "cut", "other stop")
"""Ends of which a robot without a watchdog knows nothing."""

ENDS = ("stop", "stop twice", "interrupt", "interrupts", *LOST, "kill all", "none")
"""What ends a motion, at a time after one of its states began."""

DAMAGES = (
    "none",
    "none",
    "nan",
    "none values",
    "short",
    "text",
    "not a list",
    "infinite",
    "error",
)
"""What happens to the states that the robot reports from then on."""

CHECK = 0.3
"""Time that the certificate takes [s]."""

REST = 0.5
"""Time from the order to stop in which arms are at rest [s]."""

STILL = 6e-3
"""By how much a robot at rest may move: what encoders and the twin's springs do [rad, m]."""


@dataclass
class Schedule:
    """What goes wrong."""

    method: str
    guarded: bool
    end: str
    state: MotionState
    after: float
    damage: str
    damaged_for: float
    base_delay: float
    spikes: float
    longest: float
    lost: float
    doubled: float
    slow: dict[str, float]
    seed: int
    notes: list[str] = field(default_factory=list)


def schedule_of(method: str, rng: np.random.Generator) -> Schedule:
    """Return a random schedule."""
    guarded = bool(rng.random() < 0.7)
    ends = ENDS if guarded else [end for end in ENDS if end not in LOST]
    slow = {}
    if rng.random() < 0.4:
        lasting = {"bezier": "angleInterpolationBezier", "move_to": "moveTo", "stream": "setAngles"}
        slow[lasting.get(method, "move")] = 0.05
        if method in ("bezier", "move_to", "ros"):
            slow[lasting.get(method, "goal")] = float(rng.choice([0.05, 0.3, 1.0, 2.0]))
    schedule = Schedule(
        method,
        guarded,
        str(rng.choice(ends)),
        STATES[rng.integers(len(STATES))],
        float(rng.choice([0.0, 0.01, 0.05, rng.uniform(0.0, 0.6)])),
        str(rng.choice(DAMAGES)),
        float(rng.choice([0.05, 0.3, 1.0, 100.0])),
        float(rng.uniform(0.0005, 0.01)),
        float(rng.choice([0.0, 0.0, 0.01, 0.1])),
        float(rng.choice([0.2, 0.6, 3.0])),
        float(rng.choice([0.0, 0.0, 0.0, 0.01])),
        float(rng.choice([0.0, 0.0, 0.05])),
        slow,
        int(rng.integers(2**31)),
    )
    # Only the watchdog's numbers tell a call from its double.  ALMotion's own calls have none, nor does TCP
    # double any: a robot without a watchdog would drive on by a double that comes after rest was measured.
    return schedule if guarded else replace(schedule, doubled=0.0)


class Motions:
    """The motions that are made, certified once."""

    def __init__(self) -> None:
        pepper = pk.load_pepper()
        q = pepper.posture("Stand")
        goal = q.copy()
        for name, value in (("LShoulderPitch", -0.5), ("HeadYaw", 0.4), ("RElbowRoll", 0.5)):
            goal[pepper.joint_index(name)] += value
        self.arms = pk.retime(pepper, np.array([q, goal]), velocity_scale=0.5)
        planar = pk.load_pepper(base="planar")
        q = planar.posture("Stand")
        goal = q.copy()
        goal[:3] = (0.2, 0.0, 0.3)
        goal[planar.joint_index("HeadYaw")] += 0.3
        self.base = pk.retime(planar, np.array([q, goal]))
        for trajectory, robot in ((self.arms, pepper), (self.base, planar)):
            assert trajectory.check(robot).success
        self.curves, self.points = pk.files.naoqi_arguments(self.arms), pk.files.ros_points(self.arms)


@dataclass
class Outcome:
    """What came of a schedule: result or error, when, and what is wrong with it."""

    result: RobotMotionResult | None
    error: str
    wrong: list[str]
    states: list[MotionState]


def run(
    schedule: Schedule, motions: Motions, watch: Callable[[str, tuple[Any, ...]], object] | None = None
) -> Outcome:
    """Make the motion of a schedule, and see whether the laws hold; `watch` gets all calls of ALMotion."""
    random = np.random.default_rng(schedule.seed)
    world = World()
    robot = SimulatedRobot(world, watchdog=schedule.guarded)
    robot.motion.watch = watch
    network = Network(world, robot)
    case = (_RosCase if schedule.method == "ros" else _Case)(schedule, world, robot, network, random)
    try:
        with case.patched(motions):
            return case.run(motions)
    finally:
        world.forget()


class _Case:
    def __init__(
        self,
        schedule: Schedule,
        world: World,
        robot: SimulatedRobot,
        network: Network,
        random: np.random.Generator,
    ) -> None:
        self.schedule, self.world, self.robot, self.network, self.random = (
            schedule,
            world,
            robot,
            network,
            random,
        )
        self.states: list[MotionState] = []
        self.caused: float | None = None
        self.client: Any = None
        self.ghost, self.over = False, False
        self.frozen_until = 0.0
        self.ordered: float | None = None

    @contextlib.contextmanager
    def patched(self, motions: Motions) -> Iterator[None]:
        """Let `Robot` use this network and time."""

        def supervisor(motion: Any, clock: Any) -> Supervisor:
            return Supervisor(motion, clock, self.begin_state)

        with (
            mock.patch("pepper_kin.naoqi.link.libqi", return_value=FakeQi(self.network)),
            mock.patch.object(RobotLink, "_look_for", return_value=None),
            mock.patch("pepper_kin.naoqi.robot.Clock", return_value=self),
            mock.patch("pepper_kin.naoqi.robot.Supervisor", supervisor),
            mock.patch("pepper_kin.naoqi.robot.refuse_unsafe", self.certify),
            mock.patch("pepper_kin.naoqi.robot.naoqi_arguments", return_value=motions.curves),
        ):
            yield

    def certify(self, *_: Any, **__: Any) -> None:
        """Take the time of a certificate."""
        self.sleep(CHECK)

    def now(self) -> float:
        """Return the client's time [s]."""
        return self.world.time

    def sleep(self, seconds: float) -> None:
        """Let the client wait, and longer where it is frozen [s]."""
        self.world.sleep(max(seconds, self.frozen_until - self.world.time))

    def begin_state(self, state: MotionState) -> None:
        """Note a state, and let go wrong what is scheduled for it."""
        self.states.append(state)
        if state is self.schedule.state and self.caused is None:
            self.caused = self.world.time + self.schedule.after
            self.world.at(self.caused, self.go_wrong)

    def go_wrong(self) -> None:
        """Do what the schedule says."""
        schedule, world = self.schedule, self.world
        assert self.client is not None
        if schedule.damage != "none":
            self.network.damage = self.damaged
            until = world.time + schedule.damaged_for
            world.at(until, lambda: setattr(self.network, "damage", lambda module, method, value: value))
        if schedule.end in ("stop", "stop twice"):
            for k in range(1 + (schedule.end == "stop twice")):
                world.at(world.time + 0.3 * k, lambda: world.spawn(self.stop))
        elif schedule.end in ("interrupt", "interrupts"):
            for k in range(1 + 2 * (schedule.end == "interrupts")):
                world.at(world.time + 0.1 * k, lambda: self.interrupt())
        elif schedule.end == "kill":
            self.network.dead = self.ghost = True
        elif schedule.end == "freeze":
            self.frozen_until = world.time + float(self.random.uniform(0.2, 3.0))
        elif schedule.end == "cut":
            self.network.disconnect()
            self.network.dead = True
        elif schedule.end == "other stop":
            world.spawn(self.stop_by_another)
        elif schedule.end == "kill all":
            world.spawn(self.robot.broker.motion.killAll)

    def stop(self) -> None:
        """Call `stop` on another thread."""
        with contextlib.suppress(PepperKinError):
            self.client.stop()

    def interrupt(self) -> None:
        """Press Ctrl-C, as long as the client runs."""
        if MotionState.AT_REST not in self.states and not self.over:
            signal.raise_signal(signal.SIGINT)

    def stop_by_another(self) -> None:
        """Let another client call `stop`."""
        qi = FakeQi(Network(self.world, self.robot))
        with mock.patch("pepper_kin.naoqi.link.libqi", return_value=qi), Robot("tcp://same:9559") as other:
            other.stop()

    def damaged(self, module: str, method: str, value: Any) -> Any:
        """Return the damaged answer about a state."""
        if method not in ("getListData", "getRobotPosition") or not isinstance(value, list):
            return value
        damage = self.schedule.damage
        if damage == "error":
            raise RuntimeError(f"{module}::{method}\n\tdamaged")
        return {
            "nan": [float("nan")] * len(value),
            "none values": [None] * len(value),
            "short": value[:2],
            "text": ["x"] * len(value),
            "not a list": None,
            "infinite": [float("inf")] * len(value),
        }[damage]

    def delay(self) -> float:
        """Return the time that a message takes [s]."""
        schedule, random = self.schedule, self.random
        if random.random() < schedule.lost:
            return float("inf")
        if random.random() < schedule.spikes:
            return float(random.uniform(0.02, schedule.longest))
        return float(schedule.base_delay * random.uniform(0.5, 2.0))

    def run(self, motions: Motions) -> Outcome:
        """Make the motion, then look on until nothing can move any more."""
        schedule, world, robot = self.schedule, self.world, self.robot
        self.connect()
        self.watch_orders()
        self.network.delay = self.delay
        self.network.twice = lambda: bool(self.random.random() < schedule.doubled)
        robot.motion.delays.update(schedule.slow)
        result, error, wrong = None, "", []
        handler = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            result = self.move(motions)
        except KeyboardInterrupt:
            error = "KeyboardInterrupt"
            if "interrupt" not in schedule.end:
                wrong.append("KeyboardInterrupt, and nobody pressed Ctrl-C")
        except PepperKinError as failure:
            error = f"{type(failure).__name__}: {failure}"
            if len(self.states) > 1:
                wrong.append(f"an error of a motion that had begun: {error}")
        except Exception as failure:  # what must not be
            error = f"{type(failure).__name__}: {failure}"
            wrong.append(f"raw error: {error}")
        finally:
            self.over = True
            signal.signal(signal.SIGINT, handler)
        returned = world.time
        self.network.delay = lambda: 0.002 if self.network.connected else float("inf")
        end = world.time + 12.0
        world.block(lambda: robot.inactive and world.time > returned + 0.3, end - world.time)
        if not robot.inactive:
            wrong.append("the robot is not inactive 12 s later")
        wrong += self.broken(result, error, returned)
        return Outcome(result, error, wrong, self.states)

    def connect(self) -> None:
        """Make the client."""
        self.client = Robot("tcp://simulated:9559", timeout=3.0)

    def move(self, motions: Motions) -> RobotMotionResult:
        """Make the motion."""
        assert self.client is not None
        method, guarded = self.schedule.method, self.schedule.guarded
        if method in ("stream", "bezier"):
            return self.client.follow(motions.arms, method=method, unguarded=not guarded)
        if method == "base":
            return self.client.follow(motions.base, unguarded=not guarded)
        if method == "drive":
            return self.client.drive([0.2, 0.05, 0.3], 0.6, unguarded=not guarded)
        return self.client.move_to([0.15, 0.0, 0.2], unguarded=not guarded)

    def order(self) -> None:
        """Note the first order to stop since the motion was handed over."""
        if self.ordered is None and MotionState.HANDED_OVER in self.states:
            self.ordered = self.world.time

    def watch_orders(self) -> None:
        """Note when the robot is first told to stop."""
        watchdog, motion = self.robot.watchdog, self.robot.broker.motion
        ending, hold = watchdog._end, type(motion).killTasksUsingResources

        def end(token: int, why: str) -> None:
            self.order()
            ending(token, why)

        def kill(names: Any) -> Any:
            if not self.schedule.guarded or watchdog._armed:
                self.order()  # what another client holds before that is no order to what begins later
            return hold(motion, names)

        watchdog._end = end  # type: ignore[method-assign]
        motion.killTasksUsingResources = kill

    def broken(self, result: RobotMotionResult | None, error: str, returned: float) -> list[str]:
        """Return which laws are broken."""
        robot, schedule = self.robot, self.schedule
        times, measured = np.array(robot.times), np.array(robot.measured)
        wrong = []

        def moved_after(time: float) -> float:
            rows = measured[times >= time]
            return float(np.abs(rows - rows[0]).max(initial=0.0)) if len(rows) else 0.0

        completed = result is not None and result.status is RobotMotionStatus.COMPLETED
        if result is not None and not self.ghost and result.at_rest and moved_after(returned) > STILL:
            wrong.append(
                f"moved by {moved_after(returned):.3f} after rest was reported ({result.status.value})"
            )
        if completed and not self.ghost and schedule.method in ("stream", "bezier", "base"):
            end = self.client_end(result)
            if end > 0.03:
                wrong.append(f"completed {end:.3f} from the end")
        if self.ordered is not None and not completed:
            late = max(schedule.slow.values(), default=0.0)
            bound = REST if schedule.method in ("stream", "bezier", "ros") else self.braking()
            spike = schedule.longest if schedule.spikes > 0 else 0.1
            slack = 2.0 * late + (0.0 if schedule.guarded else 2.0 * spike)
            moved = moved_after(self.ordered + bound + slack)
            if moved > STILL:
                wrong.append(f"moved by {moved:.3f} more than {bound + slack:.2f} s after the order to stop")
        if schedule.end == "kill" and self.caused is not None and schedule.guarded and self.ordered is None:
            late = [t for t, row in zip(times, measured, strict=True) if t > self.caused + 1.0]
            if late and moved_after(self.caused + 1.0) > STILL and schedule.state is not MotionState.CHECKING:
                wrong.append("a killed client's motion was not stopped")
        return wrong

    def braking(self) -> float:
        """Return the time in which the base and joints come to rest [s]."""
        base = self.robot.body.controller.base.geometry
        return REST + base.linear_velocity / base.linear_acceleration

    def client_end(self, result: RobotMotionResult) -> float:
        """Return how far the robot was from the end of its motion, in the joints [rad]."""
        run = result.run
        assert run is not None
        wanted = run.reference_position[-1]
        columns = [k for k, name in enumerate(run.joint_names) if not name.startswith("Base")]
        return float(np.abs(run.position[-1] - wanted)[columns].max())


class _RosCase(_Case):
    """A motion by `RobotClient`: cancel requests are the orders to stop."""

    @contextlib.contextmanager
    def patched(self, motions: Motions) -> Iterator[None]:
        def supervisor(motion: Any, clock: Any) -> Supervisor:
            return Supervisor(motion, clock, self.begin_state)

        with (
            mock.patch("pepper_kin.ros.client.Clock", return_value=self),
            mock.patch("pepper_kin.ros.client.Supervisor", supervisor),
            mock.patch("pepper_kin.ros.client.refuse_unsafe", self.certify),
            mock.patch("pepper_kin.ros.client.ros_points", return_value=motions.points),
        ):
            yield

    def connect(self) -> None:
        slow = self.schedule.slow.get("goal", 0.0)
        self.transport = SimulatedTransport(self.world, self.network, slow, self.order)
        self.node = RobotNode(self.robot.body, self.transport, cameras=(), noise=False)
        self.client = RobotClient(self.transport, pepper=pk.load_pepper())
        self.client.joint_positions()

    def watch_orders(self) -> None:
        """Do nothing: the transport notes the orders."""

    def go_wrong(self) -> None:
        if self.schedule.end in ("kill", "cut"):
            self.ghost = True
            self.transport.lose_client()
        elif self.schedule.end == "other stop":
            self.schedule = replace(self.schedule, end="kill all")
            super().go_wrong()
        else:
            super().go_wrong()

    def damaged(self, module: str, topic: str, message: Any) -> Any:
        values = {"nan": float("nan"), "infinite": float("inf"), "text": 1e300}
        value = values.get(self.schedule.damage)
        positions = [value] * len(message.name) if value is not None else message.position[:2]
        return type(message)(header=message.header, name=message.name, position=positions)

    def move(self, motions: Motions) -> Any:
        return self.client.follow(motions.arms)
