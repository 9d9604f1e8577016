"""Calls of a simulated robot whose machine code is shipped with a wheel."""

from __future__ import annotations

from pepper_kin.naoqi.broker import Broker


def everyday_calls() -> None:
    """Move both arms to positions and poses, and look at a point."""
    with Broker(real_time=False) as broker:
        broker.body.time.sleep(0.1)
        for arm in ("LArm", "RArm"):
            here = broker.motion.getPosition(arm, 2, False)
            broker.motion.setPositions(arm, 2, here, 0.2, 7)
            broker.motion.setPositions(arm, 2, here, 0.2, 63)
        broker.module("ALTracker").lookAt([1.0, 0.0, 1.0], 2, 0.5, False)
