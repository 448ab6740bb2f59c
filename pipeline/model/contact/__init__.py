"""Local deflection of a contact under its force, and friction elements."""
