"""Study files: tolerances, settings and limits for a design."""
