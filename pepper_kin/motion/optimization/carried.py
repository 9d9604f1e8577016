"""Kernels of what point masses at frames add to torques and to the wrench of the floor, for each kilogram."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, RobotMemory, robot_digest

if TYPE_CHECKING:
    import casadi

_kept: RobotMemory[tuple[str, tuple[str, ...], bool], Kernel] = RobotMemory()


def carrying_kernels(pepper: PepperModel, quantity: str, frames: tuple[str, ...]) -> tuple[Kernel, Kernel]:
    """Return a quantity (q, v, a) -> (outputs,), and its derivatives by each, shape (outputs, n) three times.

    The quantity of the robot alone comes first, then what 1 kg at each frame adds: J_p^T (d2p/dt2 - g) of
    "inverse_dynamics", (f, p x f) with f = d2p/dt2 - g of "base_wrench".  No mass is compiled in.

    Args:
        pepper: The robot.
        quantity: "inverse_dynamics" or "base_wrench".
        frames: Where the masses are.
    """
    known, found = _kept.of(pepper), []
    for derivatives in (False, True):
        name = quantity, frames, derivatives
        if name not in known:
            sources = source_digest("pepper_kin.symbolic", "pepper_kin.model", __name__)
            key = f"carrying {name} of {robot_digest(pepper)} by {sources}"
            known[name] = compile_function(partial(_function, pepper, *name), key=key)
        found.append(known[name])
    return found[0], found[1]


def _function(
    pepper: PepperModel, quantity: str, frames: tuple[str, ...], derivatives: bool
) -> casadi.Function:
    import casadi

    from pepper_kin import symbolic

    state = [casadi.SX.sym(name, pepper.n) for name in ("q", "v", "a")]
    q, v, a = state
    parts = [getattr(symbolic, quantity)(pepper)(*state)]
    for frame in frames:
        place = symbolic.frame_pose(pepper, frame)(q)[:3, 3]
        jacobian = symbolic.frame_jacobian(pepper, frame)(q)[:3, :]
        force = jacobian @ a + casadi.jtimes(jacobian @ v, q, v)
        force -= casadi.DM(pepper.inner_model.gravity.linear)
        pull = jacobian.T @ force if quantity == "inverse_dynamics" else None
        parts.append(casadi.vertcat(force, casadi.cross(place, force)) if pull is None else pull)
    values = casadi.vertcat(*parts)
    if not derivatives:
        return casadi.Function(f"carried_{quantity}", state, [casadi.cse(casadi.densify(values))])
    slopes = [casadi.cse(casadi.densify(casadi.jacobian(values, part))) for part in state]
    return casadi.Function(f"carried_{quantity}_derivatives", state, slopes)
