"""The action `follow_joint_trajectory` and joint states in simulated time, for `robot_schedules`.

Node, controllers and client are the library's own; messages are late, lost or damaged.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from simulated_robot import Network, World

from pepper_kin.ros import TransportError
from pepper_kin.ros.transport import (
    ActionServer,
    Closable,
    GoalHandle,
    GoalResult,
    GoalStatus,
    Publisher,
    ServerGoal,
    Transport,
)

STATES = "/joint_states"


class _Open(Closable):
    def close(self) -> None:
        pass


class _Topic(Publisher):
    def __init__(self, publish: Callable[[Any], None] | None) -> None:
        self._publish = publish

    def publish(self, message: Any) -> None:
        if self._publish is not None:
            self._publish(message)

    @property
    def subscription_count(self) -> int:
        return int(self._publish is not None)

    def close(self) -> None:
        pass


class SimulatedTransport(Transport):
    """Both ends of a transport between a node and a client.

    Args:
        world: Time.
        network: Whose delays, damages and losses hold.
        slow: Time that the server takes to begin a goal [s].
        on_cancel: Called with each cancel request that arrives.
    """

    def __init__(self, world: World, network: Network, slow: float, on_cancel: Callable[[], None]) -> None:
        self.world, self.network, self.slow, self.on_cancel = world, network, slow, on_cancel
        self.actions: dict[str, ActionServer] = {}
        self.goals: list[Goal] = []
        self._hear: Callable[[Any], None] | None = None

    def later(self, act: Callable[[], object], *, from_client: bool) -> None:
        """Do something when a message has arrived, on a thread of the receiver."""
        late = self.network.delay()
        if np.isfinite(late) and not (from_client and self.network.dead):
            self.world.at(self.world.time + late, lambda: self.world.spawn(act))

    def lose_client(self) -> None:
        """End the goals of a client that is gone, as rosbridge's server does."""
        self.network.dead = True
        for goal in self.goals:
            self.world.at(self.world.time + 0.1, lambda goal=goal: self.world.spawn(goal.request_cancel))

    def advertise(self, topic: str, type_name: str, qos: Any = None) -> Publisher:
        return _Topic(self._send if topic == STATES else None)

    def _send(self, message: Any) -> None:
        def arrive() -> None:
            if self._hear is not None and not self.network.dead:
                damaged = self.network.damage("", STATES, message)
                self._hear(damaged)

        self.later(arrive, from_client=False)

    def subscribe(self, topic: str, type_name: str, qos: Any, callback: Callable[[Any], None]) -> Closable:
        if topic == STATES:
            self._hear = callback
        return _Open()

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        return _Open()

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = 5.0) -> Any:
        raise TransportError(name, "not simulated")

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        self.actions[name] = server
        return _Open()

    def send_goal(
        self, name: str, type_name: str, goal: Any, feedback_callback: Any = None, timeout: float = 5.0
    ) -> GoalHandle:
        made = Goal(self, self.actions[name], goal, feedback_callback)
        self.goals.append(made)
        self.later(made.serve, from_client=True)
        if not self.world.block(lambda: made.answered, timeout):
            made.abandoned = True
            raise TransportError(name, f"no answer within {timeout:g} s")
        return made

    def close(self) -> None:
        pass


class Goal(ServerGoal, GoalHandle):
    """A goal, as the server and the client see it."""

    number = itertools.count()

    def __init__(self, transport: SimulatedTransport, server: ActionServer, goal: Any, feedback: Any) -> None:
        self._transport, self._server, self._feedback = transport, server, feedback
        self.goal, self.goal_id = goal, next(self.number).to_bytes(16, "big")
        self.accepted = self.answered = self.abandoned = self._canceling = False
        self._status, self._result = GoalStatus.UNKNOWN, None

    def serve(self) -> None:
        if self._transport.slow:
            self._transport.world.sleep(self._transport.slow)
        self._status = GoalStatus.EXECUTING
        self._transport.later(self._accept, from_client=False)
        self._server.execute(self)

    def _accept(self) -> None:
        self.accepted = self.answered = True
        if self.abandoned:  # what the contract of `send_goal` asks of a transport
            self._transport.later(self.request_cancel, from_client=True)

    @property
    def status(self) -> GoalStatus:
        return self._status

    @property
    def cancel_requested(self) -> bool:
        return self._canceling

    @property
    def done(self) -> bool:
        return self._result is not None

    def publish_feedback(self, feedback: Any) -> None:
        if self._feedback is not None and not self._transport.network.dead:
            self._transport.later(lambda: self._feedback(feedback), from_client=False)

    def request_cancel(self) -> None:
        self._transport.on_cancel()
        if not self._status.terminal:
            self._canceling = True
            self._server.on_cancel(self)

    def cancel(self, timeout: float = 5.0) -> bool:
        answered = []
        self._transport.later(
            lambda: (
                self.request_cancel(),
                self._transport.later(lambda: answered.append(1), from_client=False),
            ),
            from_client=True,
        )
        if not self._transport.world.block(lambda: bool(answered), timeout):
            raise TransportError("cancel", "no answer")
        return True

    def result(self, timeout: float | None = None) -> GoalResult:
        if self._result is None:
            raise TransportError("result", "none yet")
        return self._result

    def _end(self, status: GoalStatus, result: Any) -> None:
        self._status = status
        self._transport.later(lambda: setattr(self, "_result", GoalResult(status, result)), from_client=False)

    def succeed(self, result: Any) -> None:
        self._end(GoalStatus.SUCCEEDED, result)

    def abort(self, result: Any) -> None:
        self._end(GoalStatus.ABORTED, result)

    def canceled(self, result: Any) -> None:
        self._end(GoalStatus.CANCELED, result)
