"""A server in the foreground, until Ctrl-C."""

from __future__ import annotations

import threading
from collections.abc import Callable

from pepper_kin.collision import Scene
from pepper_kin.model import PepperModel
from pepper_kin.servers.access import Access
from pepper_kin.viewer.joint_motion import Playable
from pepper_kin.viewer.server.planning import show_motion
from pepper_kin.viewer.server.server import ViewerServer


def serve(
    pepper: PepperModel,
    access: Access,
    port: int | None,
    *,
    scene: Scene | None = None,
    motion: Playable | None = None,
    on_start: Callable[[str], None] = lambda url: None,
) -> None:
    """Serve the live page until Ctrl-C.

    Args:
        pepper: Model of the robot.
        access: Rules of access.
        port: TCP port; None takes the first free one from 7878 on, 0 any free one.
        scene: Scene at the start.
        motion: Motion to show at the start.
        on_start: Called with the page's address once the server listens.

    Raises:
        InfeasibleError: if the port is in use.
        InvalidValueError: for a motion of another robot.
    """
    server = ViewerServer(pepper, access, port)
    try:
        world = scene or Scene()
        if scene is not None:
            server.call(lambda session: session.set_scene(world))
        if motion is not None:
            shown = show_motion(pepper, motion, world, "Loaded motion")
            server.call(lambda session: session.load(shown, play=False))
        server.warm_up()
        on_start(server.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        return
    finally:
        server.close()
