"""The command `pepper-kin view`: argument parsing and printing, nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

import pepper_kin as pk
from pepper_kin.cli.terminal import Base, Hands, HeadLimits, Json, NoScene, SceneFile, scene_of
from pepper_kin.viewer import server

app = typer.Typer()


@app.command()
def view(
    file: Annotated[
        Path | None, typer.Argument(help="Trajectory to show: .csv, .npz, .json, .yaml, .py or .mcap.")
    ] = None,
    scene: SceneFile = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Print the address only.")] = False,
    *,
    no_scene: NoScene = False,
    port: Annotated[
        int | None, typer.Option(help="0 for any; the first free one from 7878 on if left out.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let --host be one that other machines reach.")
    ] = False,
    token: Annotated[
        str | None, typer.Option(help="Token in the address; a new random one for a remote host if omitted.")
    ] = None,
    base: Base = "fixed",
    hands: Hands = "locked",
    head_limits: HeadLimits = "urdf",
    as_json: Json = False,
) -> None:
    """Open Pepper in the browser: sliders, targets to drag, obstacles, planning.  Ctrl-C ends it.

    Example: pepper-kin view demo/trajectory.csv
    """
    access = server.Access.of(host, allow_remote, token)
    pepper = pk.load_pepper(base, hands, head_limits=head_limits)

    def announce(url: str) -> None:
        print(json.dumps({"url": url}) if as_json else url, flush=True)
        if not no_open:
            import webbrowser

            webbrowser.open(url)

    server.serve(
        pepper,
        access,
        port,
        scene=scene_of(file, scene, no_scene),
        motion=None if file is None else pk.files.load(file, pepper=pepper),
        on_start=announce,
    )
