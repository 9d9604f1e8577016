"""The equation of motion of one step by Pinocchio, in place of the kernels of `step_kernel`.

The compiled time loop calls it at an address, like kernels, so that contacts, stops and whole runs are the
same.  In (M + J + h diag(k)) a = c - k v - b + load, M comes from the composite-rigid-body algorithm, and b
is Pinocchio's bias; LAPACK solves the system by a Cholesky factorization, in an eighth of the time that the
articulated-body algorithm of Pinocchio's wheel takes for 15 joints.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import carrying
from pepper_kin.dynamics.load import PARAMETERS, Load
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import Kernel
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.twin.step_kernel import Place, Variant

pinocchio, lapack = lazy_module("pinocchio"), lazy_module("scipy.linalg.lapack")

_CALLED = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)

MOST_ARRAYS = 64
"""Maximum number of cached memory views of a function called at an address, two for each workspace."""


class PythonKernel:
    """A Python function of an input and an output array that is called at an address, like a kernel.

    Attributes:
        lanes: Number of robots of a call.
        work_size: Size of the work memory.
    """

    lanes, work_size = 1, 1

    def __init__(self, function: Callable[[Array, Array], None]) -> None:
        self._function = function
        self._sizes = (0, 0)
        self._arrays: dict[tuple[int, int], Array] = {}
        self._raised: BaseException | None = None
        self._callback = _CALLED(self._call)

    def address_of(self, function: str, *, inputs: int, outputs: int, work: int) -> int:
        """Return the address of the function, for arrays of the given sizes; see `Kernel.address_of`."""
        self._sizes = inputs, outputs
        return int(ctypes.cast(self._callback, ctypes.c_void_p).value or 0)

    def _call(self, read: int, written: int, work: int) -> None:
        inputs, outputs = self._sizes
        result = self._array(written, outputs)
        result[-1] = np.nan  # a failure ends the run, and `reraise` tells why
        try:
            self._function(self._array(read, inputs), result)
        except BaseException as error:  # Ctrl-C too: nothing may pass through compiled code
            result[:] = np.nan
            self._raised = self._raised or error

    def _array(self, address: int, size: int) -> Array:
        """Return a cached array view of the memory at an address."""
        found = self._arrays.get((address, size))
        if found is None:
            if len(self._arrays) >= MOST_ARRAYS:
                self._arrays.clear()
            found = self._arrays[address, size] = floats_at(address, size)
        return found

    def reraise(self) -> None:
        """Raise the first error of the function since the last call of `reraise`, and clear it."""
        error, self._raised = self._raised, None
        if error is not None:
            raise error


class _Thread(threading.local):
    """Working data of one thread.

    Attributes:
        loads: Parameters of the carried loads, as bytes.
        robot: The robot with these loads.
        inputs: Inputs of both drive kernels: the step's inputs without loads, gravity, accelerations.
        force: Output of the first kernel: force, implicit and servo, shape (3, n).
        ends: Output of the second kernel, shape (3 n + 1,).
        parts: Parts of `inputs`: the step's inputs, gravity, accelerations.
        work: Work memory of both kernels.
    """

    def __init__(self, before: Kernel, after: Kernel, n: int) -> None:
        self.loads = b"none"
        self.robot: PepperModel | None = None
        self.inputs = np.empty(sum(after.signature.input_sizes))
        self.force, self.ends = np.empty((3, n)), np.empty(3 * n + 1)
        self.work = np.empty(max(before.work_size, after.work_size))
        self.parts = np.split(self.inputs, [self.inputs.size - 2 * n, self.inputs.size - n])
        self.addresses = [x.ctypes.data for x in (self.inputs, self.force, self.ends, self.work)]


def pinocchio_steps(
    pepper: PepperModel, variant: Variant, before: Kernel, after: Kernel, places: tuple[Place, ...]
) -> tuple[PythonKernel, PythonKernel]:
    """Return kernels for a step and a solve, see `step_kernel.step_function` and `solve_function`.

    Args:
        pepper: The robot.
        variant: Features that the step has to include.
        before: Kernel of the actuators, see `step_kernel.drive_functions`.
        after: Kernel of the quantities that follow from the accelerations.
        places: Entries of the mass matrix that may not be zero.

    Raises:
        InvalidValueError: for scaled masses.
    """
    if variant.scaled:
        raise InvalidValueError("solvers", repr(pepper.solvers), "'fast' where masses of a batch are scaled")
    upper_rows, upper_columns = np.sort(np.array(places)).T
    n, count = pepper.n, len(places)
    thread, coupled = _Thread(before, after, n), pepper.is_coupled  # the closures keep the kernels alive, too
    size, work_size = thread.inputs.size - 2 * n, thread.work.size
    drive, end = (
        _CALLED(kernel.address_of("single", inputs=read, outputs=written, work=work_size))
        for kernel, read, written in ((before, size + n, 3 * n), (after, size + 2 * n, 3 * n + 1))
    )

    def robot_of(loads: Array) -> PepperModel:
        robot = carrying(pepper, _loads(variant.load_frames, loads))
        thread.loads, thread.robot = loads.tobytes(), robot
        return robot

    def step(inputs: Array, result: Array) -> None:
        robot, (given, own_gravity, acceleration) = thread.robot, thread.parts
        if robot is None or (variant.load_frames and inputs[size:].tobytes() != thread.loads):
            robot = robot_of(inputs[size:])
        q, v, full, rate = inputs[:n], inputs[n : 2 * n], inputs[:n], inputs[n : 2 * n]
        if coupled:
            full, rate = robot.to_full(q), robot.rate_to_full(v)
        model, data = robot.inner_model, robot.pinocchio_data
        gravity = pinocchio.computeGeneralizedGravity(pepper.inner_model, pepper.pinocchio_data, full)
        given[:] = inputs[:size]
        own_gravity[:] = gravity @ robot.full_map if coupled else gravity
        bias = pinocchio.nonLinearEffects(model, data, full, rate)
        mass = pinocchio.crba(model, data, full)  # the upper half
        if coupled:
            upper, full_map = np.triu(mass), robot.full_map
            mass = full_map.T @ (upper + np.triu(upper, 1).T) @ full_map
            bias = bias @ full_map
        at_inputs, at_force, at_ends, work = thread.addresses
        drive(at_inputs, at_force, work)
        force, implicit, servo = thread.force
        acceleration[:] = _solved(mass, implicit, force - bias)
        end(at_inputs, at_ends, work)
        result[: 3 * n], result[3 * n : 4 * n], result[4 * n : 5 * n] = thread.ends[:-1], servo, bias
        result[5 * n : 5 * n + count] = mass[upper_rows, upper_columns]
        result[-1] = thread.ends[-1]

    def solve(inputs: Array, result: Array) -> None:
        mass = np.zeros((n, n), order="F")
        mass[upper_rows, upper_columns] = inputs[:count]
        result[:] = _solved(mass, *inputs[count:].reshape(2, n))

    return PythonKernel(step), PythonKernel(solve)


def _solved(mass: Array, extra: Array, right: Array) -> Array:
    """Return x of (M + diag(extra)) x = right, NaN if the matrix is not positive definite.

    Args:
        mass: Matrix M, shape (n, n), of which the upper half is read.
        extra: Addition to the diagonal, shape (n,).
        right: Right-hand side, shape (n,).
    """
    matrix = np.array(mass, order="F")
    matrix.ravel("K")[:: len(matrix) + 1] += extra
    _, found, failed = lapack.dposv(matrix, right, overwrite_a=True)
    return np.full_like(right, np.nan) if failed else np.asarray(found)


def _loads(frames: tuple[str, ...], parameters: Array) -> tuple[Load, ...]:
    """Return the frames' loads from mass m, m c and second moments about the frames' origins."""
    found = []
    for frame, own in zip(frames, parameters.reshape(-1, PARAMETERS), strict=True):
        mass, first, (xx, xy, xz, yy, yz, zz) = float(own[0]), own[1:4], own[4:]
        if mass > 0.0:
            center = first / mass
            second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * np.outer(center, center)
            about = np.trace(second) * np.eye(3) - second
            places = (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)
            found.append(Load(frame, mass, tuple(center.tolist()), tuple(about[places].tolist())))
    return tuple(found)
