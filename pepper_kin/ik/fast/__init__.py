"""The fast solver: Levenberg-Marquardt in machine code over a kernel made for the tasks at hand."""

from pepper_kin.ik.fast.descender import FastDescender
from pepper_kin.ik.fast.prepared import Prepared, prepare
from pepper_kin.ik.fast.search import Rows, alternatives, solutions_from, solve_one
from pepper_kin.ik.fast.structure import KINDS, structures_of

__all__ = [
    "KINDS",
    "FastDescender",
    "Prepared",
    "Rows",
    "alternatives",
    "prepare",
    "solutions_from",
    "solve_one",
    "structures_of",
]
