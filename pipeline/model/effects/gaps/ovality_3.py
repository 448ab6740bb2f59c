"""Three-lobed ovality of the housing."""

from pipeline.model.effects.gaps._ovality import ovality

EFFECT = ovality(3, "three", period="a third", confusable="ovality_2")
