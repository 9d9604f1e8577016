"""A live motion to the targets while obstacles and targets are dragged."""

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
"""Fractions of the limits: slow enough to drag an obstacle into the path, and to stop soon."""
RATE = 30.0
"""Rate of the motion's cycles [1/s]."""
_SHORT = 0.3  # [s]; longest wait, as for a plan, without a message
_DUE = 0.9 / RATE  # [s]; time after which a cycle is due: ticks come every 10 ms


class _Decision(NamedTuple):
    """Result of a cycle: state, tasks, and the reason why there is no goal ("" if there is one)."""

    state: LiveState
    tasks: list[Task]
    fault: str


class LiveRun:
    """A live motion of the page's robot; see `LiveMotion`.

    Cycles run in a separate thread, so that pages do not wait for them.  The motion's clock waits if a cycle
    takes longer than the time that the robot is committed to.

    Args:
        pepper: Model of the robot.
        q: Joint positions at the start [rad or m], shape (n,).
    """

    def __init__(self, pepper: PepperModel, q: Array) -> None:
        self._pepper, self._start = _careful(pepper), q.copy()
        self._threads = ThreadPoolExecutor(1, f"{OWN_THREADS}-page")
        self._waits_for: Future[_Decision] | None = None
        self._decided: _Decision | None = None
        self._now = self._begun = self._since = 0.0
        self._tasks: list[Task] = []
        # The attributes below belong to the thread of the cycles.
        self._live: LiveMotion | None = None
        self._aimed: list[Task] | None = None
        self._searched: Scene | None = None
        self._fault = ""
        self._tracker = SceneTracker()

    def aim(self, tasks: list[Task]) -> None:
        """Set the tasks from the next cycle on; an empty list stops."""
        self._tasks = tasks

    @property
    def state(self) -> LiveState | None:
        """State of the last cycle; None before the first."""
        return None if self._decided is None else self._decided.state

    @property
    def shown(self) -> tuple[Array, Array, Array]:
        """Present joint positions, velocities and accelerations, shape (n,) each."""
        assert self._decided is not None
        found = self._decided.state.at(self._now)
        return found.position, found.velocity, found.acceleration

    @property
    def resting(self) -> bool:
        """Whether the robot is at rest at its targets."""
        done = self._decided
        there = done is not None and done.state.status is LiveStatus.REACHED and done.tasks is self._tasks
        return there and self._waits_for is None

    @property
    def stopped(self) -> bool:
        """Whether the robot is at rest and has no tasks."""
        done = self._decided
        return done is not None and done.state.status is LiveStatus.WAITING and not done.tasks

    def advance(self, seconds: float) -> float | None:
        """Let time pass; return the time since the last cycle [s] if a new one is due, else None.

        Raises:
            Exception: the error of a failed cycle.
        """
        if self._waits_for is not None and self._waits_for.done():
            before, self._decided, self._waits_for = self.state, self._waits_for.result(), None
            if before is None or before.status is not self._decided.state.status:
                self._since = self._decided.state.begin
        if self.state is None:
            return None if self._waits_for is not None else 0.0
        end, state = self.state.begin + COMMITTED / RATE, self.state
        if self._waits_for is not None:  # from rest the robot may start at once
            end = min(end, max(self._begun, state.begin + state.trajectory.duration))
        self._now = min(self._now + seconds, end)
        since = self._now - state.begin
        return since if self._waits_for is None and since >= _DUE else None

    def begin(self, scene: Scene) -> None:
        """Start a cycle in the present scene."""
        self._begun = self._now
        self._waits_for = self._threads.submit(self._decide, scene, self._now, self._tasks)

    def report(self) -> tuple[str, str]:
        """Return the text of the message line, and its kind."""
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
        """Do a cycle, in the thread of the cycles."""
        if self._live is None:
            self._live = LiveMotion(self._pepper, self._start, scene, rate=RATE)
        live, seen = self._live, self._tracker.seen(scene, now)
        waits = self.state is not None and self.state.status is LiveStatus.WAITING
        if tasks is not self._aimed or (waits and scene is not self._searched):
            self._find_goal(live, scene, tasks)
        live.set_scene(seen, now)
        return _Decision(live.step(now), tasks, self._fault)

    def _find_goal(self, live: LiveMotion, scene: Scene, tasks: list[Task]) -> None:
        """Set a posture that meets the tasks as goal, unless the present goal is still free."""
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
    """Return the robot with reduced limits."""
    return pepper.with_limits(
        velocity=VELOCITY * pepper.velocity_limits, acceleration=ACCELERATION * pepper.acceleration_limits
    )
