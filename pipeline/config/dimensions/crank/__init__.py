"""Dimensions of the crank, its eccentrics and their bearings."""
