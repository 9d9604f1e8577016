"""Collision in machine code, with the verdicts of coal."""

from pepper_kin.collision.fast.checker import FastChecker, fast_checker_for
from pepper_kin.collision.fast.compiled import CompiledValidity

__all__ = ["CompiledValidity", "FastChecker", "fast_checker_for"]
