"""The library of effects: what a reducer may do that its model lacks.

A file defines ``EFFECT`` or a tuple ``EFFECTS``; adding one is adding an entry or a file here, or an entry point of
another package. An effect is a function from drive to drive with one to three parameters, so whatever solves a drive
solves it with the effect inside.
"""

from pipeline.model.effects.effect import Conditions, Effect, Parameter, library

__all__ = ["Conditions", "Effect", "Parameter", "library"]
