"""Validity of states and motions: a planner's only access to the world.

A planner has no access to obstacles, joints or links.  It has one query, "how far along this edge are states
valid?", answered by a C function at an address: machine code (`CompiledMotionValidator`), or a
`MotionValidator` that calls a Python callable (`StateValidityChecker`) for batches of states.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_four, floats_at
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2

from .deadline import Deadline
from .metric import Metric
from .search_space import CALLS, STATES, STOP
from .vectors import BoolArray, FloatArray, positive_number, real_numbers, whole_number

if TYPE_CHECKING:
    from .problem import Problem

MAX_BATCH = 256
"""Maximum number of states passed in one call: a time budget can be overrun by so many."""

_FIRST_BATCH = 24
_GROWTH = 4

_Signature = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
)


@runtime_checkable
class StateValidityChecker(Protocol):
    """Callable that a user supplies: the validity of a batch of states.

    It receives a C-contiguous float64 array of shape (m, n) with m >= 1, which it must not modify, and
    returns a boolean array of shape (m,), True where the state is valid.  The result for a state must always
    be the same.
    """

    def __call__(self, states: FloatArray, /) -> BoolArray:
        """Return which of the states are valid."""
        ...


@compiled("void(int64, float64[::1], float64[:, ::1], boolean[::1])")
def _check_states(address: int, memory: Floats1, states: Floats2, answers: Flags1) -> None:
    """Write which states, shape (m, n), are valid into `answers`, shape (m,)."""
    for j in range(states.shape[0]):
        place = states[j].ctypes.data
        answers[j] = call_four(address, place, place, 1, memory.ctypes.data) == 1


def _no_memory() -> FloatArray:
    """Return memory of one unused number."""
    return np.zeros(1)


@dataclass(frozen=True, eq=False)
class CompiledMotionValidator:
    """A validity function that planners call by its address, without Python.

    At the address is a C function

        int64_t last_valid_step(const double *a, const double *b, int64_t steps, double *memory)

    which tests the states ``a + (b - a) j / steps`` for j = 1 .. steps (the last one is exactly b; a itself
    is not tested), or more states that are spaced evenly, and returns `steps` if all are valid, else less.
    It may test the states in any order: an obstacle is found soonest if the first states are spread over the
    edge.  It must not keep the addresses, and must return the same result for the same arguments.  Several
    threads may call it at once, each with its own memory.

    The object is also a callable over a batch of states (see `StateValidityChecker`).

    Attributes:
        address: Address of the function.
        n: Number of coordinates of a state.
        new_memory: Function that returns new memory for one thread: a C-contiguous float64 array of one or
            more entries.
        keep_alive: Object that must live as long as the address is used (the library, the scene's tables);
            held here and not used otherwise.
    """

    address: int
    n: int
    new_memory: Callable[[], FloatArray] = field(default=_no_memory)
    keep_alive: object = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            InvalidValueError: The address is not an address, or there is no coordinate.
        """
        for name in ("address", "n"):
            object.__setattr__(self, name, whole_number(name, getattr(self, name), 1, math.inf))
        if not callable(self.new_memory):
            raise InvalidValueError("new_memory", self.new_memory, "a callable that returns a float64 array")

    def fresh_memory(self) -> FloatArray:
        """Return new memory, checked.

        Raises:
            InvalidValueError: `new_memory` did not return a C-contiguous float64 vector.
        """
        memory = self.new_memory()
        if (
            not isinstance(memory, np.ndarray)
            or memory.dtype != np.float64
            or memory.ndim != 1
            or memory.size == 0
            or not memory.flags.carray
        ):
            raise InvalidValueError("memory", type(memory), "a writeable float64 array of shape (m,), m >= 1")
        return memory

    def __call__(self, states: FloatArray, /) -> BoolArray:
        """Return which states, shape (m, n), are valid; shape (m,).

        Raises:
            InvalidValueError: The states have another number of coordinates.
        """
        batch = np.array(states, dtype=np.float64, order="C")
        if batch.ndim != 2 or batch.shape[1] != self.n:
            raise InvalidValueError("states", f"shape {batch.shape}", f"shape (m, {self.n})")
        answers = np.empty(len(batch), dtype=np.bool_)
        _check_states(self.address, self.fresh_memory(), batch, answers)
        return answers


class MotionValidator:
    """A validity checker with the metric and resolution at which edges are checked, and counters.

    Edges are checked at states no further apart than the resolution, so each point of an edge found valid
    lies within half the resolution of a state that was checked.  If the invalid set is grown by half the
    resolution (measured in the metric), a valid edge is valid at every point; without that margin it may
    cut a corner.

    When the time budget runs out, states that have not been checked count as not valid: no result is guessed.

    Attributes:
        metric: The metric of the edges.
        resolution: Maximum distance between checked states of an edge [length unit of the metric].
        deadline: Time budget.
        calls: Number of calls of the checker so far.
        states: Number of states tested so far.
    """

    def __init__(
        self,
        valid: StateValidityChecker,
        metric: Metric,
        resolution: float,
        deadline: Deadline | None = None,
    ) -> None:
        """Wrap a validity checker.

        Args:
            valid: The checker.
            metric: The metric of the edges.
            resolution: Maximum distance between checked states of an edge [length unit of the metric].
            deadline: Time budget; none if omitted.

        Raises:
            InvalidValueError: The checker is not callable or the resolution is not above zero.
        """
        if not callable(valid):
            raise InvalidValueError("validity", valid, "a callable over states of shape (m, n)")
        self._valid = valid
        self.deadline = Deadline() if deadline is None else deadline
        self.metric = metric
        self.resolution = positive_number("resolution", resolution)
        self.calls = 0
        self.states = 0

    def states_valid(self, states: FloatArray) -> BoolArray:
        """Return which states are valid, by one call of the checker.

        Args:
            states: States, shape (m, n).

        Returns:
            True where valid, shape (m,).

        Raises:
            InvalidValueError: The states have another shape, or the checker did not return (m,) booleans.
        """
        states = np.ascontiguousarray(real_numbers("states", states))
        if states.ndim != 2 or states.shape[1] != self.metric.n:
            raise InvalidValueError("states", f"shape {states.shape}", f"shape (m, {self.metric.n})")
        answer = np.asarray(self._valid(states))
        self.calls += 1
        self.states += len(states)
        if answer.shape != (len(states),) or answer.dtype != np.bool_:
            got = f"{answer.dtype} of shape {answer.shape} for {len(states)} states"
            raise InvalidValueError("answer of the checker", got, f"bool of shape ({len(states)},)")
        return answer

    def last_valid_step(self, a: FloatArray, b: FloatArray, steps: int) -> int:
        """Return how many states ``a + (b - a) j / steps``, j = 1 .. steps, are valid from the first on.

        Args:
            a: Start of the edge, shape (n,).
            b: End of the edge, shape (n,).
            steps: Number of steps, one or more.

        Raises:
            InvalidValueError: for ends of another shape or an invalid number of steps.
        """
        steps, shape = whole_number("steps", steps, 1), (self.metric.n,)
        for name, end in (("a", a), ("b", b)):
            if not isinstance(end, np.ndarray) or end.shape != shape:
                raise InvalidValueError(name, end, f"an array of shape {shape}")
        difference = b - a
        for batch in self._batches(steps):
            fractions = np.arange(batch.start + 1, batch.stop + 1) / steps
            states = a + fractions[:, None] * difference
            if batch.stop == steps:
                states[-1] = b
            if self.deadline.expired:
                return batch.start
            valid = self.states_valid(states)
            if not valid.all():
                return batch.start + int(np.argmin(valid))
        return steps

    @staticmethod
    def _batches(count: int) -> Iterator[slice]:
        """Yield slices of up to `MAX_BATCH` states, the first ones smaller."""
        start, size = 0, _FIRST_BATCH
        while start < count:
            stop = min(start + size, count)
            yield slice(start, stop)
            start, size = stop, min(size * _GROWTH, MAX_BATCH)


class ValidatorCallback:
    """A `MotionValidator` behind the address of a C function; used in a `with` block around the planner.

    An exception cannot pass through machine code: after one every state is invalid, the planner has to stop,
    and the exception is raised when the block ends.  The planner also has to stop when time has run out.

    Attributes:
        code: The validity function, which calls the validator.
    """

    def __init__(self, validator: MotionValidator, n: int, counters: np.ndarray | None = None) -> None:
        """Make the C function.

        Args:
            validator: The validator that is called.
            n: Number of coordinates.
            counters: Counters of the planner, integers, shape (k,) with k > STOP; counters[STOP] is set when
                the planner has to stop.
        """
        self._validator, self._n = validator, n
        self._counters = np.zeros(STOP + 1, dtype=np.int64) if counters is None else counters
        self._before = self._counters[: CALLS + 1].copy()
        self._error: BaseException | None = None
        function = _Signature(self._answer)
        address = ctypes.cast(function, ctypes.c_void_p).value or 0
        self.code = CompiledMotionValidator(address, n, keep_alive=function)

    def __enter__(self) -> CompiledMotionValidator:
        """Return the validity function."""
        self._before = self._counters[: CALLS + 1].copy()
        return self.code

    def __exit__(self, *_: object) -> None:
        """Raise the checker's exception; add the numbers of its calls and states to the counters."""
        validator, counters = self._validator, self._counters
        counters[STOP] = 0
        counters[STATES] = self._before[STATES] + validator.states
        counters[CALLS] = self._before[CALLS] + validator.calls
        if self._error is not None:
            raise self._error

    def _answer(self, a: int, b: int, steps: int, memory: int) -> int:
        """Call the validator back from machine code; 0 after an exception."""
        if self._error is not None:
            return 0
        try:
            found = self._validator.last_valid_step(floats_at(a, self._n), floats_at(b, self._n), steps)
            if self._validator.deadline.expired:
                self._counters[STOP] = 1
            return found
        except BaseException as error:  # also an interrupt from the keyboard
            self._error = error
            self._counters[STOP] = 1
            return 0


def machine_code_of(
    problem: Problem,
    deadline: Deadline,
    resolution: float | None = None,
    counters: np.ndarray | None = None,
) -> AbstractContextManager[CompiledMotionValidator]:
    """Return a context whose value is the problem's validity as a C function.

    Args:
        problem: The problem.
        deadline: Time budget of a Python checker; states not checked in time count as not valid.
        resolution: Resolution other than the problem's [length unit of the metric].
        counters: Counters of the planner, integers, shape (k,), see `ValidatorCallback`.
    """
    if isinstance(problem.validity, CompiledMotionValidator):
        return nullcontext(problem.validity)
    return ValidatorCallback(problem.validator(deadline, resolution), problem.n, counters)
