"""Contacts of a recorded motion: bodies, times and a sentence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Contact, Scene, contacts
from pepper_kin.model import PepperModel
from pepper_kin.viewer.server.merging import carriers_of
from pepper_kin.viewer.server.words import contact_words


@dataclass(frozen=True)
class TouchSpan:
    """An interval in which the same bodies touch.

    Attributes:
        start: Time of the first frame [s].
        end: Time of the last frame [s].
        links: Links that are drawn in red.
        objects: Objects that are drawn in red.
        text: Contacts in a sentence.
    """

    start: float
    end: float
    links: tuple[str, ...]
    objects: tuple[str, ...]
    text: str


def touch_spans(
    pepper: PepperModel,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    scene: Scene,
    links: Sequence[str],
) -> tuple[TouchSpan, ...]:
    """Return the intervals in which frames of a motion have contacts, in order.

    Args:
        pepper: Model of the robot.
        times: Times of the frames, shape (F,) [s].
        positions: Joint positions of the frames, shape (F, n) [rad or m].
        scene: Scene around the robot; moving obstacles are at their poses of each time.
        links: Names of the drawn links.
    """
    carriers = {link: carrier for link, (carrier, _) in carriers_of(pepper).items()}
    spans: list[TouchSpan] = []
    last = None
    for time, q in zip(times, positions, strict=True):
        found = contacts(pepper, q, scene.at(time, enlarged=False) if scene.movers else scene)
        bodies, objects = touching_names(found, carriers, scene)
        drawn = tuple(link for link in links if carriers[link] in bodies)
        span = TouchSpan(float(time), float(time), drawn, objects, contact_words(pepper, found))
        if found and last is not None and replace(last, start=span.start, end=span.end) == span:
            spans[-1] = replace(spans[-1], end=span.end)
        elif found:
            spans.append(span)
        last = span if found else None
    return tuple(spans)


def touching_names(
    found: Iterable[Contact], carriers: dict[str, str], scene: Scene
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the touching bodies, by their link in `carriers`, and the touching objects."""
    names = {name for contact in found for name in contact.names}
    objects = names & set(scene.names)
    return tuple(sorted({carriers[name] for name in names - objects if name in carriers})), tuple(
        sorted(objects)
    )
