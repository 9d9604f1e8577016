"""Motions that are cheap, not only possible: path and timing optimized together."""
