"""A person's motion on Pepper: key points from a file, within every limit, clear of the body, and saved."""

import tempfile
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

import pepper_kin as pk
from pepper_kin.motion import read_key_points, retarget

# A person of 1.8 m before a camera whose y axis points down: waves, opens the arms wide, claps quickly.
KEYS = {  # time [s]: directions of right upper arm and forearm, left upper arm and forearm; x ahead, y left
    0.0: ((0.1, -0.1, -1), (0.3, 0, -1), (0.1, 0.1, -1), (0.3, 0, -1)),
    1.2: ((0.2, -0.9, -0.3), (0.1, -0.2, 1), (0.1, 0.2, -1), (0.4, 0, -1)),
    1.5: ((0.2, -0.9, -0.3), (0.1, 0.4, 1), (0.1, 0.2, -1), (0.4, 0, -1)),
    1.8: ((0.2, -0.9, -0.3), (0.1, -0.2, 1), (0.1, 0.2, -1), (0.4, 0, -1)),
    2.1: ((0.2, -0.9, -0.3), (0.1, 0.4, 1), (0.1, 0.2, -1), (0.4, 0, -1)),
    3.0: ((0.3, -1, 0.1), (0.4, -0.9, 0.1), (0.3, 1, 0.1), (0.4, 0.9, 0.1)),
    3.6: ((0.6, -0.3, -0.8), (0.7, 0.8, 0.1), (0.6, 0.3, -0.8), (0.7, -0.8, 0.1)),
    3.8: ((0.6, -0.5, -0.7), (0.9, 0.3, 0.1), (0.6, 0.5, -0.7), (0.9, -0.3, 0.1)),
    4.0: ((0.6, -0.3, -0.8), (0.7, 0.8, 0.1), (0.6, 0.3, -0.8), (0.7, -0.8, 0.1)),
    5.0: ((0.1, -0.1, -1), (0.3, 0, -1), (0.1, 0.1, -1), (0.3, 0, -1)),
}
times = np.arange(151) / 30.0
limbs = PchipInterpolator(list(KEYS), np.array(list(KEYS.values()), dtype=float))(times)
limbs *= np.array([0.33, 0.27, 0.33, 0.27])[:, None] / np.linalg.norm(limbs, axis=2, keepdims=True)
body = {
    "RHip": (0, -0.1, 0.95),
    "LHip": (0, 0.1, 0.95),
    "RShoulder": (0, -0.2, 1.45),
    "LShoulder": (0, 0.2, 1.45),
}
body |= {"nose": (0.1, 0, 1.65), "right_ear": (0, -0.08, 1.65), "left_ear": (0, 0.08, 1.65)}
place = {name: np.tile(point, (times.size, 1)) for name, point in body.items()}
for k, side in enumerate("RL"):
    place[side + "Elbow"] = place[side + "Shoulder"] + limbs[:, 2 * k]
    place[side + "Wrist"] = place[side + "Elbow"] + limbs[:, 2 * k + 1]
points = np.stack(list(place.values()), axis=1)
generator = np.random.default_rng(0)
seen = points + generator.normal(0.0, 0.004, points.shape)
seen[generator.random(seen.shape[:2]) < 0.05] = np.nan  # one in twenty is not seen
camera = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])

pepper = pk.load_pepper()
with tempfile.TemporaryDirectory() as folder:
    recording = Path(folder) / "person.npz"
    np.savez(recording, points=seen @ camera.T, names=np.array(list(place)), times=times)
    found = retarget(pepper, read_key_points(recording), up=(0, -1, 0))
    print(found.report())
    motion = found.trajectory
    print(motion.check(pepper, pk.Scene()).report())
    pk.files.save(motion, Path(folder) / "pepper.csv", pepper=pepper)

assert found.success
assert motion.check(pepper, pk.Scene()).success
assert np.degrees(np.nanmedian(found.errors)) < 5.0
