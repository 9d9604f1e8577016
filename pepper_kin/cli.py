"""The command `pepper-kin`: argument parsing and printing, nothing else."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from pepper_kin import cli_check, cli_show
from pepper_kin.atomic_file import check_folder
from pepper_kin.cli_terminal import (
    FAILED,
    FORMATS,
    INTERRUPTED,
    MISUSED,
    SIDES,
    Base,
    Hands,
    Json,
    NoScene,
    Output,
    SceneFile,
    Seed,
    complete_gesture,
    complete_posture,
    discard_output,
    one_of,
    print_json,
    print_written,
    progress,
    scene_of,
    stages,
)
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, PepperKinError
from pepper_kin.plugins import plugins

if TYPE_CHECKING:
    from pepper_kin.jobs import ReachOutcome
    from pepper_kin.model import PepperModel

WELCOME = """\
See it work:      pepper-kin demo                                     then open pepper-kin-demo/motion.html
Your own target:  pepper-kin reach --hand left --at 0.38 0.22 0.82
Learn more:       pepper-kin COMMAND --help, and docs/start.md
"""


class _Commands(TyperGroup):
    """The commands below, and those that are registered, which are imported where they are needed."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all."""
        self._add_registered()
        return super().list_commands(ctx)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, or None."""
        if cmd_name not in self.commands:
            self._add_registered()
        return super().get_command(ctx, cmd_name)

    def _add_registered(self) -> None:
        for name, entry in plugins("commands").items():
            if name not in self.commands:
                self.commands[name] = typer.main.get_command(entry.load())
                self.commands[name].name = name


app = typer.Typer(
    name="pepper-kin",
    cls=_Commands,
    help="Kinematics, dynamics, whole-body IK, planning, timing and a twin for Pepper.",
    pretty_exceptions_enable=False,
)

app.add_typer(cli_check.app, name="check")
app.add_typer(cli_show.app)

Point = tuple[float, float, float]


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    """Kinematics, dynamics, whole-body IK, planning, timing and a twin for Pepper."""
    if version:
        from importlib.metadata import version as version_of

        print(f"pepper-kin {version_of('pepper_kin')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(WELCOME)
        print(context.get_help())


@app.command()
def demo(output: Output = Path("pepper-kin-demo"), seed: Seed = 0, as_json: Json = False) -> None:
    """Reach over a table's edge, look at the spot, and report.

    Example: pepper-kin demo -o demo
    """
    from pepper_kin.jobs import run_demo
    from pepper_kin.model import load_pepper

    check_folder(output)
    pepper = load_pepper()
    with stages(as_json) as on_stage:
        outcome = run_demo(pepper, seed=seed, on_stage=on_stage)
    _finish_reach(pepper, outcome, output, as_json)


@app.command()
def reach(
    hand: Annotated[str, typer.Option(help="left or right.", autocompletion=one_of(SIDES))],
    at: Annotated[Point, typer.Option(help="Where the palm should go: X Y Z, in meters.")],
    look_at: Annotated[
        Point | None, typer.Option(help="Where the camera should look: X Y Z, in meters.")
    ] = None,
    avoid_box: Annotated[
        list[str] | None,
        typer.Option(help='A box "SX,SY,SZ,X,Y,Z": full lengths and center, in meters; may be repeated.'),
    ] = None,
    start_from: Annotated[
        str | None,
        typer.Option(help="Posture to start from; Stand if left out.", autocompletion=complete_posture),
    ] = None,
    output: Output = Path("pepper-kin-reach"),
    *,
    seed: Seed = 0,
    timeout: Annotated[float, typer.Option(help="Time budget of IK and planning, in seconds.")] = 10.0,
    as_json: Json = False,
) -> None:
    """Reach with a hand and look at a point, without collisions and within all limits.

    Example: pepper-kin reach --hand left --at 0.38 0.22 0.82 -o out
    """
    from pepper_kin.jobs import reach as run_reach
    from pepper_kin.model import load_pepper

    check_folder(output)
    pepper = load_pepper()
    begin = None if start_from is None else pepper.posture(start_from)
    scene = _scene(avoid_box or [])
    with stages(as_json) as on_stage:
        outcome = run_reach(
            pepper, hand, at, look_at, scene, start=begin, seed=seed, timeout=timeout, on_stage=on_stage
        )
    _finish_reach(pepper, outcome, output, as_json)


@app.command("warm-up")
def warm_up(
    native: Annotated[
        bool, typer.Option("--native", help="Make and use code for this very processor, not the package's.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Make all machine code that this processor needs, on all cores, once.

    Needed only where the code that comes with the package does not fit; otherwise it is done in a moment.

    Example: pepper-kin warm-up --native
    """
    from pepper_kin.jobs import warm_up as run_warm_up

    with progress("machine code") as on_progress:
        made = run_warm_up(native, on_progress)
    _print(made, as_json)


