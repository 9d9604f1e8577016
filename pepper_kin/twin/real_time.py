"""The twin synchronized with the wall clock, for interactive use."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.twin.run_status import RunStatus
from pepper_kin.twin.state import TwinState

if TYPE_CHECKING:
    from pepper_kin.twin.twin import Twin

Commander = Callable[[TwinState], ArrayLike | None]


@dataclass(frozen=True, eq=False)
class Timing(FrozenArrays):
    """Timing of a real-time run; arrays are read-only.

    Attributes:
        period: Requested time from tick to tick [s].
        late: Delay of each tick's state after its due time [s], shape (ticks,); zero or more.
        busy: Computing time of each tick [s], shape (ticks,).
        message: Reason of the end; empty if the time was up or the commander ended the run.
    """

    period: float
    late: NDArray[np.float64]
    busy: NDArray[np.float64]
    message: str = ""

    def __post_init__(self) -> None:
        for name in ("late", "busy"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.late)

    @property
    def jitter(self) -> float:
        """Standard deviation of the lateness [s]."""
        return float(np.std(self.late)) if len(self) else 0.0

    @property
    def overruns(self) -> int:
        """Number of ticks that took longer than a period."""
        return int(np.sum(self.busy > self.period))

    @property
    def real_time_factor(self) -> float:
        """Simulated time over computing time, the possible speed relative to the wall clock."""
        return float(self.period * len(self) / np.sum(self.busy)) if len(self) else float("nan")

    def report(self) -> str:
        """Return the figures in words."""
        if not len(self):
            return "no tick was made" + (f": {self.message}" if self.message else "")
        late = 1e3 * np.array([np.median(self.late), np.percentile(self.late, 99), self.late.max()])
        return (
            f"{len(self)} ticks of {1e3 * self.period:g} ms; late by {late[0]:.3f} ms in the median, "
            f"{late[1]:.3f} ms at the 99th percentile, at most {late[2]:.3f} ms; jitter "
            f"{1e3 * self.jitter:.3f} ms; {self.overruns} overruns; could go {self.real_time_factor:.0f} "
            "times as fast" + (f"; ended: {self.message}" if self.message else "")
        )


def run_real_time(
    twin: Twin,
    commander: Commander,
    *,
    period: float = 0.01,
    duration: float | None = None,
    on_state: Callable[[TwinState], None] | None = None,
) -> Timing:
    """Step a twin in time with the wall clock.

    At every tick the commander gets the state and returns the joint positions for the next tick; the
    reference moves there evenly.  The loop sleeps for the rest of the tick.  Late ticks are not caught up:
    the clock is reset when it is a whole period behind.

    Args:
        twin: The twin, which starts in its present state.
        commander: Function from the state to target positions [rad or m], shape (n,); None ends the run.
        period: Time from tick to tick [s], a multiple of the twin's timestep.
        duration: Duration of the run [s]; until the commander returns None if omitted.
        on_state: Function that gets the state after each tick, to draw or to send it.

    Returns:
        The timing; its message names the reason if a step diverged.

    Raises:
        InvalidValueError: for a period that is not a multiple of the timestep, or invalid positions of the
            commander.
    """
    period = check_positive("period", period, "s")
    steps = round(period / twin.timestep)
    if steps < 1 or abs(steps * twin.timestep - period) > 1e-9:
        raise InvalidValueError("period", f"{period} s", f"a multiple of the timestep, {twin.timestep} s")
    ticks = None if duration is None else round(check_positive("duration", duration, "s") / period)
    share = np.arange(1, steps + 1)[:, np.newaxis] / steps
    late: list[float] = []
    busy: list[float] = []
    message, wanted_before = "", np.array(twin.state.position)
    due = time.perf_counter()
    while ticks is None or len(late) < ticks:
        due += period
        begin = time.perf_counter()
        answer = commander(twin.state)
        if answer is None:
            break
        wanted = np.asarray(answer, dtype=float)
        if wanted.shape != (twin.pepper.n,) or not np.isfinite(wanted).all():
            allowed = f"{twin.pepper.n} finite numbers, or None"
            raise InvalidValueError("position from the commander", answer, allowed)
        reference = wanted_before + share * (wanted - wanted_before)
        run = twin.follow(reference, np.tile((wanted - wanted_before) / period, (steps, 1)))
        wanted_before = wanted
        if on_state is not None:
            on_state(twin.state)
        end = time.perf_counter()
        busy.append(end - begin)
        if run.status is RunStatus.STOPPED:
            message = run.message
            late.append(max(end - due, 0.0))
            break
        while (left := due - time.perf_counter()) > 0:
            time.sleep(left if left > 2e-4 else 0.0)  # the system may wake late: poll near the end
        late.append(max(time.perf_counter() - due, 0.0))
        if late[-1] > period:
            due = time.perf_counter()
    return Timing(period, np.array(late), np.array(busy), message)
