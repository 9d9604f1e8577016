"""Long jobs tell how far they are, from nothing done to all; `check_paper`: see its own tests."""

import pytest

from pepper_kin.jobs import check_dynamics, check_physics
from pepper_kin.model import load_pepper


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("job", "parts"),
    [
        (lambda tell: check_dynamics(load_pepper(), states=5, progress=tell), 4),
        (lambda tell: check_physics(timesteps=(4e-3, 2e-3), duration=0.05, progress=tell), 4),
    ],
    ids=["dynamics", "physics"],
)
def test_progress_is_reported_from_nothing_to_all(job, parts):
    calls = []
    job(lambda done, total: calls.append((done, total)))
    assert calls == [(k, parts) for k in range(parts + 1)]
