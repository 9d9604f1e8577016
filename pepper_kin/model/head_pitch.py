"""Upper limit of HeadPitch (head down): 36.5 or 25.5 degrees.

The URDFs and Choregraphe (table 4 of Sekkat et al., Heliyon 2024) give the joint 36.5 degrees.  The vendor's
page on the joints for NAOqi 2.5, as public programs quote it, gives 25.5; and none of 5,067 settled postures
of a robot's head, published with PepperKinematics (RO-MAN 2021), was commanded beyond that limit. The range
of the pitch at each yaw is in `pepper_kin.collision.dependent_ranges`.
"""

from __future__ import annotations

import math

HEAD_LIMITS = ("urdf", "documented")
"""Sources of the upper limit of HeadPitch: the URDF, or the vendor's page."""

DOCUMENTED = math.radians(25.5)
"""Upper limit of HeadPitch on the vendor's page, beyond which no robot was seen [rad]."""
