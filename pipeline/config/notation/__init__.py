"""Tolerances written as on a drawing: limits in mm, and ISO codes."""

from pipeline.config.notation.written import with_notation

__all__ = ["with_notation"]
