"""OMPL's RRT-Connect over this library's compiled check, by the shortest callbacks that its binding takes.

The binding of OMPL 2.0 takes no address of a compiled function, only callables of Python: one that is asked
for each state, or a motion validator that is asked for each edge.
"""

from __future__ import annotations

import ctypes
import time
from typing import Any

import numpy as np
from ompl import base, geometric, util

from pepper_kin import planners

_CHECK = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 2, ctypes.c_int64, ctypes.c_void_p)


class CompiledOmpl:
    """One search, whose callbacks read the numbers of states and call the compiled check, and nothing else.

    Args:
        problem: The problem, whose validity is machine code.
        by_edge: Whether a motion validator is asked for edges; else states are asked for, as OMPL does.

    Attributes:
        inside: Time within callbacks [s].
        calls: Number of callbacks.
    """

    def __init__(self, problem: planners.Problem, *, by_edge: bool) -> None:
        code = problem.validity
        assert isinstance(code, planners.CompiledMotionValidator)
        n, self.inside, self.calls = problem.n, 0.0, 0
        self._check, self._code, self._memory = _CHECK(code.address), code, code.fresh_memory()
        self._places, self._scale = range(n), (1.0 / problem.metric.weights).tolist()
        self._ends = (ctypes.c_double * n)(), (ctypes.c_double * n)()
        self._at = *map(ctypes.addressof, self._ends), self._memory.ctypes.data
        self._step = problem.spacing
        self.space = space = base.RealVectorStateSpace(n)
        bounds = base.RealVectorBounds(n)
        for i in self._places:
            bounds.setLow(i, problem.lower[i] * problem.metric.weights[i])
            bounds.setHigh(i, problem.upper[i] * problem.metric.weights[i])
        space.setBounds(bounds)
        self._setup = setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(self._valid)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(problem.spacing / space.getMaximumExtent())
        if by_edge:
            self._edges = _edges_of(self, information)
            information.setMotionValidator(self._edges)
        ends = []
        for values in (problem.start, problem.goals[0]):
            state = space.allocState()
            for i in self._places:
                state[i] = values[i] * problem.metric.weights[i]
            ends.append(state)
        setup.setStartAndGoalStates(*ends)
        setup.setPlanner(geometric.RRTConnect(information))

    def solve(self, seconds: float) -> bool:
        """Search for so long [s] at most; return whether there is a path."""
        util.setLogLevel(util.LOG_NONE)
        self._setup.solve(seconds)
        return bool(self._setup.haveExactSolutionPath())

    def _valid(self, state: Any) -> bool:
        begin = time.perf_counter()
        (first, _), (at, _, memory) = self._ends, self._at
        first[:] = [state[i] * scale for i, scale in enumerate(self._scale)]
        found = self._check(at, at, 1, memory) == 1
        self.calls += 1
        self.inside += time.perf_counter() - begin
        return found

    def edge_valid(self, a: Any, b: Any) -> bool:
        """Return whether the states of an edge are valid, the first one aside."""
        begin = time.perf_counter()
        (first, last), (at_first, at_last, memory) = self._ends, self._at
        first[:] = [a[i] * scale for i, scale in enumerate(self._scale)]
        last[:] = [b[i] * scale for i, scale in enumerate(self._scale)]
        steps = int(np.ceil(self.space.distance(a, b) / self._step)) or 1
        found = self._check(at_first, at_last, steps, memory) == steps
        self.calls += 1
        self.inside += time.perf_counter() - begin
        return found


def _edges_of(search: CompiledOmpl, information: Any) -> Any:
    """Return OMPL's validator of motions that asks a search for whole edges."""

    class Edges(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:  # noqa: N802
            return search.edge_valid(a, b)

    return Edges(information)
