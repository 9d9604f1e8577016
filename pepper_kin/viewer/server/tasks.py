"""Long tasks of a session, done by the worker."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.task import Task
from pepper_kin.model import PepperModel
from pepper_kin.viewer.server.worker import Worker

if TYPE_CHECKING:
    from pepper_kin.viewer.server.session import LiveSession

_LOADING = (
    "Loading what moves the body. Where it has to be compiled first, this takes some ten seconds; sliders, "
    "postures and obstacles work already."
)


class LongTasks:
    """Loading, planning and explaining, done by the worker.

    Args:
        pepper: Model of the robot.
        worker: Worker that does the tasks.
    """

    def __init__(self, pepper: PepperModel, worker: Worker) -> None:
        self._pepper, self._worker = pepper, worker
        self._begun = False

    def warm_up(self, session: LiveSession) -> None:
        """Load the machine code of following, then of planning, once."""
        if self._begun:
            return
        self._begun = True
        from pepper_kin.viewer.server import follower, planning

        def servo_is_there(result: Any, fault: Exception | None) -> None:
            if fault is not None:
                session.fail(fault)
                return
            session.servo_ready()
            session.document.set("ready", {"servo": True, "planner": False})
            if session.document["message"]["text"] == _LOADING:
                session.say("Ready: drag a colored ball, and the body follows.")

        def planner_is_there(result: Any, fault: Exception | None) -> None:
            if fault is None:
                session.document.set("ready", {"servo": True, "planner": True})

        session.say(_LOADING)
        self._worker.do(lambda: follower.compile_servo(self._pepper), servo_is_there)
        self._worker.do(lambda: planning.compile_planning(self._pepper), planner_is_there)

    def plan(self, session: LiveSession, tasks: list[Task]) -> None:
        """Plan from the session's posture to tasks, and load the motion into the session.

        The outcome is dropped if the targets were released or the robot was moved meanwhile.

        Raises:
            InvalidValueError: while another motion is being planned.
        """
        if session.document["busy"] is not None:
            raise InvalidValueError("plan", "a second one", "one at a time: wait for the first")
        from pepper_kin.viewer.server.planning import plan_motion

        q, scene, target_revision = session.q.copy(), session.scene, session.target_revision

        def done(planned: Any, fault: Exception | None) -> None:
            session.document.set("busy", None)
            if session.target_revision != target_revision:
                return
            if fault is not None:
                session.fail(fault)
                return
            if planned.shown is not None:
                session.load(planned.shown, play=False)
            session.answer(planned.report, "bad" if planned.shown is None else "good")

        self.warm_up(session)
        waits = "" if session.document["ready"]["planner"] else " (the planner is still being loaded)"
        session.document.set("busy", f"Planning{waits} ...")
        self._worker.do(lambda: plan_motion(self._pepper, q, tasks, scene), done)

    def explain(self, session: LiveSession, tasks: list[Task]) -> None:
        """Show why the robot came to rest before its targets; see `why_no_closer`."""
        from pepper_kin.viewer.server.explaining import why_no_closer

        q, scene, target_revision = session.q.copy(), session.scene, session.target_revision

        def done(text: Any, fault: Exception | None) -> None:
            if fault is None and session.target_revision == target_revision:
                session.answer(text, "bad")

        self._worker.do(lambda: why_no_closer(self._pepper, q, tasks, scene), done)
