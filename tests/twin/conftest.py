"""Fixtures of the twin's tests."""

import os
import subprocess
import sys

import numpy as np
import pytest


@pytest.fixture
def run_interpreted():
    """Return a function that runs a program by machine code and by the interpreter and returns what each
    prints."""

    def run(code):
        printed = []
        for interpreted in ("0", "1"):
            environment = {**os.environ, "NUMBA_DISABLE_JIT": interpreted}
            done = subprocess.run(
                [sys.executable, "-W", "ignore", "-c", code],
                capture_output=True, text=True, check=True, env=environment,
            )  # fmt: skip
            printed.append(np.fromstring(done.stdout.strip().strip("[]"), sep=" "))
        assert printed[0].size
        return printed

    return run
