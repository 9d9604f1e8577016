"""A problem as compiled planners that build graphs take it."""

from __future__ import annotations

import math

from .compiled_validity import CompiledValidity
from .native_world import World
from .problem import Problem


def world_of(problem: Problem, oracle: CompiledValidity, resolution: float, reach: float = math.inf) -> World:
    """Return box, metric and oracle of a problem, with fresh memory for the oracle.

    Args:
        problem: The problem.
        oracle: Its oracle as a C function.
        resolution: Greatest distance between checked states of an edge [length unit of the metric].
        reach: Greatest length of an extension [length unit of the metric].
    """
    return World(
        address=oracle.address,
        memory=oracle.fresh_memory(),
        resolution=float(resolution),
        lower=problem.lower.copy(),
        extent=problem.upper - problem.lower,
        weights=problem.metric.weights.copy(),
        reach=float(reach),
    )
