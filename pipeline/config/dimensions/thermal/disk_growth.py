"""Growth of the disk by drawn temperatures."""

from pipeline.config.dimensions.thermal._growth import growth

DIMENSION = growth("disk", "the disk at the pin circle's radius", rank=110, draw_column=140)
