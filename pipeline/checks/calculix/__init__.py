"""The reducer as an input deck of CalculiX, a finite-element program of other authors, and what it answers."""
