"""Contact points of Pepper's wheels."""

from __future__ import annotations

from pepper_kin.dynamics.support_polygon import wheel_contacts
from pepper_kin.model import load_pepper

WHEEL_CONTACTS = tuple((x, y) for x, y in wheel_contacts(load_pepper()).tolist())
"""Contact points of Pepper's three wheels, x and y in `base_footprint` [m], counter-clockwise."""
