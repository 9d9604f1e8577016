"""RoboPlan's side of the comparison: planning_roboplan_server.py URDF SRDF.

Run by `planning.py --roboplan-python`.  RoboPlan needs a newer Pinocchio than placo can be loaded with, so it
has an environment and a process of its own (`pip install roboplan`).  Reads a job a line and writes the
answer and the time that it took here, without what passes between the processes.
"""

import json
import os
import sys
import time

import numpy as np
from roboplan import core, rrt

# Libraries below may print; only answers may go where the other process reads.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

with open(sys.argv[2], encoding="utf-8") as file:
    srdf = file.read()
scene = core.Scene("pepper", core.loadUrdfSceneDescription(sys.argv[1]))
scene.importSrdf(srdf)
names = list(scene.getJointNames())
placed = []


def furnish(boxes):
    """Put boxes, (size, pose) each, in place of those that stand there."""
    while placed:
        scene.removeGeometry(placed.pop())
    for k, (size, pose) in enumerate(boxes):
        placed.append(f"box_{k}")
        transform = np.asfortranarray(np.array(pose, dtype=float))
        scene.addBoxGeometry(placed[-1], "universe", core.Box(*size), transform, np.ones(4))
        for other in placed[:-1]:  # boxes may overlap one another
            scene.setCollisions(placed[-1], other, False)


def group(name, joints):
    """Make a group of joints, in the robot's order, if there is none of that name."""
    try:
        scene.getJointGroupInfo(name)
    except RuntimeError:
        scene.addGroup(name, [joint for joint in names if joint in joints])


def validity(states):
    """Return which states collide."""
    rows = np.array(states, dtype=float)
    begin = time.perf_counter()
    found = [scene.hasCollisions(row) for row in rows]
    return {"collides": found, "time": time.perf_counter() - begin}


def connect(start, goal, joints, step, seed, timeout):
    """Search a path with RRT-Connect, the planner made anew as ours is."""
    begin = time.perf_counter()
    scene.setJointPositions(np.array(start))
    options = rrt.RRTOptions(
        group_name=joints, max_nodes=100_000, collision_check_step_size=step, max_planning_time=timeout,
        rrt_connect=True,
    )  # fmt: skip
    planner = rrt.RRT(scene, options)
    planner.setRngSeed(seed)
    moving = list(scene.getJointGroupInfo(joints).joint_names)
    places = [names.index(name) for name in moving]
    ends = [core.JointConfiguration(moving, np.array(q)[places]) for q in (start, goal)]
    try:
        found = planner.plan(*ends)
    except RuntimeError as error:
        return {"path": None, "time": time.perf_counter() - begin, "message": str(error)}
    spent = time.perf_counter() - begin
    path = np.tile(start, (len(found.positions), 1))
    path[:, places] = np.array(found.positions)
    return {"path": path.tolist(), "time": spent}


print(json.dumps(names), file=answers, flush=True)
for line in sys.stdin:
    job = json.loads(line)
    work = {"furnish": furnish, "group": group, "validity": validity, "connect": connect}[job.pop("do")]
    print(json.dumps(work(**job)), file=answers, flush=True)
