"""The second robot of a page: translucent copies of the first one's parts, on separate links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pepper_kin.viewer.drawable import Color, Drawable

GHOST_COLOR: Color = (0.95, 0.45, 0.05, 0.45)


def ghost_link(link: str) -> str:
    """Return the name of a ghost's link on a page."""
    return f"ghost {link}"


def ghost_of(drawables: Sequence[Drawable]) -> tuple[Drawable, ...]:
    """Return copies of the drawables on links, in the ghost's color and on the ghost's links."""
    return tuple(
        replace(part, link=ghost_link(part.link), color=GHOST_COLOR)
        for part in drawables
        if part.link is not None
    )
