"""Check the dynamics of a model against an independent Newton-Euler and against the laws it must keep."""

import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper(base="planar", hands="mimic")
rng = np.random.default_rng(0)
lower, upper = np.clip(pepper.lower_limits, -3, 3), np.clip(pepper.upper_limits, -3, 3)
q = rng.uniform(lower, upper, (100, pepper.n))
v, a = rng.normal(size=(2, 100, pepper.n))

tau = pk.dynamics.inverse_dynamics(pepper, q, v, a)
against = np.abs(tau - pk.dynamics.newton_euler(pepper, q, v, a)).max()
back = np.abs(pk.dynamics.forward_dynamics(pepper, q, v, tau) - a).max()
mass = pk.dynamics.mass_matrix(pepper, q)
print(f"RNEA against Newton-Euler:      {against:.1e} N m")
print(f"forward(inverse(a)) - a:        {back:.1e} rad/s^2")
print(f"smallest eigenvalue of M:       {np.linalg.eigvalsh(mass).min():.1e} kg m^2")

assert against < 1e-9
assert back < 1e-8
