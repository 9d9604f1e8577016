"""The commands `warm-up`, `doctor`, `export` and `gesture`: argument parsing and printing, nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pepper_kin as pk
from pepper_kin.cli.terminal import (
    FAILED,
    FORMATS,
    SIDES,
    Base,
    Hands,
    HeadLimits,
    Json,
    complete_gesture,
    one_of,
    print_found,
    print_json,
    print_written,
    progress,
)
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import check_folder
from pepper_kin.plugins import plugins

app = typer.Typer()


@app.command("warm-up")
def warm_up(
    native: Annotated[
        bool, typer.Option("--native", help="Make and use code for this very processor, not the wheel's.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Make all machine code that this processor needs, on all cores, once.

    Where it is there already, as in a wheel for this platform, it is done in a moment.

    Example: pepper-kin warm-up --native
    """
    with progress("machine code") as on_progress:
        made = pk.jobs.warm_up(native, on_progress)
    print_found(made, as_json)


@app.command()
def doctor(as_json: Json = False) -> None:
    """Say what is installed, which machine code runs, what is missing, and which extra brings it.

    Ends with 1 where something that belongs to the library is missing.  For a robot: pepper-kin naoqi doctor.

    Example: pepper-kin doctor
    """
    found = pk.jobs.check_installation(pk.viewer.find_chromium())
    print_found(found, as_json)
    if not found.success:
        raise typer.Exit(FAILED)


@app.command()
def export(
    format: Annotated[str, typer.Argument(help="urdf, srdf, sdf or mjcf.", autocompletion=one_of(FORMATS))],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write; printed if left out.")
    ] = None,
    base: Base = "fixed",
    hands: Hands = "locked",
    head_limits: HeadLimits = "urdf",
    mesh_paths: Annotated[
        str | None,
        typer.Option(help="package, absolute or relative; relative copies the meshes beside the file."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the robot for another program.

    Example: pepper-kin export mjcf --hands mimic --mesh-paths relative -o pepper/pepper.xml
    """
    pepper = pk.load_pepper(base, hands, head_limits=head_limits)
    if output is None:
        text = pk.model.export(pepper, format, mesh_paths=mesh_paths)
        if as_json:
            print_json({"format": format, "text": text})
        else:
            print(text)
        return
    print_written(pk.jobs.save_export(pepper, format, output, mesh_paths=mesh_paths), as_json)


@app.command()
def gesture(
    name: Annotated[
        str,
        typer.Argument(
            help="left-arm, right-arm, head (the paper's), or wave, bow, ...", autocompletion=complete_gesture
        ),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the files.")] = None,
    side: Annotated[
        str | None,
        typer.Option(help="right or left; right if left out.", autocompletion=one_of(SIDES)),
    ] = None,
    amplitude: Annotated[
        float | None, typer.Option(help="Share of the authored way, up to 1.25; 1 if left out.")
    ] = None,
    tempo: Annotated[
        float | None,
        typer.Option(help="Speed relative to the authored one, 0.25 to 4; 1 if left out."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Make a gesture of the library and examine it, or replay one of the paper's table 5 on the twin.

    Example: pepper-kin gesture wave --side left -o wave
    """
    if output is not None:
        check_folder(output)
    pepper = pk.load_pepper()
    if name in plugins("gestures"):
        _refuse_options(name, side=side, amplitude=amplitude, tempo=tempo)
        replayed = plugins("gestures")[name].load()(pepper, name)
        if output is not None:
            pk.jobs.save_gesture(replayed, output)
        print_found(replayed, as_json)
        return
    made = pk.jobs.make_gesture(
        pepper,
        name,
        side="right" if side is None else side,
        amplitude=1.0 if amplitude is None else amplitude,
        tempo=1.0 if tempo is None else tempo,
    )
    if output is not None:
        pk.jobs.save_library_gesture(made, output)
    print_found(made, as_json)
    if not made.certificate.success:
        raise typer.Exit(FAILED)


def _refuse_options(gesture: str, **options: object) -> None:
    """Refuse options of authored gestures where one of the paper's is replayed, which has none."""
    for option, value in options.items():
        if value is not None:
            raise InvalidValueError(
                f"--{option}", value, f"to be omitted: {gesture!r} is replayed as published"
            )