@app.command()
def export(
    format: Annotated[str, typer.Argument(help="urdf, srdf, sdf or mjcf.", autocompletion=one_of(FORMATS))],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write; printed if left out.")
    ] = None,
    base: Base = "fixed",
    hands: Hands = "locked",
    mesh_paths: Annotated[
        str | None,
        typer.Option(help="package, absolute or relative; relative copies the meshes beside the file."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the robot for another program.

    Example: pepper-kin export mjcf --hands mimic --mesh-paths relative -o pepper/pepper.xml
    """
    from pepper_kin.jobs import save_export
    from pepper_kin.model import export as export_text
    from pepper_kin.model import load_pepper

    pepper = load_pepper(base=base, hands=hands)
    if output is None:
        text = export_text(pepper, format, mesh_paths=mesh_paths)
        if as_json:
            print_json({"format": format, "text": text})
        else:
            print(text)
        return
    print_written(save_export(pepper, format, output, mesh_paths=mesh_paths), as_json)


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
    from pepper_kin.jobs import make_gesture, save_gesture, save_library_gesture
    from pepper_kin.model import load_pepper
    from pepper_kin.twin import GESTURES, replay

    if output is not None:
        check_folder(output)
    pepper = load_pepper()
    if name in GESTURES:
        _refuse_options(name, side=side, amplitude=amplitude, tempo=tempo)
        replayed = replay(pepper, name)
        if output is not None:
            save_gesture(replayed, output)
        _print(replayed, as_json)
        return
    made = make_gesture(
        pepper,
        name,
        side="right" if side is None else side,
        amplitude=1.0 if amplitude is None else amplitude,
        tempo=1.0 if tempo is None else tempo,
    )
    if output is not None:
        save_library_gesture(made, output)
    _print(made, as_json)
    if not made.certificate.success:
        raise typer.Exit(FAILED)


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
    as_json: Json = False,
) -> None:
    """Open Pepper in the browser: sliders, targets to drag, obstacles, planning.  Ctrl-C ends it.

    Example: pepper-kin view demo/trajectory.csv
    """
    import json
    import webbrowser

    from pepper_kin.files import load
    from pepper_kin.model import load_pepper
    from pepper_kin.viewer.server import Access, serve

    access = Access.of(host, allow_remote, token)
    pepper = load_pepper(base=base, hands=hands)

    def announce(url: str) -> None:
        print(json.dumps({"url": url}) if as_json else url, flush=True)
        if not no_open:
            webbrowser.open(url)

    serve(
        pepper,
        access,
        port,
        scene=scene_of(file, scene, no_scene),
        motion=None if file is None else load(file, pepper),
        on_start=announce,
    )


def _refuse_options(gesture: str, **options: object) -> None:
    """Refuse options of authored gestures where one of the paper's is replayed, which has none."""
    for option, value in options.items():
        if value is not None:
            raise InvalidValueError(
                f"--{option}", value, f"to be omitted: {gesture!r} is replayed as published"
            )


def _scene(boxes: list[str]) -> Any:
    from pepper_kin.collision import Scene

    scene = Scene()
    for index, text in enumerate(boxes):
        try:
            numbers = [float(part) for part in text.replace(",", " ").split()]
        except ValueError:
            numbers = []
        if len(numbers) != 6:
            raise InvalidValueError("--avoid-box", repr(text), "six numbers SX,SY,SZ,X,Y,Z [m]")
        scene = scene.add_box(f"box{index + 1}", size=numbers[:3], position=numbers[3:])
    return scene


def _print(found: Any, as_json: bool) -> None:
    if as_json:
        print_json(found.as_dict())
    else:
        print(found.report())


def _finish_reach(pepper: PepperModel, outcome: ReachOutcome, output: Path, as_json: bool) -> None:
    """Write the files, print the report, and exit with an error where the job was not done."""
    from pepper_kin.jobs import result_files
    from pepper_kin.viewer import save_reach_html

    if outcome.run is None:
        if as_json:
            print_json(result_files.summary(pepper, outcome))
        print(outcome.message, file=sys.stderr)
        raise typer.Exit(FAILED)
    files = result_files.save_outcome(pepper, outcome, output)
    files["motion.html"] = save_reach_html(pepper, outcome, output / "motion.html")
    if as_json:
        print_json(result_files.summary(pepper, outcome))
    else:
        _print_reach(outcome)
        print("Written: " + ", ".join(str(path) for path in files.values()))
        print(f"Open {files['motion.html']} in a browser to see the motion.")
    if not outcome.success:
        print(outcome.message, file=sys.stderr)
        raise typer.Exit(FAILED)


def _print_reach(outcome: ReachOutcome) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    figures = outcome.figures
    table = Table(title="Reach", show_header=False)
    gaze = figures["gaze_error_rad"]
    rows = [
        ("hand error", f"{figures['hand_error_m'] * 1000:.2f} mm"),
        ("gaze error", "free" if gaze is None else f"{gaze * 57.29578:.3f} deg"),
        ("path length, joints", f"{figures['path_length_joint']:.3f} rad"),
        ("path length, hand", f"{figures['hand_path_length_m']:.3f} m"),
        ("duration", f"{figures['duration_s']:.3f} s"),
        ("smallest clearance, planned", f"{figures['smallest_clearance_planned_m'] * 1000:.1f} mm"),
        ("smallest clearance, executed", f"{figures['smallest_clearance_executed_m'] * 1000:.1f} mm"),
        ("largest tracking error", f"{figures['tracking_error_max'] * 1000:.2f} mrad"),
    ]
    for row in rows:
        table.add_row(*row)
    joints = Table(title="Joints")
    for heading in ("joint", "peak torque [% of limit]", "rms tracking error [mrad]"):
        # Escaped: in brackets rich looks for its own commands, and drops what it takes for one.
        joints.add_column(escape(heading), justify="left" if heading == "joint" else "right")
    for joint, use in figures["peak_torque_use"].items():
        joints.add_row(
            escape(joint), f"{use * 100:.1f}", f"{figures['tracking_error_rms'][joint] * 1000:.3f}"
        )
    console = Console()
    console.print(table)
    console.print(joints)
    console.print(outcome.message, markup=False)


def main() -> None:
    """Run the command line.

    Exit codes: 0 done; 1 not found, or a check failed; 2 misuse, with one line of explanation; 130 Ctrl-C.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files need not be text in its encoding
    try:
        try:
            app()
        finally:
            # Here a failure to write can still be reported; there is no stream where it was closed.
            if sys.stdout is not None and not sys.stdout.closed:
                sys.stdout.flush()
    except InfeasibleError as error:
        print(f"pepper-kin: {error}", file=sys.stderr)
        sys.exit(FAILED)
    except PepperKinError as error:
        print(f"pepper-kin: {error}", file=sys.stderr)
        sys.exit(MISUSED)
    except OSError as error:
        if error.filename is not None:
            raise
        print(f"pepper-kin: the output cannot be written: {error.strerror or error}", file=sys.stderr)
        discard_output()
        sys.exit(FAILED)
    except KeyboardInterrupt:  # while the command line was being read
        sys.exit(INTERRUPTED)
