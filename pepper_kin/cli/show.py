"""The commands `pepper-kin plot` and `render`: argument parsing and printing, nothing else."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

import pepper_kin as pk
from pepper_kin.cli.terminal import (
    VIEWS,
    Base,
    Hands,
    HeadLimits,
    Json,
    NoScene,
    SceneFile,
    one_of,
    print_written,
    progress,
    scene_of,
)
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import check_file

if TYPE_CHECKING:
    from pepper_kin.viewer.camera import CameraView

app = typer.Typer()

MotionFile = Annotated[
    Path,
    typer.Argument(
        help="Trajectory (.csv, .npz, .json, .yaml, .py, .mcap), run (.csv) or recording (folder)."
    ),
]


@app.command()
def plot(
    files: Annotated[
        list[Path],
        typer.Argument(help="Trajectories (.csv, .npz, .json, .yaml, .py, .mcap), runs or recordings."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Picture: .png, .pdf or .svg.")],
    scene: Annotated[
        Path | None, typer.Option(help="Scene whose attached objects count with their mass: JSON.")
    ] = None,
    base: Base = "fixed",
    hands: Hands = "locked",
    head_limits: HeadLimits = "urdf",
    as_json: Json = False,
) -> None:
    """Draw a trajectory as shares of Pepper's limits; a run, or several motions, in units.

    Example: pepper-kin plot demo/trajectory.csv demo/run.csv -o demo/both.pdf
    """
    pepper = pk.load_pepper(base, hands, head_limits=head_limits)
    motions = {name: pk.jobs.load_motion(pepper, file) for name, file in _named(files).items()}
    check_file(output)
    held = None if scene is None else pk.Scene.load(scene)
    if len(files) == 1 and isinstance(only := next(iter(motions.values())), pk.Trajectory):
        pk.trajectory.plot(pepper, only, output, title=files[0].name, scene=held)
    else:
        pk.trajectory.plot_motions(pepper, motions, output, scene=held)
    print_written([output], as_json)


def _named(files: list[Path]) -> dict[str, Path]:
    """Return files by what tells them apart: their names, with folders where these are the same."""
    names = [file.stem for file in files]
    if len(set(names)) < len(names):
        names = [str(file) for file in files]
    return dict(zip(names, files, strict=True))


@app.command()
def render(
    file: MotionFile,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Film (.mp4, .gif), picture (.png) or page (.html).")
    ],
    scene: SceneFile = None,
    *,
    no_scene: NoScene = False,
    fps: Annotated[float | None, typer.Option(help="Frames per second of a film; 30 if left out.")] = None,
    size: Annotated[
        str | None,
        typer.Option(help="Width x height of a film or picture, in pixels; 1280x800 if left out."),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            help=f"View of a film or picture: {', '.join(VIEWS)}; the first if left out.",
            autocompletion=one_of(VIEWS),
        ),
    ] = None,
    camera: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            help="In place of --view: where the camera is and where it looks, X Y Z X Y Z in meters."
        ),
    ] = None,
    at_time: Annotated[
        float | None, typer.Option(help="Time that a picture shows, in seconds; 0 if left out.")
    ] = None,
    base: Base = "fixed",
    hands: Hands = "locked",
    as_json: Json = False,
) -> None:
    """Render a trajectory or a run as a film, a picture, or a page that plays and scrubs it.

    Example: pepper-kin render demo/run.csv -o demo/movie.mp4
    """
    if camera is not None and view is not None:
        raise InvalidValueError("--camera", camera, f"to be left out with --view {view}")
    view_or_camera = (
        cast("CameraView | None", view) if camera is None else pk.viewer.Viewpoint(camera[:3], camera[3:])
    )
    pixels = None if size is None else _size(size)
    pepper = pk.load_pepper(base=base, hands=hands)
    motion = pk.jobs.load_motion(pepper, file)
    around = scene_of(file, scene, no_scene)
    check_file(output)
    if not as_json:
        print(f"  rendering {output} ...", file=sys.stderr, flush=True)
    with progress("rendering") as report:
        path = pk.viewer.render_motion(
            pepper, motion, output, scene=around, fps=fps, size=pixels, view=view_or_camera,
            at_time=at_time, on_frame=report,
        )  # fmt: skip
    print_written([path], as_json)


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.strip().isdecimal() for part in parts):
        raise InvalidValueError("--size", repr(text), "WIDTHxHEIGHT in pixels, such as 1280x800")
    return int(parts[0]), int(parts[1])
