"""Temperatures of the parts of a reducer: stated, or drawn from unit to unit."""
