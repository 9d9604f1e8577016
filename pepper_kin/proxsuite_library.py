"""ProxQP of the package `proxsuite`, whose wheel needs the OpenMP library of the system."""

from __future__ import annotations

from typing import Any

from pepper_kin.exceptions import MissingDependencyError


def proxqp() -> Any:
    """Return the module `proxsuite.proxqp`.

    Raises:
        MissingDependencyError: if the module, or the system's `libgomp.so.1`, cannot be loaded.
    """
    try:
        from proxsuite import proxqp as module
    except ImportError as error:
        purpose = f"the solver 'proxsuite' ({error})"
        if "libgomp" in str(error):
            command = "apt-get install libgomp1 (Debian, Ubuntu) or dnf install libgomp (Fedora)"
            raise MissingDependencyError("libgomp1", command, purpose) from error
        raise MissingDependencyError("proxsuite", "pip install 'proxsuite>=0.7,<0.9'", purpose) from error
    return module
