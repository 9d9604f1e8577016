"""Velocities of what is seen again: those of known motions."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.tracking import SceneTracker
from pepper_kin.exceptions import InvalidValueError


def ball(x, **options):
    return pk.Scene().add_sphere("ball", 0.1, (x, 0.0, 1.0), **options).add_box("box", (1, 1, 1), (3, 0, 0))


def test_what_moves_has_its_velocity_and_what_stands_has_none():
    tracker, rng, now = SceneTracker(0.2), np.random.default_rng(0), 0.0
    for _ in range(200):
        now += rng.uniform(0.005, 0.06)
        seen = tracker.seen(ball(0.7 * now), now)
        if now > 0.2:
            assert np.allclose(seen.objects["ball"].velocity, (0.7, 0.0, 0.0), rtol=0, atol=1e-9)
            assert seen.objects["ball"].uncertainty == 0.2
        assert not seen.objects["box"].moves
    for later in (0.2, 0.9):  # it stands, and may set off again
        seen = tracker.seen(ball(0.7 * now), now + later)
        assert not seen.objects["ball"].velocity.any()
        assert seen.objects["ball"].uncertainty == 0.2
    assert not tracker.seen(ball(0.7 * now), now + 1.2).objects["ball"].moves


def test_the_first_look_the_same_time_and_own_velocities():
    tracker = SceneTracker()
    assert not tracker.seen(ball(1.0), 0.0).objects["ball"].moves
    assert not tracker.seen(ball(2.0), 0.0).objects["ball"].moves  # in place of the first
    assert np.allclose(tracker.seen(ball(2.1), 0.5).objects["ball"].velocity, (0.2, 0, 0))
    own = tracker.seen(ball(2.2, velocity=(0.0, 1.0, 0.0)), 0.6).objects["ball"]
    assert np.array_equal(own.velocity, (0.0, 1.0, 0.0))
    for wrong in ({"uncertainty": -1.0}, {"window": 0.0}, {"held": np.nan}):
        with pytest.raises(InvalidValueError, match=next(iter(wrong))):
            SceneTracker(**wrong)
