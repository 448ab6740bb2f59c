"""Growth of the housing by drawn temperatures."""

from pipeline.config.dimensions.thermal._growth import growth

DIMENSION = growth("housing", "the pin circle's radius", rank=130, draw_column=142)
