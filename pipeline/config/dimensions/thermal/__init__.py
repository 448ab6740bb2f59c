"""Growth of the parts by temperatures that a study draws."""
