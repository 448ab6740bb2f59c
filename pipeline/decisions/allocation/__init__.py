"""The loosest tolerances that keep the limits at a wanted yield for the least cost."""
