"""Two-lobed ovality of the housing."""

from pipeline.model.ovality import ovality

EFFECT = ovality(2, "two", other="ovality_3")
