"""Growth of the crank by drawn temperatures."""

from pipeline.config.dimensions.thermal._growth import growth

DIMENSION = growth("crank", "the eccentricity", rank=140, draw_column=143)
