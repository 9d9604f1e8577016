"""Shared parts of all commands: options, exit codes, printing, progress and completion."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import check_file
from pepper_kin.plugins import plugins

FAILED = 1
MISUSED = 2
INTERRUPTED = 130

STAGES = ("inverse kinematics and path", "timing", "certificate", "twin", "report")
"""Stages of a reach, in order."""

BASES = ("fixed", "planar")
HANDS = ("locked", "mimic", "independent")
HEAD_LIMITS = ("urdf", "documented")
VIEWS = ("three-quarter", "front", "side", "top")
FORMATS = ("urdf", "srdf", "sdf", "mjcf")
SIDES = ("left", "right")
SOLVERS = ("fast", "reference")

Completer = Callable[[str], list[str]]


def one_of(names: tuple[str, ...]) -> Completer:
    """Return what completes a word to one of a few names."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return complete


def complete_posture(incomplete: str) -> list[str]:
    """Complete the name of a posture."""
    return one_of(pk.load_pepper().posture_names)(incomplete)


def complete_gesture(incomplete: str) -> list[str]:
    """Complete the name of a gesture, of the paper's or of the library's."""
    return one_of((*sorted(plugins("gestures")), *pk.motion.gesture_names()))(incomplete)


def registered(kind: str) -> type[TyperGroup]:
    """Return the class of commands to which those of a group of entry points are added."""

    class WithRegistered(TyperGroup):
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
            for name, entry in plugins(kind).items():
                if name not in self.commands:
                    self.commands[name] = typer.main.get_command(entry.load())
                    self.commands[name].name = name

    return WithRegistered


Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of words and tables.")]
Output = Annotated[Path, typer.Option("--output", "-o", help="Folder for the files; made if missing.")]
Seed = Annotated[int, typer.Option(help="Seed of all random choices.")]
Base = Annotated[str, typer.Option(help="fixed or planar.", autocompletion=one_of(BASES))]
Hands = Annotated[str, typer.Option(help="locked, mimic or independent.", autocompletion=one_of(HANDS))]
HeadLimits = Annotated[
    str,
    typer.Option(
        help="urdf or documented: the head's pitch ends at 36.5 or 25.5 degrees.",
        autocompletion=one_of(HEAD_LIMITS),
    ),
]
Solvers = Annotated[
    str,
    typer.Option(
        help="fast, or reference: by Pinocchio, placo, coal and toppra.", autocompletion=one_of(SOLVERS)
    ),
]
SceneFile = Annotated[
    Path | None,
    typer.Option(help="Scene to show: JSON; scene.json in the motion's folder, if it is there, if left out."),
]
NoScene = Annotated[bool, typer.Option("--no-scene", help="Show no scene.")]


def scene_of(motion: Path | None, scene: Path | None, no_scene: bool) -> pk.Scene | None:
    """Return the scene to show with a motion: the one that is named, else the one in the motion's folder.

    Raises:
        InvalidValueError: where one is named and none is to be shown.
        FileFormatError: for a file that is not a scene.
    """
    if no_scene and scene is not None:
        raise InvalidValueError("--scene", str(scene), "to be left out with --no-scene")
    if scene is None and motion is not None and not no_scene:
        scene = pk.jobs.scene_beside(motion)
    return None if scene is None else pk.Scene.load(scene)


def print_json(value: Any) -> None:
    """Print plain values as JSON."""
    print(json.dumps(value, indent=2))


def print_found(found: Any, as_json: bool) -> None:
    """Print what a job found: its report, or its values as JSON."""
    if as_json:
        print_json(found.as_dict())
    else:
        print(found.report())


def discard_output() -> None:
    """Send to nowhere what is left to print: Python would try again as it ends, and complain."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def check_record(path: Path | None, *suffixes: str) -> None:
    """Refuse a file to record to that does not end so, before anything moves, and make its folder.

    Raises:
        InvalidValueError: for another ending.
        FileFormatError: for a file that could not be written in the end.
    """
    if path is None:
        return
    if path.suffix.lower() not in suffixes:
        raise InvalidValueError("--record", repr(str(path)), f"a file that ends in {' or '.join(suffixes)}")
    check_file(path)


def print_written(paths: list[Path], as_json: bool) -> None:
    """Print which files were written."""
    if as_json:
        print_json({"written": [str(path) for path in paths]})
        return
    names = ", ".join(str(path) for path in paths[:3])
    print(f"Written: {names}" + (" ..." if len(paths) > 3 else ""))


@contextmanager
def progress(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar with the time left on the error stream, if that is a terminal, and nothing otherwise.

    Yields:
        What to call with the number of parts done and of all.
    """
    with _bar() as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def stages(silent: bool) -> Iterator[Callable[[str], None]]:
    """Report the stages of a reach: a bar on a terminal, a line each elsewhere, none if quiet.

    Yields:
        What to call with the name of each stage as it begins.
    """
    if sys.stderr is None or not sys.stderr.isatty():
        yield lambda stage: None if silent else print(f"  {stage} ...", file=sys.stderr, flush=True)
        return
    with _bar() as bar:
        task = bar.add_task("", total=len(STAGES))

        def tell(stage: str) -> None:
            bar.update(task, description=stage, completed=STAGES.index(stage) if stage in STAGES else 0)

        yield tell


def _bar() -> Any:
    """Return a bar that is seen on terminals only; colors follow NO_COLOR."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
