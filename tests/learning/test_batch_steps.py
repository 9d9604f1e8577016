"""Targets sent to a batch of twins: the same as following the commands that they are shaped to."""

import numpy as np
import pytest

from pepper_kin.core.simulation.target_following import time_to_target, way_to_target
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin import TwinBatch, actuator_parameters

N, STEPS = 5, 20


def commands_to(pepper, command, speed, target, share, steps=STEPS, h=0.001):
    """Return positions and velocities of the commands at the ends of steps, shape (N, T, n)."""
    positions, velocities = np.empty((2, *command.shape[:1], steps, command.shape[1]))
    for i, j in np.ndindex(command.shape):
        way, begin = target[i, j] - command[i, j], speed[i, j]
        fastest, strongest = share * pepper.velocity_limits[j], pepper.acceleration_limits[j]
        duration = max(time_to_target(way, begin, fastest, strongest), h)
        for k in range(steps):
            t = (k + 1) * h
            positions[i, k, j] = command[i, j] + way_to_target(way, begin, duration, t)
            near = [way_to_target(way, begin, duration, t + d) for d in (-1e-6, 1e-6)]
            velocities[i, k, j] = (near[1] - near[0]) / 2e-6 if t < duration else 0.0
    return positions, velocities


@pytest.mark.thorough
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"feedforward": "none", "payload": {"left": [0.0, 0.1, 0.2, 0.3, 0.4]}},
        {"vary": {"stiffness": np.linspace(20.0, 400.0, N)[:, None]}},
        {"actuators": "backlash"},
    ],
)
def test_targets_are_followed_along_their_cubics(pepper, options):
    rng = np.random.default_rng(1)
    if options.get("actuators") == "backlash":
        options = {"actuators": actuator_parameters(pepper).changed(backlash=0.01)}
    sent, followed = TwinBatch(pepper, N, **options), TwinBatch(pepper, N, **options)
    command, speed = sent.position, np.zeros((N, pepper.n))
    for _ in range(4):
        low, high = pepper.lower_limits, pepper.upper_limits
        target = np.clip(sent.position + rng.uniform(-0.3, 0.3, command.shape), low, high)
        assert sent.step(target, STEPS, speed=0.5).all()
        position, velocity = commands_to(pepper, command, speed, target, 0.5)
        assert not followed.follow(position, velocity).messages
        np.testing.assert_allclose(sent.position, followed.position, atol=1e-8)
        np.testing.assert_allclose(sent.velocity, followed.velocity, atol=1e-5)
        command, speed = position[:, -1], velocity[:, -1]


def test_threads_and_other_robots_change_nothing(pepper):
    rng = np.random.default_rng(2)
    targets = rng.uniform(-0.3, 0.3, (3, 40, pepper.n)) + pepper.neutral()
    batches = [TwinBatch(pepper, 40), TwinBatch(pepper, 40), TwinBatch(pepper, 11)]
    for target in targets:
        batches[0].step(target)
        batches[1].step(target, threads=2)
        batches[2].step(target[:11])
    np.testing.assert_array_equal(batches[0].position, batches[1].position)
    np.testing.assert_array_equal(batches[0].position[:11], batches[2].position)


def test_reset_robots_begin_at_rest_and_others_go_on(pepper):
    batch, whole = TwinBatch(pepper, 4), TwinBatch(pepper, 4)
    target = pepper.neutral() + 0.2
    for twins in (batch, whole):
        twins.step(target)
    batch.reset(rows=[1])
    np.testing.assert_array_equal(batch.position[1], pepper.neutral())
    for twins in (batch, whole):
        twins.step(target)
    np.testing.assert_array_equal(batch.position[[0, 2, 3]], whole.position[[0, 2, 3]])
    fresh = TwinBatch(pepper, 4)
    fresh.step(target)
    np.testing.assert_array_equal(batch.position[1], fresh.position[1])


def test_what_cannot_be_stepped_is_refused(pepper):
    batch = TwinBatch(pepper, 2)
    for targets in (np.full(pepper.n, np.nan), np.zeros((3, pepper.n)), np.zeros(2)):
        with pytest.raises(InvalidValueError, match="targets"):
            batch.step(targets)
    with pytest.raises(InvalidValueError, match="speed"):
        batch.step(pepper.neutral(), speed=0.0)
    torques = actuator_parameters(pepper).changed(mode={"HeadYaw": "torque"})
    with pytest.raises(InvalidValueError, match="torque mode"):
        TwinBatch(pepper, 2, actuators=torques).step(pepper.neutral())
