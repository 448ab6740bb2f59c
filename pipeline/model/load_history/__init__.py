"""A drive under a load program: frictionless curves, load paths with friction, creep, means over cells."""
