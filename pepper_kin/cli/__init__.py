"""The command `pepper-kin`: what a user of the package would write, with options, printing and exit codes.

    main    runs it: what the script calls
    app     its commands, as a Typer application

Its files import `pepper_kin` itself, whose packages are loaded when a command first uses them: the help and
the completion of a shell do without them.
"""

from pepper_kin.cli.program import app, main

__all__ = ["app", "main"]
