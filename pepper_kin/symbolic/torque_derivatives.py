"""Analytical derivatives of inverse dynamics, in body frames.

A small change of joint j moves all bodies outboard of it as one composite body, so the wrench changes by the
composite's inertia.  Let h, Sigma be the composite's first and second moments about the origin of body j, and
let primes be rates relative to body j, caused by the composite's inner joints: h' = sum(m x'), Pi = sum(m x'
x^T).  For changes d_omega, d_alpha, d_a of the motion of body j (at constant velocities of the joints further
out) the wrench of the composite changes by

    d_f = m d_a + d_alpha x h + d_omega x (omega x h) + omega x (d_omega x h) + 2 d_omega x h'
    d_n = h x d_a + J d_alpha + (Sigma omega) x d_omega + (Sigma d_omega) x omega + 2 (tr(Pi) - Pi) d_omega

where J = tr(Sigma) - Sigma.  Rotating joint j by d is equivalent to rotating the motion of the parent by -d
and the resulting wrench by d:  d_omega = omega x z, d_alpha = alpha x z, d_a = a x z.  A change of its
velocity is d_omega = z, d_alpha = omega x z.  Propagated inward these give the rows of the ancestors of j
("columns").  For the descendants of j the roles swap: the linear form that maps (d_omega, d_alpha, d_a) of a
body further in to the torque of a joint is propagated inward ("forms").  The result agrees with Carpentier
and Mansard, Analytical derivatives of rigid body dynamics algorithms (2018), with fewer operations, because
classical instead of spatial accelerations make linear velocities disappear.
"""

from __future__ import annotations

from dataclasses import dataclass

from pepper_kin.symbolic.bodies import Inertia
from pepper_kin.symbolic.composite import composite_inertias, unit_wrench
from pepper_kin.symbolic.inverse_dynamics import Wrench
from pepper_kin.symbolic.motion import Motion, collect, force_and_moment, motions, to_parent
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import StateExpressions
from pepper_kin.symbolic.vectors import (
    ZERO,
    ZERO_MATRIX,
    Matrix,
    Vector,
    add,
    add_matrices,
    cross,
    dot,
    outer,
    scale,
    subtract,
    times,
    times_transposed,
    trace,
    z_cross,
)

Z: Vector = (0.0, 0.0, 1.0)
Entries = dict[tuple[int, int], Value]


@dataclass(frozen=True)
class TorqueDerivatives:
    """Derivatives of the torques of all coordinates of `pinocchio_model`; missing entries are zero.

    Attributes:
        tau: The torques [N m or N].
        wrt_q: (i, j) -> d tau_i / d q_j.
        wrt_v: (i, j) -> d tau_i / d v_j.
        mass: (i, j) with j an ancestor of i, or i -> M_ij.
    """

    tau: list[Value]
    wrt_q: Entries
    wrt_v: Entries
    mass: Entries


@dataclass(frozen=True)
class _Composite:
    """A composite body and its motion.

    Attributes:
        slides: Whether the joint j is prismatic.
        motion: Motion of body j.
        inertia: m, h, Sigma.
        first_rate: h'.
        second_rate: Pi.
    """

    slides: bool
    motion: Motion
    inertia: Inertia
    first_rate: Vector
    second_rate: Matrix

    def wrench_change(self, d_omega: Vector, d_alpha: Vector, d_a: Vector) -> Wrench:
        """Return the change (d_f, d_n) of the wrench for a change of the motion."""
        h, omega, second = self.inertia.first, self.motion.omega, self.inertia.second
        rate = add(cross(omega, h), scale(2.0, self.first_rate))
        force = add(
            scale(self.inertia.mass, d_a),
            cross(d_alpha, h),
            cross(d_omega, rate),
            cross(omega, cross(d_omega, h)),
        )
        tensor = subtract(scale(trace(second), d_alpha), times(second, d_alpha))
        rates = subtract(
            scale(2.0 * trace(self.second_rate), d_omega), times(self.second_rate, scale(2.0, d_omega))
        )
        gyro = add(cross(times(second, omega), d_omega), cross(times(second, d_omega), omega))
        return force, add(cross(h, d_a), tensor, gyro, rates)

    def form(self) -> tuple[Vector, Vector, Vector]:
        """Return (f, n, d) with d tau_j = f . d_a + n . d_alpha + d . d_omega for the joint of this body."""
        f, n = unit_wrench(self.slides, self.inertia)
        h, omega = self.inertia.first, self.motion.omega
        if self.slides:
            # z . d_f as a linear form in d_omega.
            first_rate = add(cross(omega, h), scale(2.0, self.first_rate))
            return f, n, add(cross(first_rate, Z), cross(h, cross(Z, omega)))
        second, rate = self.inertia.second, self.second_rate
        across = cross(omega, Z)
        gyroscopic = add(z_cross(times(second, omega)), times(second, across))
        relative = scale(2.0, subtract(scale(trace(rate), Z), times_transposed(rate, Z)))
        return f, n, add(gyroscopic, relative)


