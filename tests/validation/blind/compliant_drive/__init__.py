"""A third simulator of a drive, apart from ``pipeline.model``: power laws on a disk of coupled compliance."""
