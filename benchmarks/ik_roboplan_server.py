"""RoboPlan's side of the comparison: ik_roboplan_server.py URDF RESTARTS START.

Run by `ik.py --roboplan-python`.  RoboPlan needs a newer Pinocchio than placo can be loaded with, so it has
an environment and a process of its own (`pip install roboplan`).  Reads a list of (frame, pose) a line
and writes the answer and its time.
"""

import json
import os
import sys
import time

import numpy as np
from roboplan import core, simple_ik

# Libraries below may print; only answers may go where the other process reads.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

scene = core.Scene("pepper", core.loadUrdfSceneDescription(sys.argv[1]))
names = list(scene.getJointNames())
options = simple_ik.SimpleIkOptions(
    max_iters=200,
    max_time=0.1,
    max_restarts=int(sys.argv[2]),
    max_linear_error_norm=5e-4,
    max_angular_error_norm=4e-3,
    check_collisions=False,
)
solver = simple_ik.SimpleIk(scene, options)
start_values = json.loads(sys.argv[3])
start = core.JointConfiguration(names, np.array([start_values.get(name, 0.0) for name in names]))
print(json.dumps(names), file=answers, flush=True)
for line in sys.stdin:
    goals = [
        core.CartesianConfiguration("base_footprint", f, np.asfortranarray(p)) for f, p in json.loads(line)
    ]
    found = core.JointConfiguration(names, np.zeros(len(names)))
    begin = time.perf_counter()
    solver.solveIk(goals, start, found)
    duration = time.perf_counter() - begin
    print(json.dumps({"q": list(found.positions), "time": duration}), file=answers, flush=True)
