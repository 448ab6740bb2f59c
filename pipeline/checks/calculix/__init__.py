"""The reducer as an input deck of CalculiX, a finite-element program of other authors, and what it answers."""

from pipeline.checks.calculix.deck import Deck, calculix_deck
from pipeline.checks.calculix.export import export
from pipeline.checks.calculix.program import INSTALL, PROGRAM, THREADS, ProgramResult, calculix_program, run_calculix

__all__ = [
    "INSTALL",
    "PROGRAM",
    "THREADS",
    "ProgramResult",
    "Deck",
    "calculix_deck",
    "calculix_program",
    "export",
    "run_calculix",
]
