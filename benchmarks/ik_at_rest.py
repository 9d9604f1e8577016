"""How many solutions of `ik.solve` a plan may end at, over hand positions drawn all over the workspace.

python benchmarks/ik_at_rest.py [COUNT]
"""

import sys
import time

import numpy as np

import pepper_kin as pk
from pepper_kin.ik.standing import holds, rests
from pepper_kin.model.requirements import ROOM_TO_MOVE

STARTS = 64


def main(count: int) -> None:
    pepper, rng = pk.load_pepper(), np.random.default_rng(0)
    kept, torque, more, times = 0, 0, 0, []
    share, balance = pepper.requirements.holding_share, pepper.requirements.balance
    motors = pk.ik.HoldingTorque(share, tolerance=1e-4)
    wheels = pk.ik.CenterOfMassOverWheels(balance + ROOM_TO_MOVE, tolerance=1e-4)
    solved = 0
    while solved < count:
        q = rng.uniform(pepper.lower_limits, pepper.upper_limits)
        if pk.collision.in_collision(pepper, q):
            continue
        hand, frame = (("right", "r_gripper"), ("left", "l_gripper"))[solved % 2]
        reach = pk.ik.HandPosition(hand, pk.kinematics.frame_pose(pepper, q, frame)[:3, 3])
        begin = time.process_time()
        found = pk.ik.solve(pepper, reach)
        times.append(time.process_time() - begin)
        solved += 1
        if found.success and rests(pepper, found.q, balance, ()):
            kept += 1
            continue
        torque += not holds(pepper, found.q, ())
        again = pk.ik.solve(pepper, [reach, motors, wheels], restarts=STARTS)
        more += again.success
    print(f"{count} hand positions: {kept} end at rest as motions keep it, {torque} lack torque")
    print(f"of the {count - kept} others {STARTS} starts with both as tasks find {more}")
    print(f"processor time: median {1e3 * np.median(times):.3f} ms, mean {1e3 * np.mean(times[5:]):.3f} ms")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
