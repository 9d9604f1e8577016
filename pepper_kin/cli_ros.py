"""The command `pepper-kin ros`: argument parsing and printing, nothing else."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pepper_kin.cli_terminal import Json, one_of, print_json

if TYPE_CHECKING:
    from pepper_kin.ros import Transport

TRANSPORTS = ("rosbridge", "rclpy", "cyclonedds")


def ros(
    transport: Annotated[
        str,
        typer.Option(help="rosbridge, rclpy or cyclonedds.", autocompletion=one_of(TRANSPORTS)),
    ] = "rosbridge",
    port: Annotated[int, typer.Option(help="Of rosbridge: where to listen; 0 for any.")] = 9090,
    address: Annotated[str, typer.Option(help="Of rosbridge: address to listen on.")] = "127.0.0.1",
    token: Annotated[
        str | None, typer.Option(help="Of rosbridge: what clients must state; drawn with --allow-remote.")
    ] = None,
    cameras: Annotated[str, typer.Option(help="Which cameras, of front,bottom,depth; none for none.")] = (
        "front,bottom,depth"
    ),
    resolution: Annotated[str, typer.Option(help="VGA, QVGA or QQVGA.")] = "QVGA",
    scene: Annotated[Path | None, typer.Option("--scene", help="What stands around the robot: JSON.")] = None,
    record: Annotated[Path | None, typer.Option(help="Write the run there: .csv, .npz or .mcap.")] = None,
    *,
    view: Annotated[bool, typer.Option("--view", help="Show the robot in the browser meanwhile.")] = False,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let --address be one that other machines reach.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run a simulated Pepper as a node of ROS 2, in real time.  Ctrl-C ends it.

    Example: pepper-kin ros --transport rosbridge --view
    """
    from pepper_kin.body_page import BodyPage
    from pepper_kin.collision import Scene
    from pepper_kin.naoqi.body import Body
    from pepper_kin.naoqi.run_log import RunLog
    from pepper_kin.ros.node import RobotNode

    chosen = () if cameras == "none" else tuple(cameras.split(","))
    carrier, where = _transport(transport, address, port, allow_remote, token)
    with carrier:
        body = Body(scene=None if scene is None else Scene.load(scene))
        log = None if record is None else RunLog(body)
        body.time.start()
        page = BodyPage(body) if view else None
        if page is not None:
            page.open()
        try:
            with RobotNode(body, carrier, cameras=chosen, resolution=resolution):
                if as_json:
                    print_json({"transport": transport, "url": where})
                else:
                    print(f"Pepper over {transport}: {where}; Ctrl-C ends it", flush=True)
                sys.stdout.flush()
                threading.Event().wait()
        except KeyboardInterrupt:
            print()
        finally:
            body.time.stop()
            if log is not None and record is not None:
                log.run().save(record)
                print(f"Written: {record}", file=sys.stderr)
            if page is not None:
                page.close()


def _transport(
    name: str, address: str, port: int, allow_remote: bool, token: str | None
) -> tuple[Transport, str]:
    """Return a transport by name, and where clients find it."""
    from pepper_kin.exceptions import InvalidValueError

    if name == "rosbridge":
        from pepper_kin.ros.transports.rosbridge import RosbridgeServer

        server = RosbridgeServer(address, port, allow_remote=allow_remote, token=token)
        return server, server.url
    if name == "rclpy":
        from pepper_kin.ros.transports.rclpy import RclpyTransport

        return RclpyTransport("pepper_kin"), "the graph of ROS_DOMAIN_ID"
    if name == "cyclonedds":
        from pepper_kin.ros.transports.cyclonedds import CycloneTransport

        return CycloneTransport("pepper_kin"), "the graph of ROS_DOMAIN_ID"
    raise InvalidValueError("transport", repr(name), f"one of {', '.join(TRANSPORTS)}")
