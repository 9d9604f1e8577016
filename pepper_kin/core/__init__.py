"""Each algorithm once, on arrays and tables, as machine code; nothing here knows a robot's model or a scene.

A function with a signature takes arrays and tables (NamedTuples of arrays), writes into arrays that it is
given, and returns a number or a status.  `docs/design.md` has a recipe for adding one.
"""
