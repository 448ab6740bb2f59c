"""What was measured, before any model: files, rows, faults, branches, repeatability."""
