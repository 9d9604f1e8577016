"""Velocity estimates of objects that are observed repeatedly."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from pepper_kin.arrays import Array
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.solids import HalfSpace, not_negative
from pepper_kin.model.joint_vectors import check_positive

_ROUNDING = 1e-9  # [s]


class SceneTracker:
    """Assigns velocities to the objects of a scene, from their earlier positions.

    An object that moved recently gets the mean velocity of the last moments; one that has a velocity or an
    uncertainty keeps it, and a half-space does not move.

    Args:
        uncertainty: Maximum error of the velocity [m/s].
        window: Time over which the mean is taken [s].
        held: Time after its last move during which an object may start to move again [s].

    Raises:
        InvalidValueError: for a negative uncertainty, or times that are not positive.
    """

    def __init__(self, uncertainty: float = 0.3, *, window: float = 0.1, held: float = 1.0) -> None:
        self._uncertainty = not_negative("uncertainty", uncertainty)
        self._window, self._held = check_positive("window", window, "s"), check_positive("held", held, "s")
        self._places: deque[tuple[float, dict[str, Array]]] = deque()

    def seen(self, scene: Scene, time: float) -> Scene:
        """Return a scene observed at a time [s], which never decreases, with velocities of moved objects."""
        known = self._places
        while known and (known[0][0] < time - self._held - _ROUNDING or known[-1][0] >= time):
            known.popleft() if known[-1][0] < time else known.pop()
        places = {name: thing.transform_object_to_world[:3, 3] for name, thing in scene.objects.items()}
        known.append((time, places))
        since, before = known[0]
        for at, where in known:
            if at <= time - self._window + _ROUNDING:
                since, before = at, where
        moving = {}
        for name, thing in scene.objects.items():
            here = places[name]
            moved = not thing.moves and any((was.get(name, here) != here).any() for _, was in known)
            if moved and not isinstance(thing.geometry, HalfSpace):
                velocity = (here - before.get(name, here)) / (time - since)
                moving[name] = replace(thing, velocity=velocity, uncertainty=self._uncertainty)
        return Scene({**scene.objects, **moving}, scene.attached, scene.allowed) if moving else scene
