"""A hand along a path at a set speed: rounded corners, the gaze on the hand, three laps without a stop."""

import numpy as np

import pepper_kin as pk
from pepper_kin.motion import CIRC, LIN, Route, follow

SPEED, LAPS = 0.12, 3
pepper = pk.load_pepper()
begin = np.array([0.32, 0.10, 0.88])
side, up = np.array([0.0, 0.24, 0.0]), np.array([0.0, 0.0, 0.2])
route = Route.of(
    begin + 0.5 * up,
    [
        LIN(begin, blend=0.05),
        LIN(begin + side, blend=0.05),
        LIN(begin + side + up, blend=0.05),
        CIRC(begin + side / 2 + 0.7 * up, begin + up, blend=0.05),
        LIN(begin + 0.5 * up),
    ],
)


def tasks(s):
    """The left hand on the path, and the gaze on the hand."""
    points = route(s)
    return [pk.ik.HandPosition("left", points), pk.ik.LookAt(points)]


found = follow(pepper, None, tasks, route, speed=SPEED, laps=LAPS)
print(found.report())
motion = found.trajectory
print(motion.check(pepper, pk.Scene()).report())

times = np.linspace(0.0, motion.duration, 3000)
state = motion(times)
jacobian = pk.kinematics.frame_jacobian(pepper, state.position, "LArm_effector")[:, :3]
speeds = np.linalg.norm(np.einsum("kij,kj->ki", jacobian, state.velocity), axis=1)
cruise = speeds[(times > 0.4) & (times < motion.duration - 0.4)]
print(
    f"{LAPS} laps of {100 * route.length:.0f} cm: {cruise.min():.4f} to {cruise.max():.4f} m/s after the ramp"
)

assert found.success
assert motion.check(pepper, pk.Scene()).success
assert np.abs(cruise / SPEED - 1.0).max() < 0.005
