"""One robot stepped by machine code, one step at a time."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels import Kernel
from pepper_kin.twin.command import Command
from pepper_kin.twin.fast.law import STRENGTH
from pepper_kin.twin.fast.loop import roll_alone
from pepper_kin.twin.fast.once import step_once
from pepper_kin.twin.fast.settle import Room
from pepper_kin.twin.integrator import Forecast, Series

Array = NDArray[np.float64]

_logger = logging.getLogger(__name__)
_SLOW = 2.0  # [s]; loading from Numba's cache takes a tenth of that
_NO_EQUATION = (np.empty((0, 0)), np.empty(0))


class SingleRobot:
    """One robot in arrays that are made once: what a loop over steps costs without making them anew.

    The numbers are those of `Engine.run` to the last bit.  Not to be shared among threads.

    Args:
        timestep: h [s].
        kernels: Of a step and of a solution; kept, as their machine code lives no longer than they do.
        law: Parameters of the joints, shape (rows, n).
        constant: What does not change in the step kernel's input.
        room: The arrays, of one lane.

    Attributes:
        timestep: h [s].
        arrays: h, addresses of the kernels, law and room: what compiled loops need to take the same steps.
    """

    def __init__(
        self, timestep: float, kernels: tuple[Kernel, Kernel], law: Array, constant: Array, room: Room
    ) -> None:
        self._kernels = kernels
        addresses = np.array([kernel.single_address for kernel in kernels])
        self._n = n = law.shape[1]
        self._fixed = (timestep, addresses, law, *room)
        self._told = room.given[: 6 * n].reshape(6, n)
        self._next = room.result[: 3 * n].reshape(3, 1, n)
        self._strength = law[STRENGTH].copy()
        room.given[6 * n :] = constant
        self._known = False
        self.timestep, self.arrays = timestep, (timestep, addresses, law, room)

    def step(self, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Advance by one step; see `Integrator.run`.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity, shape (n,).
            command: For the end of the step, shape (n,) each.
            load: Torque from elsewhere [N m or N], shape (n,).
        """
        return self._stepped(q, v, command, load, *_NO_EQUATION)

    def forecast(self, q: Array, v: Array, command: Command, load: Array) -> Forecast:
        """Return a step and the linear equation that it solves; see `Integrator.forecast`."""
        mass_hat, force = np.empty((self._n, self._n)), np.empty(self._n)
        series = self._stepped(q, v, command, load, mass_hat, force)
        return Forecast(series, mass_hat, force)

    def follow(self, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Advance by a step for each of some commands; see `Integrator.run`.

        Args:
            q: Position [rad or m], shape (n,).
            v: Velocity, shape (n,).
            command: For the end of each step, shape (T, n) each.
            load: Torque from elsewhere [N m or N], shape (T, n), or (1, n) for all steps.
        """
        position, velocity, more, outer = (_told(values) for values in (*command, load))
        steps, (h, addresses, law, room) = len(position), self.arrays
        log = np.empty((3, steps + 1, self._n))
        log[0, 0], log[1, 0] = q, v

        def job() -> int:
            return int(roll_alone(h, addresses, law, room, position, velocity, more, outer, log))

        good = self._timed(job, roll_alone, 1e-5 * steps)
        return Series(log[0, 1:], log[1, 1:], log[2, 1:], good)

    def _stepped(
        self, q: Array, v: Array, command: Command, load: Array, mass_hat: Array, force: Array
    ) -> Series:
        told = self._told
        told[0], told[1], told[2], told[3] = q, v, command.position, command.velocity
        np.multiply(command.given, self._strength, out=told[4])
        told[5] = load
        good = step_once(*self._fixed, mass_hat, force) if self._known else self._first(mass_hat, force)
        position, velocity, torque = self._next.copy()
        return Series(position, velocity, torque, int(good))

    def _first(self, mass_hat: Array, force: Array) -> bool:
        """Take the first step, which may have to wait for the machine code."""
        good: bool = self._timed(lambda: step_once(*self._fixed, mass_hat, force), step_once)
        self._known = True
        return good

    def _timed(self, job: Callable[[], Any], function: Any, expected: float = 0.0) -> Any:
        """Return what a job does, and say so if it had to wait for the machine code of a function."""
        begin, known = time.perf_counter(), len(function.signatures)
        done = job()
        duration = time.perf_counter() - begin
        if len(function.signatures) > known and duration > _SLOW + expected:
            _logger.warning("compiled the twin's steps, once on this machine, in %.1f s", duration)
        return done


def _told(values: Array) -> Array:
    """Return values in one piece that can be written to: compiled code is made for such."""
    array = np.ascontiguousarray(values, dtype=float)
    return array if array.flags.writeable else array.copy()
