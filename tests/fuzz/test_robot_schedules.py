"""Motions on a simulated robot while messages, clients and the robot itself fail at random times.

The oracles are laws: after an order to stop arms are at rest within 0.5 s and the base within its time of
braking, nothing moves after rest was reported, the robot is inactive in the end, and no error is raw.
"""

import itertools
import signal
from dataclasses import replace

import numpy as np
import pytest
from robot_schedules import METHODS, Motions, Schedule, run, schedule_of

from pepper_kin.naoqi import RobotMotionStatus
from pepper_kin.supervision import MotionState, SupervisedMotion, Supervisor, allowed_transitions


@pytest.fixture(scope="module")
def motions():
    return Motions()


@pytest.mark.parametrize("method", METHODS)
def test_what_was_stopped_stays_stopped(method, motions, amount, rng, tried):
    count, wrong = amount(12, 40, 10_000), []
    for _ in range(count):
        schedule = schedule_of(method, rng)
        outcome = run(schedule, motions)
        if outcome.wrong:
            wrong.append((schedule, outcome.wrong))
    tried(f"schedules of failures, {method}", count, len(wrong))
    assert not wrong, wrong[:3]


PLAIN = Schedule(
    "stream", True, "none", MotionState.MOVING, 0.1, "none", 100.0, 0.002, 0.0, 0.2, 0.0, 0.0, {}, 0
)
"""Nothing goes wrong."""


def held(schedule, motions):
    """Return the result of a schedule in which the laws hold and rest is measured."""
    outcome = run(schedule, motions)
    assert not outcome.wrong
    assert outcome.result is not None, outcome.error
    assert outcome.result.at_rest, outcome.result.message
    return outcome.result


def test_every_arrow_of_the_states_is_driven(motions):
    stop = replace(PLAIN, end="stop", after=0.0)
    schedules = [PLAIN, *(replace(stop, state=state) for state in (MotionState.CHECKING, MotionState.MOVING))]
    late = {"angleInterpolationBezier": 0.5}
    schedules.append(replace(stop, method="bezier", slow=late, state=MotionState.HANDED_OVER))
    schedules.append(replace(stop, base_delay=0.05, state=MotionState.HANDED_OVER))
    driven = set()
    for schedule in schedules:
        states = run(schedule, motions).states
        driven |= set(itertools.pairwise(states))
    assert driven == set(allowed_transitions())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("guarded", [True, False])
def test_a_motion_without_failures_is_completed(method, guarded, motions):
    schedule = replace(PLAIN, method=method, guarded=guarded)
    assert held(schedule, motions).status is RobotMotionStatus.COMPLETED


@pytest.mark.parametrize("guarded", [True, False])
@pytest.mark.parametrize("late", [0.3, 1.0, 2.0])
def test_a_motion_that_the_robot_begins_late_does_not_outlive_its_stop(guarded, late, motions):
    """A1: the robot takes its time to begin the Bezier curves; `stop` comes before it does."""
    slow = {"angleInterpolationBezier": late}
    schedule = replace(PLAIN, method="bezier", guarded=guarded, slow=slow, end="stop", after=0.05)
    assert held(schedule, motions).status is RobotMotionStatus.STOPPED


def test_a_client_that_was_frozen_learns_that_the_watchdog_stopped_it(motions):
    outcome = run(replace(PLAIN, method="bezier", end="freeze", seed=3), motions)
    assert not outcome.wrong
    assert outcome.result.status is RobotMotionStatus.STALLED
    assert "no beat for" in outcome.result.message


def test_a_stop_during_the_check_counts(motions):
    """A2: it was forgotten as soon as the check was over."""
    outcome = run(replace(PLAIN, end="stop", state=MotionState.CHECKING, after=0.1), motions)
    assert outcome.result.status is RobotMotionStatus.STOPPED
    assert outcome.states == [MotionState.CHECKING, MotionState.STOPPING, MotionState.AT_REST]


@pytest.mark.parametrize("method", METHODS)
def test_ctrl_c_holds_a_robot_without_a_watchdog(method, motions):
    """A4: nothing was sent, and the base drove on."""
    schedule = replace(PLAIN, method=method, guarded=False, end="interrupts", after=0.15)
    outcome = run(schedule, motions)
    assert outcome.error == "KeyboardInterrupt"
    assert outcome.states[-1] is MotionState.AT_REST
    assert not outcome.wrong


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("damage", ["nan", "none values", "short", "text", "not a list", "infinite"])
def test_states_that_are_no_numbers_stop_the_robot(method, damage, motions):
    """A4 and A5: a ValueError, or NaN that is no deviation, while the robot went on."""
    schedule = replace(PLAIN, method=method, guarded=False, damage=damage, damaged_for=0.2, after=0.15)
    result = held(schedule, motions)
    assert result.status is RobotMotionStatus.STATE_UNUSABLE
    assert "expected" in result.message


@pytest.mark.parametrize("method", ["stream", "base", "drive"])
def test_answers_that_are_late_end_the_motion(method, motions):
    """A5: a base moved for five seconds without a check."""
    schedule = replace(PLAIN, method=method, spikes=1.0, longest=1.5, seed=1)
    outcome = run(schedule, motions)
    assert not outcome.wrong
    assert outcome.result is not None
    assert outcome.result.status in (RobotMotionStatus.STATE_UNUSABLE, RobotMotionStatus.STALLED)


def test_a_result_says_that_rest_is_not_confirmed(motions):
    outcome = run(replace(PLAIN, end="cut"), motions)
    assert outcome.result.status is RobotMotionStatus.CONNECTION_LOST
    assert not outcome.result.at_rest
    assert "at rest is not confirmed: " in outcome.result.message
    assert "MAY STILL MOVE" in outcome.result.report()


def test_no_velocity_that_is_not_a_number_is_sent(motions):
    """A5: `move(nan, nan, nan)`."""
    sent = []
    schedule = replace(PLAIN, method="base", damage="nan", damaged_for=0.5)
    outcome = run(schedule, motions, watch=lambda method, arguments: sent.append((method, arguments)))
    numbers = [x for method, arguments in sent if method == "move" for x in arguments]
    assert len(numbers) > 9
    assert np.isfinite(numbers).all()
    assert not outcome.wrong


class InterruptedAtItsEnd(SupervisedMotion):
    """Ctrl-C comes in the step that completes the motion."""

    connected = True

    def check(self):
        """Nothing speaks against it."""

    def hand_over(self):
        return True

    def step(self):
        signal.raise_signal(signal.SIGINT)
        return True

    def stop(self):
        return ""


def test_ctrl_c_with_the_last_step_is_raised():
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Supervisor(InterruptedAtItsEnd()).run()
    finally:
        signal.signal(signal.SIGINT, handler)
