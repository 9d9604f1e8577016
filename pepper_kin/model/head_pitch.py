"""The range of Pepper's head downward: 36.5 degrees, or 25.5.

The URDFs and Choregraphe (table 4 of Sekkat et al., Heliyon 2024) give the joint 36.5 degrees.  The vendor's
page on the joints for NAOqi 2.5, as public programs quote it, gives 25.5; and of 5,067 settled postures of a
robot's head, published with PepperKinematics (RO-MAN 2021), none was sent beyond that.  What depends on the
yaw is in `pepper_kin.collision.dependent_ranges`.
"""

from __future__ import annotations

import math

HEAD_LIMITS = ("urdf", "documented")
"""Whose upper limit the pitch of the head has."""

DOCUMENTED = math.radians(25.5)
"""Upper limit of HeadPitch on the vendor's page, and the most that a robot was seen to reach [rad]."""
