"""Checks of the elastic disk: exact answers, and the same or another mesh solved whole by other programs."""
