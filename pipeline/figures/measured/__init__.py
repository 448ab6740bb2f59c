"""Measured units against the models."""
