"""Two-lobed ovality of the housing."""

from pipeline.model.effects.gaps._ovality import ovality

EFFECT = ovality(2, "two", period="half", confusable="ovality_3")
