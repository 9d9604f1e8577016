"""Ctrl-C in long calls: it is never lost, and machine code returns often enough to hear it."""

import gc
import signal
import sys
import weakref

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.kernels.threads import run_in_pieces
from pepper_kin.twin.world import World


class Stopped(KeyboardInterrupt):
    """What the handler raises, as that of Ctrl-C does."""


@pytest.fixture
def interrupt_after(monkeypatch):
    """Return what arms a signal [s]; its handler raises, and nothing may be raised where nobody hears it."""
    lost = []
    monkeypatch.setattr(sys, "unraisablehook", lost.append)

    def handler(*_):
        raise Stopped

    before = signal.signal(signal.SIGALRM, handler)
    yield lambda seconds: signal.setitimer(signal.ITIMER_REAL, seconds)
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)
    assert lost == []


def far(pepper, seconds):
    """Return a slow motion."""
    goal = pepper.joint_vector({"LShoulderPitch": 0.5})
    return pk.retime(pepper, [pepper.posture("Stand"), goal]).with_duration(seconds)


class Spring:
    """A world in Python."""

    bodies = ()

    def advance(self, q, v, mass_hat, force, h):
        return -0.1 * q


def boxes(pepper):
    world = World(pepper, pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715)))
    world.add_box("cup", (0.05, 0.05, 0.1), 0.2, (0.4, 0.1, 0.8))
    return world


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["boxes", "boxes of proxsuite", "python"])
def test_no_interrupt_is_lost_between_machine_code_and_what_it_calls_back(pepper, interrupt_after, kind):
    """Python handles signals as a function begins, before its first line: there ctypes would drop them."""
    world = Spring() if kind == "python" else boxes(pepper)
    if kind.endswith("proxsuite"):
        world.solver = "proxsuite"
    motion = far(pepper, 300.0)
    twin = pk.Twin(pepper, timestep=0.001, world=world)
    twin.execute(far(pepper, 0.5))
    for k in range(8):
        twin.reset(pepper.posture("Stand"))
        interrupt_after(0.3 + 0.0137 * k)
        with pytest.raises(Stopped):
            twin.execute(motion)
        assert twin.state.time < 299


def test_what_a_world_raises_keeps_nothing_of_the_run(pepper):
    """A frame with a variable for the error would be freed by a collection of garbage only."""

    class Tired(Spring):
        def advance(self, q, v, mass_hat, force, h):
            raise Stopped

    twin = pk.Twin(pepper, timestep=0.001, world=Tired())
    gone = weakref.ref(twin)
    gc.disable()
    try:
        with pytest.raises(Stopped):
            twin.execute(far(pepper, 0.5))
        del twin
        assert gone() is None
    finally:
        gc.enable()


def test_a_run_and_a_batch_end_where_their_progress_raises(pepper):
    seen = []

    def hear(done, total):
        seen.append((done, total))
        if done > 0.3 * total:
            raise Stopped

    twin = pk.Twin(pepper, timestep=0.001)
    with pytest.raises(Stopped):
        twin.execute(far(pepper, 200.0), progress=hear)
    assert [total for _, total in seen] == [200_000] * len(seen)
    assert np.diff([done for done, _ in seen]).max() <= 30_000
    assert twin.state.time < 100.0
    seen.clear()
    batch = pk.TwinBatch(pepper, count=64)
    with pytest.raises(Stopped):
        batch.execute(far(pepper, 40.0), progress=hear)
    assert [done for done, _ in seen] == [8, 16, 24] or len(seen) < 8
    seen.clear()
    whole = pk.TwinBatch(pepper, count=24).execute(far(pepper, 2.0), progress=lambda *now: seen.append(now))
    assert seen[-1] == (24, 24)
    assert whole.success.all()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_rows_are_shared_out_once_each_in_pieces_that_end_soon(threads):
    rng = np.random.default_rng(threads)
    for _ in range(50):
        count, multiple = int(rng.integers(1, 300_000)), int(rng.choice([1, 8, 16]))
        most = int(rng.integers(multiple, 70_000))
        done, told = np.zeros(count, np.int64), []

        def run(start, stop, done=done, most=most, multiple=multiple):
            assert start % multiple == 0
            assert stop - start <= max(most, multiple)
            done[start:stop] += 1

        run_in_pieces(count, threads, multiple, run, most, told.append)
        assert (done == 1).all()
        assert told == sorted(told)
        assert told[-1] == count


def test_large_batches_run_in_many_pieces(pepper, monkeypatch):
    """The same numbers as in one piece, and an interrupt between two pieces ends the call."""
    import pepper_kin.collision.fast.checker as checker
    import pepper_kin.kernels.kernel as kernel

    rng = np.random.default_rng(0)
    span = pepper.upper_limits - pepper.lower_limits
    q = pepper.lower_limits + span * rng.random((3000, pepper.n))
    scene = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))

    def answers():
        return pk.dynamics.mass_matrix(pepper, q), pk.collision.in_collision(pepper, q, scene)

    whole, calls = answers(), []

    def small(count, threads, multiple, run, *_):
        calls.append(count)
        run_in_pieces(count, threads, multiple, run, 256)

    for module in (checker, kernel):
        monkeypatch.setattr(module, "LARGEST_PIECE", 256)
        monkeypatch.setattr(module, "run_in_pieces", small)
    for found, expected in zip(answers(), whole, strict=True):
        np.testing.assert_array_equal(found, expected)
    assert calls.count(3000) >= 2
