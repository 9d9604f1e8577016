"""Reach map: sampled positions of a frame on a grid of voxels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import batch
from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access.numpy_archive import read_kinds, write_arrays
from pepper_kin.kinematics.jacobian import frame_jacobian
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_batch, check_positive, check_seed, check_whole

reach_picture = lazy_module("pepper_kin.kinematics.reach_picture")

MOST_SAMPLES = 1_000_000_000
MOST_VOXELS = 40_000_000
"""Maximum number of voxels of a map, which also limits files."""
CHUNK = 20_000
"""Number of states at a time: few enough for the processor's caches, many enough to amortize calls."""

_FORMAT = "pepper_kin reach map 1"
_ARRAYS = {
    "frame": ("U", 0),
    "joints": ("U", 1),
    "origin": ("f", 1),
    "resolution": ("f", 0),
    "counts": ("i", 3),
    "best": ("f", 3),
    "samples": ("i", 0),
    "seed": ("i", 0),
}
"""Kinds of the arrays in a file, and their numbers of dimensions."""


@dataclass(frozen=True, eq=False)
class ReachMap(FrozenArrays):
    """Voxels reached by the origin of a frame.

    A voxel that was hit is reachable; one that was not hit may be reachable, too, which is the less likely
    the more samples there are.  Collisions count only if `reach_map` was called with a check.

    Attributes:
        frame: Name of the frame.
        joints: Names of the joints that moved; the others were at Stand.
        origin: (3,) corner of the grid with the smallest coordinates, in the world [m].
        resolution: Edge of a voxel [m].
        counts: (nx, ny, nz) samples in each voxel.
        best: (nx, ny, nz) maximum manipulability of the samples in each voxel, sqrt(det(J J^T)) over the
            joints that moved [m^3]; zero without samples.
        samples: Number of samples that were drawn; `counts.sum()` of them were valid.
        seed: Seed of the samples.
    """

    frame: str
    joints: tuple[str, ...]
    origin: Array
    resolution: float
    counts: NDArray[np.int64]
    best: NDArray[np.float32]
    samples: int
    seed: int

    def __post_init__(self) -> None:
        for name, dtype in (("origin", np.float64), ("counts", np.int64), ("best", np.float32)):
            value = getattr(self, name)
            owned = isinstance(value, np.ndarray) and value.flags.owndata and not value.flags.writeable
            array = np.array(value, dtype=dtype, copy=None if owned else True)  # a file's may fill half a GB
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def volume(self) -> float:
        """Volume of all voxels that were hit [m^3]: slightly too large, as voxels at the rim protrude."""
        return float(np.count_nonzero(self.counts) * self.resolution**3)

    @property
    def centers(self) -> Array:
        """Centers of all voxels that were hit [m], shape (k, 3)."""
        return self.origin + (np.argwhere(self.counts > 0) + 0.5) * self.resolution

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether the voxels of points [m], shape (..., 3), were hit, shape (...).

        Raises:
            InvalidValueError: for another shape, NaN or infinity.
        """
        array = as_batch(points, "points", (3,))
        # Indices on the world's grid, as when the map was made, so that rounding cannot miss a voxel.
        place = np.floor(array / self.resolution) - np.round(self.origin / self.resolution)
        inside = np.all((place >= 0) & (place < self.counts.shape), axis=-1)
        index = np.where(inside[..., None], place, 0).astype(int)
        return np.asarray(inside & (self.counts[index[..., 0], index[..., 1], index[..., 2]] > 0))

    def report(self) -> str:
        """Return volume, extent, the best position and which postures counted, in words."""
        low, high = self.centers.min(axis=0), self.centers.max(axis=0)
        spans = (f"{name} {a:.2f} to {b:.2f}" for name, a, b in zip("xyz", low, high, strict=True))
        top = np.array(np.unravel_index(int(self.best.argmax()), self.best.shape))
        spot = ", ".join(f"{x:.2f}" for x in self.origin + (top + 0.5) * self.resolution)
        counted, rest = self.counts.sum(), []
        if counted == self.samples:
            rest = ["no posture was left out: without valid= those in self-collision or tipping count, too"]
        return "\n".join(
            [
                f"{self.frame}, moved by {', '.join(self.joints)}: reaches {self.volume:.3g} m^3, "
                f"{np.count_nonzero(self.counts)} voxels of {self.resolution:g} m",
                f"centers of voxels [m]: {', '.join(spans)}",
                f"best manipulability {self.best.max():.3g} m^3 at ({spot})",
                f"{counted} of {self.samples} postures counted (seed {self.seed}): "
                "a voxel that none hit may be reachable all the same",
                *rest,
            ]
        )

    def plot(self, path: str | Path, title: str | None = None) -> Path:
        """Draw the map from the side and from above; see `reach_picture.save_reach_picture` for several.

        Args:
            path: PNG file; its folder must exist.
            title: Title above the picture; the frame if omitted.

        Returns:
            The path.

        Raises:
            MissingDependencyError: if matplotlib is not installed.
            FileFormatError: if the file cannot be written.
        """
        return Path(reach_picture.save_reach_picture({self.frame if title is None else title: self}, path))

    def save(self, path: str | Path) -> Path:
        """Write the map as a compressed NumPy file, whole or not at all.

        Raises:
            FileFormatError: naming the path and the reason.
        """
        return write_arrays(path, {"format": _FORMAT, **{name: getattr(self, name) for name in _ARRAYS}})

    @classmethod
    def load(cls, path: str | Path) -> ReachMap:
        """Read a map written by `save`.

        Raises:
            FileFormatError: if the file cannot be read or is not a reach map.
        """
        fields = read_kinds(path, _FORMAT, _ARRAYS)
        counts, resolution = fields["counts"], fields["resolution"]
        if counts.shape != fields["best"].shape or fields["origin"].shape != (3,):
            raise FileFormatError(path, "holds arrays whose shapes do not fit one another")
        if counts.min(initial=0) < 0 or fields["samples"] < 0 or not 1e-9 <= resolution <= 1e9:
            raise FileFormatError(path, "holds a count below 0, or a resolution outside 1e-9 to 1e9 m")
        for name in ("counts", "best"):
            fields[name].flags.writeable = False
        return cls(**{**fields, "joints": tuple(fields["joints"].tolist())})


def reach_map(
    pepper: PepperModel,
    frame: str,
    *,
    joints: str | Sequence[str] | None = None,
    samples: int = 1_000_000,
    resolution: float = 0.05,
    seed: int = 0,
    valid: Callable[[Array], NDArray[np.bool_]] | None = None,
    progress: Callable[[float], None] | None = None,
) -> ReachMap:
    """Sample postures and count the positions of a frame's origin on a grid.

    Positions are drawn uniformly between the limits of each joint (a full turn without limits).  All postures
    count, or those that `valid` accepts, such as collision-free ones:

        from pepper_kin.collision.fast import FastChecker

        checker = FastChecker(pepper, pk.Scene())  # the robot itself and the scene
        reach_map(pepper, "LArm_effector", valid=lambda q: ~checker.in_collision(q))

    Args:
        pepper: The robot.
        frame: A name of `pepper.frame_names`, such as "LArm_effector".
        joints: Joints that move: names of joints and groups; all by default.  Others stay at Stand.
        samples: Number of postures.
        resolution: Edge of a voxel [m].
        seed: Seed of the postures.
        valid: Function from joint positions, shape (k, n) [rad or m], to whether they count, shape (k,); all
            count if omitted.
        progress: Called with the fraction that is done, from 0 to 1.

    Returns:
        The map, on a grid with a corner at the world's origin.

    Raises:
        UnknownNameError: for a frame, joint or group that the robot lacks.
        InvalidValueError: for no joint, a number of samples, resolution or seed out of range, a result of
            `valid` other than booleans of shape (k,), or no valid posture.
    """
    pepper.frame_id(frame)
    names = tuple(sorted(pepper.resolve_joints(joints), key=pepper.joint_index))
    columns = [pepper.joint_index(name) for name in names]
    size = check_positive("resolution", resolution, "m")
    check_whole("samples", samples, 1, MOST_SAMPLES)
    check_seed(seed)
    lower = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, -np.pi)[columns]
    upper = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, np.pi)[columns]
    rng, grid, done = np.random.default_rng(seed), _Grid(size), 0
    place = batch.kernel(pepper, "frame_pose", frame)
    while done < samples:
        count = min(CHUNK, samples - done)
        q = np.tile(pepper.neutral(), (count, 1))
        q[:, columns] = rng.uniform(lower, upper, (count, len(columns)))
        done += count
        if valid is not None:
            q = q[_checked_answer(valid(q), count)]
        if len(q):
            points = np.asarray(place(q))[:, :3, 3]
            grid.add(points, _manipulability(pepper, q, frame, columns))
        if progress is not None:
            progress(done / samples)
    if not grid.counts.size:
        raise InvalidValueError("valid", f"none of {samples} postures", "at least one valid posture")
    origin = grid.corner.astype(np.float64) * size
    return ReachMap(frame, names, origin, size, grid.counts, grid.best, int(samples), int(seed))


def _checked_answer(answer: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Return the result of `valid` after a check that it is booleans of shape (count,)."""
    found = np.asarray(answer)
    if found.dtype != bool or found.shape != (count,):
        raise InvalidValueError(
            "result of valid", f"{found.dtype} of shape {found.shape}", f"booleans of shape ({count},)"
        )
    return found


