"""Two-lobed ovality of the housing."""

from pipeline.model.effects._ovality import ovality

EFFECT = ovality(2, "two", period="half", confusable="ovality_3")
