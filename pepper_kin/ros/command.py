"""The command `pepper-kin ros`: argument parsing and printing, nothing else."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

import pepper_kin as pk
from pepper_kin import naoqi, ros
from pepper_kin.cli.terminal import Json, check_record, one_of, print_json
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.naoqi.commands import save_log
from pepper_kin.ros import transports
from pepper_kin.ros.transports.dds_domain import discovery_range, domain_number, stay_on_this_machine
from pepper_kin.servers.end_signals import ended_by_signals

body = lazy_module("pepper_kin.naoqi.body")
body_page = lazy_module("pepper_kin.naoqi.body_page")

app = typer.Typer(add_completion=False)

TRANSPORTS = ("rosbridge", "rclpy", "cyclonedds", "zenoh")


@app.command()
def serve(
    transport: Annotated[
        str,
        typer.Option(help="rosbridge, rclpy, cyclonedds or zenoh.", autocompletion=one_of(TRANSPORTS)),
    ] = "rosbridge",
    port: Annotated[
        int | None, typer.Option(help="Of rosbridge (9090; 0 for any) or of Zenoh's router (7447).")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="Of rosbridge or of Zenoh's router; this machine's own if left out.")
    ] = None,
    token: Annotated[
        str | None, typer.Option(help="Of rosbridge: what clients must state; drawn with --allow-remote.")
    ] = None,
    cameras: Annotated[str, typer.Option(help="Which cameras, of front,bottom,depth; none for none.")] = (
        "front,bottom,depth"
    ),
    resolution: Annotated[str, typer.Option(help="VGA, QVGA or QQVGA.")] = "QVGA",
    scene: Annotated[Path | None, typer.Option("--scene", help="What stands around the robot: JSON.")] = None,
    record: Annotated[
        Path | None, typer.Option(help="Write the run (.csv) or the topics but pictures (.mcap) there.")
    ] = None,
    *,
    stamped: Annotated[
        bool, typer.Option("--stamped", help="Take TwistStamped on /cmd_vel, which Nav2 sends by default.")
    ] = False,
    live: Annotated[
        float | None,
        typer.Option(
            help="Go to the ends of trajectories, clear of what moves, at this share of the limits."
        ),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the robot in the browser meanwhile.")] = False,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let other machines reach it.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run a simulated Pepper as a node of ROS 2, in real time.  Ctrl-C ends it.

    Example: pepper-kin ros --transport rosbridge --view
    """
    check_record(record, ".csv", ".mcap")
    chosen = () if cameras == "none" else tuple(cameras.split(","))
    around = None if scene is None else pk.Scene.load(scene)
    carrier, where = _transport(transport, address, port, allow_remote, token)
    with carrier, ended_by_signals() as ended:
        robot = body.Body(scene=around)
        log = naoqi.RunLog(robot) if record is not None and record.suffix.lower() == ".csv" else None
        robot.time.start()
        page = body_page.BodyPage(robot) if view else None
        if page is not None:
            page.open()
        try:
            with (
                ros.RobotNode(
                    robot, carrier, cameras=chosen, resolution=resolution, stamped=stamped, live=live
                ) as node,
                _recorded(node, record if log is None else None),
            ):
                _print_start(transport, where, as_json)
                ended.wait()
        finally:
            robot.time.stop()
            if log is not None and record is not None:
                save_log(log, record)
            elif record is not None and record.exists():
                print(f"Written: {record}", file=sys.stderr)
            if page is not None:
                page.close()


def _recorded(node: ros.RobotNode, path: Path | None) -> AbstractContextManager[Any]:
    """Return a recorder of all topics of a node but images, or a null context without a path."""
    if path is None:
        return nullcontext()
    topics = {name: kind for name, kind in node.topics.items() if not name.endswith("image_raw")}
    return ros.BagRecorder(node.transport, path, topics)


def _print_start(transport: str, where: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json({"transport": transport, **where})
    elif "url" in where:
        print(f"Pepper over {transport}: {where['url']}; Ctrl-C ends it")
    else:
        reach = where.get("router") or where["discovery_range"].replace("LOCALHOST", "this machine")
        print(f"Pepper over {transport}: ROS_DOMAIN_ID {where['domain_id']}, {reach}; Ctrl-C ends it")
        if transport == "cyclonedds":
            print("Topics only: for services and actions use rclpy or rosbridge")
    sys.stdout.flush()


def _transport(
    name: str, address: str | None, port: int | None, allow_remote: bool, token: str | None
) -> tuple[ros.Transport, dict[str, Any]]:
    """Return a transport by name, and its address for clients."""
    if name == "rosbridge":
        server = transports.RosbridgeServer(
            "127.0.0.1" if address is None else address,
            transports.DEFAULT_PORT if port is None else port,
            allow_remote=allow_remote,
            token=token,
        )
        return server, {"url": server.url}
    if name not in TRANSPORTS:
        raise InvalidValueError("transport", repr(name), f"one of {', '.join(TRANSPORTS)}")
    others = {} if name == "zenoh" else {"--address": address, "--port": port}
    for option, value in {**others, "--token": token}.items():
        if value is not None:
            reason = "to be left out: only rosbridge has it; ROS_DOMAIN_ID names the graph"
            raise InvalidValueError(option, value, reason)
    if name == "zenoh":
        router = f"tcp/{address or ('0.0.0.0' if allow_remote else 'localhost')}:{port or 7447}"
        return transports.ZenohTransport(router=router), {"domain_id": domain_number(), "router": router}
    if not allow_remote:
        stay_on_this_machine()
    where = {"domain_id": domain_number(), "discovery_range": discovery_range()}
    if name == "rclpy":
        return transports.RclpyTransport("pepper_kin"), where
    return transports.CycloneTransport("pepper_kin"), where
