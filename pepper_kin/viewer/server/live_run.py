"""Going to the targets while obstacles and targets are dragged."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, in_collision
from pepper_kin.collision.tracking import SceneTracker
from pepper_kin.ik import solve
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels.threads import OWN_THREADS
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.motion.live_motion import COMMITTED, LiveMotion, LiveState, LiveStatus
from pepper_kin.viewer.server.explaining import RESTARTS, at_target, no_closer, on_the_way
from pepper_kin.viewer.server.planning import MARGIN
from pepper_kin.viewer.server.words import body_words

VELOCITY, ACCELERATION = 0.1, 0.3
"""Shares of the limits: there is time to drag something into the way, and the robot stops soon."""
RATE = 30.0
"""Cycles a second of the motion's clock [1/s]."""
_SHORT = 0.3  # [s] of waiting, such as for a plan, that need no words
_DUE = 0.9 / RATE  # [s] after which a cycle is due: ticks come every 10 ms


class _Decision(NamedTuple):
    """What a cycle decided about tasks, and why there is nowhere to go; empty where there is."""

    state: LiveState
    tasks: list[Task]
    fault: str


class LiveRun:
    """A live motion of the page's robot; see `LiveMotion`.

    Cycles are done by a separate thread, so that pages do not wait for them.  Time stands still where a
    cycle takes longer than the robot was committed to go on before.

    Args:
        pepper: The robot.
        q: Where it stands [rad or m], shape (n,).
    """

    def __init__(self, pepper: PepperModel, q: Array) -> None:
        self._pepper, self._start = _careful(pepper), q.copy()
        self._threads = ThreadPoolExecutor(1, f"{OWN_THREADS}-page")
        self._waits_for: Future[_Decision] | None = None
        self._decided: _Decision | None = None
        self._now = self._begun = self._since = 0.0
        self._tasks: list[Task] = []
        # What follows belongs to the thread of the cycles.
        self._live: LiveMotion | None = None
        self._aimed: list[Task] | None = None
        self._searched: Scene | None = None
        self._fault = ""
        self._tracker = SceneTracker()

    def aim(self, tasks: list[Task]) -> None:
        """Take other tasks from the next cycle on; none to stop."""
        self._tasks = tasks

    @property
    def state(self) -> LiveState | None:
        """What the last cycle decided; None before the first."""
        return None if self._decided is None else self._decided.state

    @property
    def shown(self) -> tuple[Array, Array, Array]:
        """Joint positions, velocities and accelerations now, shape (n,) each."""
        assert self._decided is not None
        found = self._decided.state.at(self._now)
        return found.position, found.velocity, found.acceleration

    @property
    def resting(self) -> bool:
        """Whether the robot stands at its targets."""
        done = self._decided
        there = done is not None and done.state.status is LiveStatus.REACHED and done.tasks is self._tasks
        return there and self._waits_for is None

    @property
    def stopped(self) -> bool:
        """Whether the robot stands, and has no tasks."""
        done = self._decided
        return done is not None and done.state.status is LiveStatus.WAITING and not done.tasks

    def advance(self, seconds: float) -> float | None:
        """Let time pass; where a cycle is due return how long the last one is ago [s], else None.

        Raises:
            Exception: that a cycle ended with.
        """
        if self._waits_for is not None and self._waits_for.done():
            before, self._decided, self._waits_for = self.state, self._waits_for.result(), None
            if before is None or before.status is not self._decided.state.status:
                self._since = self._decided.state.begin
        if self.state is None:
            return None if self._waits_for is not None else 0.0
        end, state = self.state.begin + COMMITTED / RATE, self.state
        if self._waits_for is not None:  # from rest the robot may set off at once
            end = min(end, max(self._begun, state.begin + state.trajectory.duration))
        self._now = min(self._now + seconds, end)
        since = self._now - state.begin
        return since if self._waits_for is None and since >= _DUE else None

    def begin(self, scene: Scene) -> None:
        """Begin a cycle in the world as it is now."""
        self._begun = self._now
        self._waits_for = self._threads.submit(self._decide, scene, self._now, self._tasks)

    def report(self) -> tuple[str, str]:
        """Return what the message line says, and its kind."""
        assert self._decided is not None
        state, tasks, fault = self._decided
        if not tasks:
            return "", "info"
        if fault:
            return fault, "bad"
        runs_into = state.status is LiveStatus.REACHED and state.near
        if runs_into or (state.status is LiveStatus.WAITING and self._now - self._since >= _SHORT):
            near = " and ".join(body_words(name) for name in state.near)
            return f"Waiting: {f'{near} come too near' if near else state.reason}.", "info"
        if state.status is LiveStatus.REACHED:
            return at_target(tasks), "good"
        return on_the_way(tasks), "info"

    def _decide(self, scene: Scene, now: float, tasks: list[Task]) -> _Decision:
        """Do a cycle."""
        if self._live is None:
            self._live = LiveMotion(self._pepper, self._start, scene, rate=RATE)
        live, seen = self._live, self._tracker.seen(scene, now)
        waits = self.state is not None and self.state.status is LiveStatus.WAITING
        if tasks is not self._aimed or (waits and scene is not self._searched):
            self._find_goal(live, scene, tasks)
        live.set_scene(seen, now)
        return _Decision(live.step(now), tasks, self._fault)

    def _find_goal(self, live: LiveMotion, scene: Scene, tasks: list[Task]) -> None:
        """Set the posture in which the tasks are met, unless that which is the goal is free still."""
        known = live.goal if tasks is self._aimed else None
        self._aimed, self._searched = tasks, scene
        if known is not None and not in_collision(self._pepper, known, scene):
            return
        live.set_goal(None)
        self._fault = ""
        if tasks:
            q = live.trajectory.end
            found = solve(self._pepper, tasks, q, scene=scene, margin=MARGIN, restarts=RESTARTS)
            if found.success:
                live.set_goal(found.q)
            else:
                self._fault = no_closer(self._pepper, q, tasks, scene, found)


@kept_for_robot(most=1)
def _careful(pepper: PepperModel) -> PepperModel:
    """Return the robot at shares of its limits."""
    return pepper.with_limits(
        velocity=VELOCITY * pepper.velocity_limits, acceleration=ACCELERATION * pepper.acceleration_limits
    )
