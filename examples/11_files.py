"""One motion in every format, back again, and an animation of Choregraphe made safe for the robot."""

import argparse
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError
from pepper_kin.files import load, naoqi_timeline, save
from pepper_kin.trajectory import import_timeline, plot

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("-o", "--output", default="files", help="folder for the files")
options = parser.parse_args()

pepper = pk.load_pepper()
folder = Path(options.output)
folder.mkdir(parents=True, exist_ok=True)
motion = pk.motion.gesture(pepper, "beat")

# Exact files hold the polynomials, the others samples; .py is a script for a robot with NAOqi.
worst = {}
for suffix in ("npz", "json", "csv", "yaml", "py", "mcap"):
    try:
        path = save(motion, folder / f"beat.{suffix}")
    except pk.exceptions.MissingDependencyError as error:
        print(error)
        continue
    again = load(path, pepper=pepper)
    at = np.arange(0.0, min(motion.duration, again.duration), 0.04)
    worst[suffix] = float(np.abs(again(at).position - motion(at).position).max())
    print(f"{path}: {path.stat().st_size / 1000:6.1f} kB, off by {worst[suffix]:.1e} rad")

# A file that was cut off is refused, with the place.
cut = folder / "cut.yaml"
cut.write_text((folder / "beat.yaml").read_text()[:2000])
try:
    load(cut, pepper=pepper)
except FileFormatError as error:
    refused = error
    print(f"refused: {error}")

# An animation as exported by Choregraphe: the head turns abruptly in a tenth of a second.
names, times = ["HeadYaw"], [[0.5, 0.6, 1.5]]
keys = [[0.9, [-0.9, [1, 0, 0], [1, 0, 0]], [0.0, [3, -0.3, 0.0], [3, 0, 0]]]]
imported = import_timeline(pepper, naoqi_timeline(names, times, keys, name="snap"))
print(imported.report())
plot(pepper, imported.original, folder / "unsafe.png", title="as drawn")
plot(pepper, imported.trajectory, folder / "safe.png", title="made safe")

assert max(worst.values()) < 1e-9
assert refused.line is not None
assert {violation.quantity for violation in imported.violations} >= {"velocity", "acceleration"}
assert not imported.original.check(pepper).success
assert imported.trajectory.check(pepper).success
