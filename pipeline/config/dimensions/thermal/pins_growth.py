"""Growth of the pins by drawn temperatures."""

from pipeline.config.dimensions.thermal._growth import growth

DIMENSION = growth("pins", "the pins' radius", rank=120, draw_column=141)
