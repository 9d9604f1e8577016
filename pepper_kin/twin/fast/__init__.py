"""The step of the twin in machine code: for one robot, and for many at once."""
