"""The command `pepper-kin`: its commands, and how it ends."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer

from pepper_kin.cli import check, dataset, learn, making, reaching, show, view
from pepper_kin.cli.terminal import FAILED, INTERRUPTED, MISUSED, discard_output, registered
from pepper_kin.exceptions import InfeasibleError, PepperKinError

WELCOME = """\
See it work:      pepper-kin demo                                     then open pepper-kin-demo/motion.html
Your own target:  pepper-kin reach --hand left --at 0.38 0.22 0.82
Learn more:       pepper-kin COMMAND --help, and docs/start.md
"""


app = typer.Typer(
    name="pepper-kin",
    cls=registered("commands"),
    help="Kinematics, dynamics, whole-body IK, planning, timing and a twin for Pepper.",
    pretty_exceptions_enable=False,
)

for commands in (reaching.app, making.app, view.app, check.app, show.app, learn.app):
    app.add_typer(commands)
app.add_typer(dataset.app, name="dataset")


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


def main() -> None:
    """Run the command line.

    Exit codes: 0 done; 1 not found, or a check failed; 2 misuse, with one line of explanation; 130 Ctrl-C.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files need not be text in its encoding
    sys.unraisablehook = partial(_interrupt_again, sys.unraisablehook)
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
    except SystemExit as end:
        if end.code == INTERRUPTED:  # what was half made complains where it is deleted
            sys.unraisablehook = lambda _: None
        raise


def _interrupt_again(report: Callable[[Any], Any], unraisable: Any) -> None:
    """Interrupt once more where Ctrl-C met a destructor, which cannot raise: the program would go on."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT)).start()  # here it would be lost, too
    else:
        report(unraisable)
