"""Load paths with friction, where a state depends on the way to it."""
