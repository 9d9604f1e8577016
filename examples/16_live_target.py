"""The live page from Python: move a target, and the body follows it in every browser."""

import time
import urllib.request

import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper()
start = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
scene = pk.Scene().add_box("table", size=(0.4, 0.9, 0.03), position=(0.55, 0.0, 0.68))
received = []


def hand():
    return pk.kinematics.frame_pose(pepper, viewer.q, "LArm_effector")[:3, 3]


with pk.Viewer(pepper, port=0).add_scene(scene) as viewer:  # leaving the block ends the server
    address = viewer.show(start)
    print(f"anybody on this machine can look on at {address}")
    with urllib.request.urlopen(address) as page:
        title = page.read().decode()

    # The callback is also called when a target is dragged in a browser.
    viewer.on_target(lambda name, place: received.append((name, place)))
    path, misses = [hand()], []
    for point in ([0.36, 0.24, 0.86], [0.36, 0.04, 0.86], [0.34, 0.14, 1.02]):
        viewer.move_target("gaze", point).move_target("left hand", point)
        give_up = time.monotonic() + 600  # the servo is compiled once on a machine
        while np.linalg.norm(path[-1] - point) > 1e-3 and time.monotonic() < give_up:
            time.sleep(0.02)
            path.append(hand())
        misses.append(np.linalg.norm(path[-1] - point))
        print(f"the hand is {1000 * misses[-1]:.2f} mm from {point}")
    reached = viewer.q

assert viewer.url is None
assert pepper.name in title or "Pepper" in title
assert max(misses) < 1e-3
assert {name for name, _ in received} == {"gaze", "left hand"}
assert not pk.collision.in_collision(pepper, reached, scene)
