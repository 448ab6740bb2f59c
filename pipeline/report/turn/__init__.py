"""The section of the report on the turn: transmission error, forces, contact life and efficiency."""
