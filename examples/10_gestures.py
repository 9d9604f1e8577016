"""Gestures for talking to people: created, checked, changed in size and tempo, and joined."""

import argparse
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin.files import save
from pepper_kin.motion import gesture, gesture_meaning, gesture_names

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("-o", "--output", default="gestures", help="folder for the scripts for the robot")
parser.add_argument("--quick", action="store_true", help="only a few gestures")
options = parser.parse_args()

pepper = pk.load_pepper()
folder = Path(options.output)
folder.mkdir(parents=True, exist_ok=True)

# Each gesture keeps the limits of position, velocity, acceleration and torque, stands, and hits nothing.
certified = {}
for name in ("nod", "beat") if options.quick else gesture_names():
    motion = gesture(pepper, name)
    certified[name] = motion.check(pepper)
    save(motion, folder / f"{name}.py")  # run on the robot: python nod.py --ip ROBOT
    print(f"{name:14} {motion.duration:5.2f} s  {gesture_meaning(name)}")

# A large, fast one is slowed down only where a joint could not follow.
calm = gesture(pepper, "shake-head")
hasty = gesture(pepper, "shake-head", amplitude=1.25, tempo=4.0)
use = hasty.check(pepper).acceleration
print(f"shake-head at tempo 4: {hasty.duration:.2f} s, not {calm.duration / 4:.2f} s: {use.sentence()}")

# All begin and end in the posture Stand, so one can follow another.
talk = [gesture(pepper, "nod"), gesture(pepper, "beat", side="left")]
seam = np.abs(talk[0].end - talk[1].start).max()

assert all(certificate.success for certificate in certified.values())
assert hasty.check(pepper).success
assert use.use.max() > 0.9
assert hasty.duration > calm.duration / 4
assert seam < 1e-9
