"""Dimensions of the output mechanism."""
