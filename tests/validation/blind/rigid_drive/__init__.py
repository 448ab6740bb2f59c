"""A second simulator of a drive, apart from ``pipeline.model``: rigid bodies at finite poses, Palmgren's law."""
