import inspect
import re
from pathlib import Path as FilePath

import numpy as np
import pytest

from pepper_kin import planners
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion.planning import PLANNERS as OFFERED
from pepper_kin.planners import Path, Problem, certify, smooth

DOCS = FilePath(__file__).parents[2] / "docs"


def on_a_circle(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A circle around the disc, through the start and the goal: |x - c| - 0.4, and its gradient."""
    length = np.linalg.norm(states - 0.5, axis=1)
    return length[:, None] - 0.4, ((states - 0.5) / length[:, None])[:, None, :]


def dear_below(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cost 1 - y, and its gradient."""
    return 1.0 - states[:, 1:], np.tile([[0.0, -1.0]], (len(states), 1, 1))


PLANNERS = {
    "aorrtc": lambda problem, **options: planners.aorrtc(problem, max_iterations=30, **options),
    "cbirrt": lambda problem, **options: planners.cbirrt(
        problem, planners.ConstraintManifold(on_a_circle, 2, 1, 0.01), **options
    ),
    "ompl_plan": planners.ompl_plan,
    "rrt_connect": planners.rrt_connect,
    "transition_rrt": lambda problem, **options: planners.transition_rrt(
        problem, planners.StateCost(dear_below, 2), **options
    ),
}
"""Each planner in a square with a disc in the middle."""


def outside_a_disc(states: np.ndarray) -> np.ndarray:
    return np.linalg.norm(states - 0.5, axis=1) > 0.3


@pytest.mark.parametrize("name", PLANNERS)
def test_paths_of_every_planner_are_certified_and_those_of_its_seed(name: str) -> None:
    problem = Problem([0, 0], [1, 1], [0.1, 0.5], [0.9, 0.5], outside_a_disc, resolution=0.01)
    result = PLANNERS[name](problem, seed=3, timeout=60.0)
    assert result.success, result.status.advice
    assert certify(problem, result.path).success
    again = PLANNERS[name](problem, seed=3, timeout=60.0)
    np.testing.assert_array_equal(result.path.points, again.path.points)


@pytest.mark.parametrize("name", PLANNERS)
def test_every_planner_says_that_it_found_no_path_and_that_the_start_is_invalid(name: str) -> None:
    closed = Problem([0, 0], [1, 1], [0.1, 0.5], [0.9, 0.5], lambda x: abs(x[:, 0] - 0.5) > 0.1)
    result = PLANNERS[name](closed, seed=0, timeout=0.1)
    assert not result.success
    assert result.path is None
    invalid = Problem([0, 0], [1, 1], [0.1, 0.5], [0.9, 0.5], lambda x: x[:, 0] > 0.2)
    assert PLANNERS[name](invalid, seed=0, timeout=0.1).status is planners.Status.START_INVALID


def test_every_planner_is_examined_here_and_stands_on_its_page() -> None:
    """A planner is a public function that returns a `Result`."""
    functions = {name: getattr(planners, name) for name in planners.__all__}
    found = {
        name
        for name, value in functions.items()
        if inspect.isfunction(value)
        and inspect.signature(value).return_annotation in ("Result", planners.Result)
    }
    missing = sorted(found - PLANNERS.keys())
    assert not missing, f"add a line to PLANNERS in tests/planners/test_planner_certificate.py for {missing}"
    table = re.findall(r"^\| `(\w+)` \|", (DOCS / "planners.md").read_text("utf-8"), re.MULTILINE)
    missing = sorted(found - set(table))
    assert not missing, f"add a row to the table in docs/planners.md for {missing}"
    page = (DOCS / "planning.md").read_text("utf-8")
    missing = [name for name in OFFERED if f'`"{name}"`' not in page]
    assert not missing, f"say in docs/planning.md when to choose {missing}"


def left_half(states: np.ndarray) -> np.ndarray:
    return states[:, 0] < 0.5


def test_certificate_tells_what_is_wrong() -> None:
    problem = Problem([0, 0], [1, 1], [0.1, 0.1], [[0.4, 0.1], [0.4, 0.9]], left_half, resolution=0.01)
    good = certify(problem, Path([[0.1, 0.1], [0.4, 0.9]]))
    assert good.success
    assert good.first_invalid is None
    assert good.states_checked >= np.hypot(0.3, 0.8) / 0.01
    blocked = certify(problem, Path([[0.1, 0.1], [0.7, 0.1], [0.4, 0.1]]))
    assert not blocked.success
    assert blocked.first_invalid == pytest.approx([0.5, 0.1], abs=0.011)
    outside = certify(problem, Path([[0.1, 0.1], [-0.2, 0.1], [0.4, 0.1]]))
    assert not outside.success
    assert not outside.within_bounds
    assert outside.first_invalid is None
    elsewhere = certify(problem, Path([[0.1, 0.2], [0.4, 0.4]]))
    assert elsewhere.start_error == pytest.approx(0.1)
    assert elsewhere.goal_error == pytest.approx(0.3)
    assert not elsewhere.success


def test_finer_certificate_sees_what_a_coarse_one_misses() -> None:
    def sliver(states: np.ndarray) -> np.ndarray:
        return np.abs(states[:, 0] - 0.123456) > 1e-4

    problem = Problem([0, 0], [1, 1], [0, 0], [1, 0], sliver, resolution=0.1)
    curve = smooth(Problem([0, 0], [1, 1], [0, 0], [1, 0], lambda x: x[:, 0] >= 0), Path([[0, 0], [1, 0]]))
    for path in (Path([[0, 0], [1, 0]]), curve):
        assert certify(problem, path).success
        assert not certify(problem, path, resolution=1e-5).success


def test_wrong_size_is_named() -> None:
    problem = Problem([0, 0], [1, 1], [0, 0], [1, 0], left_half)
    with pytest.raises(InvalidValueError, match="path: got 1 coordinates, expected 2 coordinates"):
        certify(problem, Path([[0.0], [1.0]]))
