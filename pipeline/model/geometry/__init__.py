"""Flank, bodies and contacts of a reducer; manufacturing errors to gaps; the play of rigid bodies."""
