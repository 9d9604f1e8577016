"""The commands `pepper-kin naoqi ...`: argument parsing and printing, nothing else."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

import pepper_kin as pk
from pepper_kin import naoqi
from pepper_kin.cli.terminal import FAILED, Json, check_record, one_of, print_json, print_written
from pepper_kin.exceptions import InvalidValueError, PepperKinError
from pepper_kin.file_access.atomic_file import check_file
from pepper_kin.lazy_names import lazy_module
from pepper_kin.naoqi.behaviors import PROJECTS
from pepper_kin.naoqi.doctor import examine
from pepper_kin.naoqi.qi_library import libqi
from pepper_kin.naoqi.scripts import ScriptResult
from pepper_kin.servers.end_signals import ended_by_signals

body_page = lazy_module("pepper_kin.naoqi.body_page")

app = typer.Typer(
    add_completion=False, help="NAOqi's modules over the twin: for clients of qi, and for scripts."
)

MODES = ("twin", "robot")

EVERY = 50
"""Number of robot states between two printed lines about its differences from the twin."""

Scene_ = Annotated[Path | None, typer.Option("--scene", help="What stands around the robot: JSON.")]
Mode = Annotated[
    str, typer.Option(help="robot refuses what Pepper refuses; twin does it.", autocompletion=one_of(MODES))
]
View = Annotated[bool, typer.Option("--view", help="Show the robot in the browser meanwhile.")]
Record = Annotated[Path | None, typer.Option(help="Write the run there: .csv.")]


@app.command()
def serve(
    port: Annotated[int, typer.Option(help="Where to listen; 0 for any.")] = 9559,
    address: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    mode: Mode = "twin",
    scene: Scene_ = None,
    *,
    view: View = False,
    record: Record = None,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let --address be one that other machines reach.")
    ] = False,
    token: Annotated[
        str | None,
        typer.Option(help="What clients need to move anything; made and printed with --allow-remote."),
    ] = None,
    as_json: Json = False,
) -> None:
    r"""Host the modules for any qi client, in real time.  Ctrl-C or SIGTERM ends it.

    Needs: pip install 'pepper_kin\[naoqi]'

    Example: pepper-kin naoqi serve --view
    """
    libqi()  # before all others
    with (
        ended_by_signals() as ended,
        _broker(mode, True, scene, view, record) as broker,
        naoqi.Host(broker, address, port, allow_remote=allow_remote, token=token) as host,
    ):
        if as_json:
            print_json({"url": host.url, "modules": list(broker.module_names), "token": host.token})
        else:
            print(f"{host.url}: {len(broker.module_names)} modules; Ctrl-C ends it", flush=True)
            if host.token is not None:
                print(f"token: {host.token}", flush=True)
        sys.stdout.flush()
        host.wait(ended)


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def run(
    context: typer.Context,
    script: Annotated[
        Path,
        typer.Argument(help="A script in Python 3 or 2, or a project of Choregraphe.", exists=True),
    ],
    fast: Annotated[
        bool, typer.Option("--fast", help="Let time pass as fast as it can be computed.")
    ] = False,
    max_time: Annotated[
        float | None, typer.Option(help="Interrupt the script after this time of the twin, in seconds.")
    ] = None,
    mode: Mode = "twin",
    scene: Scene_ = None,
    *,
    view: View = False,
    record: Record = None,
    as_json: Json = False,
) -> None:
    """Run an unmodified script against the twin; what follows its name is handed to it.

    A project of Choregraphe (.pml, .xar, .pkg or its folder) takes the name of one of its behaviors there.

    Example: pepper-kin naoqi run wave.py --fast
    """
    if max_time is not None and not max_time > 0:
        raise InvalidValueError("--max-time", max_time, "a time above 0, in seconds")
    with _broker(mode, not fast, scene, view, record) as broker:
        broker.on_log = lambda time, text: print(f"[{time:8.2f} s] {text}", file=sys.stderr)
        with redirect_stdout(sys.stderr if as_json else sys.stdout):
            result = _run(script, context.args, broker, max_time)
        logged = [{"time": time, "text": text} for time, text in broker.logged]
    if as_json:
        outcome = {"ended": result.ended, "code": result.code, "duration": result.duration, "logged": logged}
        print_json(outcome | {"failures": [list(one) for one in getattr(result, "failures", ())]})
    print(f"{script.name}: {result.ended} after {result.duration:.2f} s", file=sys.stderr)
    if result.error is not None and result.ended == "failed":
        traceback.print_exception(result.error)
    if not result.success:
        raise typer.Exit(result.code or FAILED)


def _run(path: Path, arguments: list[str], broker: naoqi.Broker, longest: float | None) -> ScriptResult:
    if not path.is_dir() and path.suffix.lower() not in PROJECTS:
        return naoqi.run_script(path, arguments, broker=broker, longest=longest)
    result = naoqi.run_behavior(path, *arguments[:1], broker=broker, longest=longest)
    others = [name for name in result.behaviors if name != result.behavior]
    said = f"; others: {', '.join(others)}" if others else ""
    print(f"{path.name}: behavior {result.behavior}{said}", file=sys.stderr)
    return result


@app.command()
def doctor(
    address: Annotated[str, typer.Argument(help="Robot: pepper.local, tcp://192.168.1.7:9559.")],
    token: Annotated[str | None, typer.Option(help="Of a simulated robot that needs one.")] = None,
    as_json: Json = False,
) -> None:
    r"""Say why a robot does not answer, or does not move; nothing is changed on it.

    Ends with 1 where something hinders motions.  Needs: pip install 'pepper_kin\[naoqi]'

    Example: pepper-kin naoqi doctor pepper.local
    """
    found = examine(address, token)
    if as_json:
        print_json([one._asdict() for one in found])
    else:
        for one in found:
            print(f"{one.cause}: {one.what}\n    {one.advice}")
        if not any(one.hinders for one in found):
            print(f"{address}: ready")
    if any(one.hinders for one in found):
        raise typer.Exit(FAILED)


@app.command()
def mirror(
    source: Annotated[str, typer.Argument(help="Robot (tcp://pepper.local:9559) or recorded run (.csv).")],
    seconds: Annotated[
        float | None, typer.Option(help="How long to follow a robot, in seconds; until Ctrl-C if left out.")
    ] = None,
    view: View = False,
    record: Annotated[
        Path | None, typer.Option(help="Write what was measured and commanded there, as a run: .csv.")
    ] = None,
    as_json: Json = False,
) -> None:
    r"""Let the twin get the commands of a robot, and show how the robot differs from it.

    Needs for robots: pip install 'pepper_kin\[naoqi]'

    Example: pepper-kin naoqi mirror tcp://127.0.0.1:9559 --seconds 10
    """
    if "://" in source:
        libqi()  # before all others, or a refused connection keeps the process from ending
    check_record(record, ".csv")
    pepper = pk.load_pepper(base="planar", hands="mimic")
    made, lost = naoqi.Mirror(pepper), None
    with ExitStack() as stack:
        ended = stack.enter_context(ended_by_signals())
        if "://" in source:
            robot = stack.enter_context(naoqi.Robot(source, pepper=pepper))
            states, pause = robot.states(seconds), 0.0
        else:
            run = pk.twin.load_run(pepper, source)
            states = naoqi.states_of_run(run)
            pause = float(run.time[-1]) / (len(run) - 1) if view else 0.0
        page = stack.enter_context(closing(body_page.MirrorPage(pepper))) if view else None
        if page is not None:
            page.open()
        try:
            for state in states:
                made.add(state)
                if page is not None:
                    page.show(*made.configuration)
                if len(made) % EVERY == 0:
                    _print_difference(made)
                if ended.wait(pause):
                    break
        except PepperKinError as error:
            if len(made) < 2:
                raise
            lost = error  # raised after the report, so that the states until then are reported
    if record is not None:
        made.run().save(record)
        print(f"Written: {record}", file=sys.stderr)
    if as_json:
        off = made.run().position - made.twin_run().position
        worst = dict(zip(pepper.joint_names, map(float, abs(off).max(axis=0)), strict=True))
        print_json({"states": len(made), "duration": made.run().duration, "most_off": worst})
    else:
        print(made.report())
    if lost is not None:
        raise lost


def _print_difference(made: naoqi.Mirror) -> None:
    """Print the three joints that are farthest from the twin now, on standard error."""
    off, names = made.difference, made.pepper.joint_names
    worst = sorted(range(len(names)), key=lambda k: -abs(off[k]))[:3]
    print(", ".join(f"{names[k]} {off[k]:+.4f}" for k in worst), file=sys.stderr)


@app.command()
def watchdog(
    output: Annotated[Path, typer.Option("--output", "-o", help="The file: a program in Python.")],
    as_json: Json = False,
) -> None:
    """Write the watchdog that runs on a robot: it stops the robot when a client falls silent.

    Example: pepper-kin naoqi watchdog -o watchdog.py
    """
    check_file(output)
    print_written([naoqi.Robot.write_watchdog(output)], as_json)


@app.command()
def methods(
    as_json: Json = False,
    counted: Annotated[bool, typer.Option("--table", help="Count them by module, as Markdown.")] = False,
) -> None:
    """List the methods of all modules: which are simulated, answered, or refused and why.

    Example: pepper-kin naoqi methods --table
    """
    if counted:
        print(naoqi.coverage_summary())
        return
    table = naoqi.coverage()
    if as_json:
        print_json([row._asdict() for row in table])
        return
    for row in table:
        print(f"{row.module}.{row.method}: {row.answer}")


@contextmanager
def _broker(
    mode: str, real_time: bool, scene: Path | None, view: bool, record: Path | None
) -> Iterator[naoqi.Broker]:
    """Yield a simulated robot, with a browser page if `view` and a log if `record`."""
    check_record(record, ".csv")
    around = None if scene is None else pk.Scene.load(scene)
    with naoqi.Broker(mode=mode, real_time=real_time, scene=around) as broker:
        close = _shown(broker) if view else None
        log = None if record is None else naoqi.RunLog(broker.body)
        try:
            yield broker
        finally:
            if log is not None and record is not None:
                save_log(log, record)
            if close is not None:
                close()


def save_log(log: naoqi.RunLog, path: Path) -> None:
    """Write a log as a run, and print its path; a log that is too short only prints a message."""
    if len(log) < 2:
        print(f"Not written: {path}: fewer than two cycles of 20 ms were logged", file=sys.stderr)
        return
    log.run().save(path)
    print(f"Written: {path}", file=sys.stderr)


def _shown(broker: naoqi.Broker) -> Callable[[], Any]:
    """Open a page that follows the robot; return its `close`."""
    page = body_page.BodyPage(broker.body, lights=broker.module("ALLeds").colors)
    page.open()
    return page.close
