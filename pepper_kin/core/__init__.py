"""Each algorithm once, on arrays and tables, as machine code, independent of robots' models and scenes.

A function with a signature takes arrays and tables (NamedTuples of arrays), writes into arrays of its
arguments, and returns a number or a status.  `docs/design.md` has a recipe for adding one.
"""
