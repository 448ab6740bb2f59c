"""Growth of the parts by temperatures that a study draws."""

from pipeline.config.dimensions.dimension import Dimension, Need


# Growth of a part by its temperature, which differs from unit to unit; the section `[temperature]` states it.
def growth(part: str, length: str, rank: int, draw_column: int) -> Dimension:
    """The growth of a part, told of its characteristic length."""
    return Dimension(
        name=f"{part}_growth",
        title=f"thermal growth of {part}",
        sign=f"of {length}, warmer than its mean temperature positive",
        meaning=f"growth of {length} beyond that at the mean temperature of the {part}",
        rank=rank,
        draw_columns=(draw_column,),
        need=Need(
            lambda design: design.thermal is not None and part in design.thermal.drawn_parts,
            f"{part}_C in [temperature] with a distribution",
        ),
        counted_where_varied=True,
    )


DIMENSIONS = (
    # Growth of the disk by drawn temperatures.
    growth("disk", "the disk at the pin circle's radius", rank=110, draw_column=140),
    # Growth of the pins by drawn temperatures.
    growth("pins", "the pins' radius", rank=120, draw_column=141),
    # Growth of the housing by drawn temperatures.
    growth("housing", "the pin circle's radius", rank=130, draw_column=142),
    # Growth of the crank by drawn temperatures.
    growth("crank", "the eccentricity", rank=140, draw_column=143),
)
