"""The equation of motion of one step by Pinocchio, in place of the kernels of `step_kernel`.

The compiled loop over time calls it at an address, as it calls kernels: contacts, stops and whole runs are
the same.  Accelerations are those of the articulated-body algorithm, whose rotor inertias take up what is
implicit in the joints: (M + J + h diag(k)) a = c - k v - b + load.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import carrying
from pepper_kin.core.simulation.actuator_model import (
    CREEP,
    drive_segment,
    encoder_reading,
    friction_segment,
    servo_feedback,
    servo_gain,
    speed_torque_line,
)
from pepper_kin.core.simulation.implicit_step import RUNAWAY, SAME_FORCE
from pepper_kin.dynamics.load import PARAMETERS, Load
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import CompiledFunction
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.twin.step_kernel import Place, Variant

pinocchio = lazy_module("pinocchio")

_CALLED = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)


def on_arrays(function: CompiledFunction) -> Callable[..., Any]:
    """Return a formula of the actuator model as a function of arrays."""
    meanings: dict[str, Any] = {
        "select": np.where,
        "floor": np.floor,
        "copysign": np.copysign,
        "abs": np.abs,
        "min": np.minimum,
        "max": np.maximum,
    }
    if function is drive_segment:
        meanings["speed_torque_line"] = on_arrays(speed_torque_line)
    return FunctionType(function.python.__code__, {**function.python.__globals__, **meanings})


class PythonKernel:
    """A function of an input and an output array that is called at an address, as a kernel.

    Attributes:
        lanes: Robots of a call.
        work_size: Numbers of memory that it needs.
    """

    lanes, work_size = 1, 1

    def __init__(self, function: Callable[[Array, Array], None]) -> None:
        self._function = function
        self._sizes = (0, 0)
        self._raised: BaseException | None = None
        self._callback = _CALLED(self._call)

    def address_of(self, function: str, *, inputs: int, outputs: int, work: int) -> int:
        """Return the address of the function, for arrays of these sizes; see `Kernel.address_of`."""
        self._sizes = inputs, outputs
        return int(ctypes.cast(self._callback, ctypes.c_void_p).value or 0)

    def _call(self, read: int, written: int, work: int) -> None:
        inputs, outputs = self._sizes
        result = floats_at(written, outputs)
        result[:] = np.nan  # what fails ends the run, and `reraise` says why
        try:
            self._function(floats_at(read, inputs), result)
        except BaseException as error:  # Ctrl-C too: nothing may pass through compiled code
            self._raised = self._raised or error

    def reraise(self) -> None:
        """Raise what the function has raised first since the last time, and forget it."""
        error, self._raised = self._raised, None
        if error is not None:
            raise error


def pinocchio_steps(
    pepper: PepperModel, variant: Variant, names: tuple[str, ...], places: tuple[Place, ...]
) -> tuple[PythonKernel, PythonKernel]:
    """Return what steps and what solves: see `step_kernel.step_function` and `step_kernel.solve_function`.

    Args:
        pepper: The robot.
        variant: What the step has to take into account.
        names: Of the actuators' parameters.
        places: Entries of the mass matrix that may not be zero.

    Raises:
        InvalidValueError: for masses that are scaled.
    """
    if variant.scaled:
        raise InvalidValueError("solvers", repr(pepper.solvers), "'fast' where masses of a batch are scaled")
    rows, columns = np.array(places).T
    n, count = pepper.n, len(places)
    formulas = friction_segment, encoder_reading, servo_feedback, servo_gain, drive_segment
    friction_of, reading_of, feedback_of, gain_of, drive_of = map(on_arrays, formulas)

    local = threading.local()

    def mine(robot: PepperModel) -> tuple[Any, Any]:
        """Return a model of this thread, whose rotor inertias change from step to step, and its data."""
        if getattr(local, "robot", None) is not robot:
            local.robot, local.model = robot, robot.pinocchio_model
            local.data = local.model.createData()
        return local.model, local.data

    def step(inputs: Array, result: Array) -> None:
        q, v, q_ref, v_ref, own_torque, load = inputs[: 6 * n].reshape(6, n)
        size = 6 * n + len(names) * n
        x = dict(zip(names, inputs[6 * n : size].reshape(-1, n), strict=True))
        h, robot = float(inputs[size]), carrying(pepper, _loads(variant.load_frames, inputs[size + 1 :]))
        model, data, full, still = robot.inner_model, robot.pinocchio_data, robot.to_full(q), np.zeros(n)
        gravity = pinocchio.computeGeneralizedGravity(pepper.inner_model, pepper.pinocchio_data, full).copy()
        bias = pinocchio.nonLinearEffects(model, data, full, robot.rate_to_full(v))
        mass = pinocchio.crba(model, data, full)  # the upper half
        if robot.is_coupled:
            upper, full_map = np.triu(mass), robot.full_map
            mass = full_map.T @ (upper + np.triu(upper, 1).T) @ full_map
            gravity, bias = gravity @ full_map, bias @ full_map
        friction, stick = friction_of(x["coulomb"], v) if variant.motor else (still, still)
        stick = stick + x.get("viscous", 0.0)
        reading = reading_of(x["resolution"], q) if variant.motor else q
        servo = (
            feedback_of(x["kp"], x["kd"], q_ref - reading, v_ref) + own_torque + x["feedforward"] * gravity
        )
        gain, motor = gain_of(h, x["kp"], x["kd"]), (x["limit"], x.get("stall", np.inf), x.get("line", 0.0))
        _, intercept, slope = drive_of(servo, gain, *motor, v)
        implicit = x.get("rotor", 0.0) + h * (slope + stick)
        force = intercept - friction - (slope + stick) * v + load
        if robot.is_coupled:
            a = np.linalg.solve(mass + np.diag(implicit), force - bias)
        else:
            own, own_data = mine(robot)
            own.armature = model.armature + implicit
            a = pinocchio.aba(own, own_data, q, v, force)
        w = v + h * a
        end = q + h * w
        torque = drive_of(servo, gain, *motor, w)[0]
        wrong = [
            np.maximum(end, q) - x["upper"],
            x["lower"] - np.minimum(end, q),
            np.abs(w) - RUNAWAY,
            np.abs(intercept - slope * w - torque) - SAME_FORCE,
        ]
        if variant.motor:
            turned = CREEP - np.copysign(1.0, v) * w
            wrong.append(x["coulomb"] * np.where(np.abs(v) <= CREEP, np.abs(w) - CREEP, turned))
        result[: 5 * n] = np.concatenate([end, w, torque, servo, bias])
        result[5 * n : 5 * n + count] = mass[columns, rows]
        result[-1] = np.max(wrong)

    def solve(inputs: Array, result: Array) -> None:
        mass = np.zeros((n, n))
        mass[rows, columns] = mass[columns, rows] = inputs[:count]
        extra, right = inputs[count:].reshape(2, n)
        result[:] = np.linalg.solve(mass + np.diag(extra), right)

    return PythonKernel(step), PythonKernel(solve)


def _loads(frames: tuple[str, ...], parameters: Array) -> tuple[Load, ...]:
    """Return what frames carry, by mass m, m c and second moments about the frames' origins."""
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