def _manipulability(pepper: PepperModel, q: Array, frame: str, columns: list[int]) -> Array:
    """Return sqrt(det(J J^T)) of the position Jacobian, shape (N,), at positions q, shape (N, n) [rad or m].

    The 3 x 3 determinant is accurate enough for a map, and fast.
    """
    jacobian = frame_jacobian(pepper, q, frame)[:, :3][:, :, columns]
    x, y, z = np.moveaxis(jacobian @ np.swapaxes(jacobian, 1, 2), 1, 0)
    return np.sqrt(np.maximum(np.einsum("ki,ki->k", x, np.cross(y, z)), 0.0))


class _Grid:
    """Voxels by integer coordinates, in arrays that grow as needed."""

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        self.corner = np.zeros(3, np.int64)
        self.counts = np.zeros((0, 0, 0), np.int64)
        self.best = np.zeros((0, 0, 0), np.float32)

    def add(self, points: Array, values: Array) -> None:
        """Count the voxels of points, shape (k, 3) [m], and keep the maximum value of each voxel.

        Raises:
            InvalidValueError: naming the resolution if more than MOST_VOXELS would be needed.
        """
        with np.errstate(over="ignore"):
            places = np.floor(points / self.resolution)
        low, high = places.min(axis=0), places.max(axis=0) + 1.0
        if self.counts.size:
            low, high = np.minimum(low, self.corner), np.maximum(high, self.corner + self.counts.shape)
        if not np.abs([low, high]).max() < 2**53 or np.prod(high - low) > MOST_VOXELS:
            enough = 1.1 * float(np.cbrt(np.prod(np.ptp(points, axis=0) + 0.1) / MOST_VOXELS))
            raise InvalidValueError(
                "resolution",
                f"{self.resolution:g} m",
                f"one for at most {MOST_VOXELS} voxels, such as {enough:.2g} m",
            )
        voxels, lowest, highest = places.astype(np.int64), low.astype(np.int64), high.astype(np.int64)
        if not self.counts.size:
            shape = tuple(highest - lowest)
            self.counts, self.best = np.zeros(shape, np.int64), np.zeros(shape, np.float32)
        else:
            before = self.corner - lowest
            after = highest - self.corner - self.counts.shape
            widths = list(zip(before, after, strict=True))
            self.counts, self.best = np.pad(self.counts, widths), np.pad(self.best, widths)
        self.corner = lowest
        flat = np.ravel_multi_index(tuple((voxels - lowest).T), self.counts.shape)
        self.counts += np.bincount(flat, minlength=self.counts.size).reshape(self.counts.shape)
        np.maximum.at(self.best.reshape(-1), flat, values.astype(np.float32))
