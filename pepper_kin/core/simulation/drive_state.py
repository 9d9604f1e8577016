"""Backlash and heat of joints' drives: the state of an actuator from step to step.

* Backlash b, half the play: the servo holds the joint at p instead of q_ref, by the play operator
  p+ = clip(p, q_ref - b, q_ref + b).  While p rests, the reference velocity is zero.
* Heat: the temperature of the windings is theta = (T - T_ambient) / (T_hottest - T_ambient), where T_hottest
  is the final temperature at the continuous torque tau_c.  With the time constant T_th, exactly for a
  constant torque,
      theta+ = r + (theta - r) exp(-h / T_th),   r = (tau / tau_c)^2.

  From theta = `WARM` on, the torque limit is min(limit, tau_c / s), s = (theta - WARM) / (1 - WARM), and
  tau_c from theta = 1 on: it falls continuously, and a permanent torque demand ends at tau_c.

Pepper's motors lose stiffness, their ratio of the torque, in the same way once they are hot (NAOqi's
documentation of ALBodyTemperature: "automatic limitation of the Stiffness"); its figures are not published.

Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), for the play operator.
"""

from __future__ import annotations

import math

from pepper_kin.core.simulation.actuator_model import CONTINUOUS, LIMIT, PLAY, ActuatorTable
from pepper_kin.core.simulation.implicit_step import (
    ALIVE,
    CONSTANT,
    CONSTANT_LIMIT,
    Q_REF,
    TORQUE,
    V_REF,
    RobotTables,
    StepWorkspace,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats3

WARM = 0.8
"""Temperature theta from which the torque limit falls (assumed)."""

# Rows of `RobotTables.law` after the parameters: the position that the joint is held at, NaN after a reset,
# the temperature, its decay factor per step, and the torque limit of the cold motor.
HELD = len(ActuatorTable._fields)
TEMPERATURE, DECAY, COLD_LIMIT = HELD + 1, HELD + 2, HELD + 3


@compiled(lean=True)
def remembers(law: Floats3) -> bool:
    """Return whether any drive has backlash or heats up, from `RobotTables.law`, shape (blocks, rows, m)."""
    return law.shape[1] > HELD


@compiled(lean=True)
def hold_in_play(b: int, law: Floats3, step_input: Floats1) -> None:
    """Replace the references of the joints with backlash of block b by the held positions.

    Args:
        b: Index of the block.
        law: Parameters and states, see `RobotTables`.
        step_input: Input of the step, changed, see `StepWorkspace`.
    """
    m = law.shape[2]
    for e in range(m):
        half = law[b, PLAY, e]
        if half > 0.0:
            held, wanted = law[b, HELD, e], step_input[Q_REF * m + e]
            if math.isnan(held):
                held = step_input[e]
            moved = min(max(held, wanted - half), wanted + half)
            step_input[Q_REF * m + e] = moved
            if moved == held:
                step_input[V_REF * m + e] = 0.0


@compiled(lean=True)
def remember(b: int, robots: RobotTables, space: StepWorkspace) -> None:
    """Store held positions and temperatures after a good step of block b, and derate hot motors."""
    law, m, step_input = robots.law, robots.law.shape[2], space.step_input
    for e in range(m):
        if space.flags[ALIVE, e % robots.lanes]:
            law[b, HELD, e] = step_input[Q_REF * m + e]
            load = space.step_output[TORQUE * m + e] / law[b, CONTINUOUS, e]
            source = load * load
            theta = source + (law[b, TEMPERATURE, e] - source) * law[b, DECAY, e]
            share, limit = (theta - WARM) / (1.0 - WARM), law[b, COLD_LIMIT, e]
            if share > 0.0:
                limit = min(limit, law[b, CONTINUOUS, e] / min(share, 1.0))
            law[b, TEMPERATURE, e], law[b, LIMIT, e] = theta, limit
            step_input[CONSTANT_LIMIT * m + e] = limit
            robots.constant[b, (CONSTANT_LIMIT - CONSTANT) * m + e] = limit
