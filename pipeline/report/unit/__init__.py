"""Pages on measured units: one, its change between two measurements, its description, a population."""