def torque_derivatives(state: StateExpressions) -> TorqueDerivatives:
    """Return torques and their derivatives at a state."""
    tree = state.tree
    moving = motions(state)
    wrenches, _ = collect(
        state, [force_and_moment(m, b.inertia) for m, b in zip(moving, tree.bodies, strict=True)]
    )
    composites = _composites(state, moving)
    result = TorqueDerivatives([], {}, {}, {})
    for j, composite in enumerate(composites):
        f, n = wrenches[j]
        rotor = tree.armature[j] * state.a[j]
        result.tau.append((f[2] if composite.slides else n[2]) + rotor)
        _columns(state, j, composite, wrenches[j], result)
        _forms(state, j, composites, result)
        result.mass[j, j] = result.mass[j, j] + tree.armature[j]
    return result


def _composites(state: StateExpressions, moving: list[Motion]) -> list[_Composite]:
    """Return all composite bodies with h' and Pi summed from the tips inward."""
    bodies = state.tree.bodies
    inertias, _ = composite_inertias(state)
    firsts: list[Vector] = [ZERO] * len(bodies)
    seconds: list[Matrix] = [ZERO_MATRIX] * len(bodies)
    for i in reversed(range(len(bodies))):
        parent, turn, v, inertia = bodies[i].parent, state.turns[i], state.v[i], inertias[i]
        if parent < 0:
            continue
        if bodies[i].slides:
            first = add(firsts[i], scale(inertia.mass * v, Z))
            second = add_matrices(seconds[i], outer(scale(v, Z), inertia.first))
        else:
            first = add(firsts[i], scale(v, z_cross(inertia.first)))
            x, y, _ = inertia.second
            second = add_matrices(seconds[i], (scale(-v, y), scale(v, x), ZERO))
        first = turn.outward(first)
        second = add_matrices(turn.outward_general(second), outer(first, state.translations[i]))
        firsts[parent] = add(firsts[parent], first)
        seconds[parent] = add_matrices(seconds[parent], second)
    parts = zip(bodies, moving, inertias, firsts, seconds, strict=True)
    return [_Composite(b.slides, m, inertia, h_rate, pi) for b, m, inertia, h_rate, pi in parts]


def _columns(
    state: StateExpressions, j: int, composite: _Composite, wrench: Wrench, result: TorqueDerivatives
) -> None:
    """Add the derivatives of the torques of joint j and its ancestors with respect to joint j."""
    motion = composite.motion
    if composite.slides:
        # A translation by d shifts the point of the parent that carries body j, and the wrench's moment arm.
        by_q = composite.wrench_change(ZERO, ZERO, times(motion.field(), Z))
        by_q = (by_q[0], add(by_q[1], z_cross(wrench[0])))
        by_v = composite.wrench_change(ZERO, ZERO, scale(2.0, cross(motion.omega, Z)))
    else:
        across = cross(motion.omega, Z)
        by_q = composite.wrench_change(across, cross(motion.alpha, Z), cross(motion.a, Z))
        by_q = (add(by_q[0], z_cross(wrench[0])), add(by_q[1], z_cross(wrench[1])))
        by_v = composite.wrench_change(Z, across, ZERO)
    i = j
    while i >= 0:
        part = 0 if state.tree.bodies[i].slides else 1
        result.wrt_q[i, j], result.wrt_v[i, j] = by_q[part][2], by_v[part][2]
        by_q, by_v = to_parent(state, i, *by_q), to_parent(state, i, *by_v)
        i = state.tree.bodies[i].parent


def _forms(state: StateExpressions, i: int, composites: list[_Composite], result: TorqueDerivatives) -> None:
    """Add the derivatives of the torque of joint i with respect to its ancestors, and M."""
    f, n, d = composites[i].form()
    result.mass[i, i] = f[2] if composites[i].slides else n[2]
    child, j = i, state.tree.bodies[i].parent
    while j >= 0:
        motion = composites[j].motion
        f, n, d = _carried(state, child, motion.omega, (f, n, d))
        if composites[j].slides:
            result.mass[i, j] = f[2]
            result.wrt_q[i, j] = dot(f, times(motion.field(), Z))
            result.wrt_v[i, j] = 2.0 * dot(f, cross(motion.omega, Z))
        else:
            across = cross(motion.omega, Z)
            result.mass[i, j] = n[2]
            result.wrt_q[i, j] = dot(f, cross(motion.a, Z)) + dot(n, cross(motion.alpha, Z)) + dot(d, across)
            result.wrt_v[i, j] = d[2] + dot(n, across)
        child, j = j, state.tree.bodies[j].parent


def _carried(
    state: StateExpressions, child: int, omega: Vector, form: tuple[Vector, Vector, Vector]
) -> tuple[Vector, Vector, Vector]:
    """Return a linear form in a body's motion changes as a form in its parent's, which rotates at omega.

    From d_omega_c = R^T d_omega, d_alpha_c = R^T d_alpha + d_omega_c x z v and d_a_c = R^T (d_a + d_alpha x r
    + d_omega x (omega x r) + omega x (d_omega x r)) (+ 2 d_omega_c x z v for a prismatic joint): (omega x r)
    x f + r x (f x omega) = r (omega . f) + f (omega . r) - 2 omega (r . f).
    """
    f, n, d = form
    turn, r, v = state.turns[child], state.translations[child], state.v[child]
    if state.tree.bodies[child].slides:
        d = add(d, scale(2.0 * v, z_cross(f)))
    else:
        d = add(d, scale(v, z_cross(n)))
    f, n, d = turn.outward(f), turn.outward(n), turn.outward(d)
    shear = add(scale(dot(omega, f), r), scale(dot(omega, r), f), scale(-2.0 * dot(r, f), omega))
    return f, add(n, cross(r, f)), add(d, shear)
