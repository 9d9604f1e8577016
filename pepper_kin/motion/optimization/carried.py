"""Kernels of torques and of the floor's wrench of a robot with loads."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from pepper_kin import symbolic
from pepper_kin.arrays import Array
from pepper_kin.collision.loads import load_parameters
from pepper_kin.dynamics.load import PARAMETERS, Loads
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest

if TYPE_CHECKING:
    import casadi


def carrying_kernels(pepper: PepperModel, quantity: str, loads: Loads) -> tuple[tuple[Kernel, Kernel], Array]:
    """Return kernels of a quantity (q, v, a) -> (outputs,) and its Jacobians, and load parameters.

    The Jacobians by q, v and a have shape (outputs, n + p) each.  With k frames, q is followed by p = 10 k
    inertial parameters of the frames' loads, shape (p,), which are returned too and not compiled in.  v and a
    have p more numbers, which are ignored; derivatives by all these additional inputs are zero.

    Args:
        pepper: The robot.
        quantity: "inverse_dynamics" or "base_wrench".
        loads: Carried loads.
    """
    frames, values = load_parameters(pepper, loads)
    return (_kernel(pepper, quantity, frames, False), _kernel(pepper, quantity, frames, True)), values.ravel()


@kept_for_robot(most=64)
def _kernel(pepper: PepperModel, *name: Any) -> Kernel:
    """Return the compiled kernel of `_function`; `name` are the other arguments of that function."""
    sources = source_digest("pepper_kin.symbolic", "pepper_kin.model", "pepper_kin.dynamics.load", __name__)
    key = f"carrying {name} of {robot_digest(pepper)} by {sources}"
    return compile_function(partial(_function, pepper, *name), key=key)


def carrying_inverse_dynamics(pepper: PepperModel, loads: Loads) -> casadi.Function:
    """Return the CasADi function (q, v, a) -> torques of a robot with loads, shape (n,) each."""
    import casadi

    frames, values = load_parameters(pepper, loads)
    state = [casadi.SX.sym(name, pepper.n) for name in ("q", "v", "a")]
    torque = _loaded(pepper, "inverse_dynamics", frames, state, casadi.DM(values.ravel()))
    return casadi.Function("carried_inverse_dynamics", state, [casadi.cse(casadi.densify(torque))])


def _function(
    pepper: PepperModel, quantity: str, frames: tuple[str, ...], derivatives: bool
) -> casadi.Function:
    import casadi

    count = PARAMETERS * len(frames)
    state = [casadi.SX.sym(name, pepper.n) for name in ("q", "v", "a")]
    more = [casadi.SX.sym(name, count) for name in ("loads", "no_v", "no_a")]
    inputs = [casadi.vertcat(*pair) for pair in zip(state, more, strict=True)]
    values = _loaded(pepper, quantity, frames, state, more[0])
    if not derivatives:
        return casadi.Function(f"carried_{quantity}", inputs, [casadi.cse(casadi.densify(values))])
    nothing = casadi.DM.zeros(values.numel(), count)
    slopes = [casadi.horzcat(casadi.jacobian(values, part), nothing) for part in state]
    slopes = [casadi.cse(casadi.densify(slope)) for slope in slopes]
    return casadi.Function(f"carried_{quantity}_derivatives", inputs, slopes)


def _loaded(pepper: PepperModel, quantity: str, frames: tuple[str, ...], state: list[Any], loads: Any) -> Any:
    """Return the expression of a quantity of the robot with loads, which are given by their parameters."""
    import casadi

    values = getattr(symbolic, quantity)(pepper)(*state)
    for k, frame in enumerate(frames):
        own = casadi.vertsplit(loads[PARAMETERS * k : PARAMETERS * (k + 1)])
        force, moment = _wrench(pepper, frame, state, own)
        if quantity == "inverse_dynamics":
            values += symbolic.frame_jacobian(pepper, frame)(state[0]).T @ casadi.vertcat(force, moment)
        else:
            place = symbolic.frame_pose(pepper, frame)(state[0])[:3, 3]
            values += casadi.vertcat(force, casadi.cross(place, force) + moment)
    return values


def _wrench(pepper: PepperModel, frame: str, state: list[Any], parameters: list[Any]) -> tuple[Any, Any]:
    """Return force and moment that a load needs about its frame's origin p, in world axes.

    With h = sum(m x), Sigma = sum(m x x^T) and I = tr(Sigma) 1 - Sigma, rotated into world axes,

        f = m (d2p/dt2 - g) + alpha x h + omega x (omega x h),
        n = h x (d2p/dt2 - g) + I alpha + omega x (I omega).
    """
    import casadi

    q, v, a = state
    mass, first, (xx, xy, xz, yy, yz, zz) = parameters[0], casadi.vertcat(*parameters[1:4]), parameters[4:]
    rows = ((yy + zz, -xy, -xz), (-xy, xx + zz, -yz), (-xz, -yz, xx + yy))
    inertia = casadi.vertcat(*(casadi.horzcat(*row) for row in rows))
    turn = symbolic.frame_pose(pepper, frame)(q)[:3, :3]
    velocity = symbolic.frame_jacobian(pepper, frame)(q) @ v
    acceleration = symbolic.frame_jacobian(pepper, frame)(q) @ a + casadi.jtimes(velocity, q, v)
    omega, alpha = velocity[3:], acceleration[3:]
    lifted, arms = acceleration[:3] - casadi.DM(pepper.inner_model.gravity.linear), turn @ first
    force = mass * lifted + casadi.cross(alpha, arms) + casadi.cross(omega, casadi.cross(omega, arms))
    spin = turn @ (inertia @ (turn.T @ omega))
    moment = casadi.cross(arms, lifted) + turn @ (inertia @ (turn.T @ alpha)) + casadi.cross(omega, spin)
    return force, moment
