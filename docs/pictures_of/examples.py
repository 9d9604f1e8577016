"""What the examples compute: each is run as it stands, and its pictures are drawn from its own variables."""

from __future__ import annotations

import contextlib
import io
import os
import runpy
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@cache
def variables_of(name: str, *arguments: str) -> dict[str, Any]:
    """Run an example in an empty folder and return its variables; what it prints goes nowhere."""
    (script,) = EXAMPLES.glob(f"{name}*.py")
    before, variables = Path.cwd(), sys.argv
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        os.chdir(folder)
        sys.argv = [script.name, *arguments]
        try:
            return runpy.run_path(str(script))
        finally:
            os.chdir(before)
            sys.argv = variables
