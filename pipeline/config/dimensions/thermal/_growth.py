"""Growth of a part by its temperature, which differs from unit to unit; the section `[temperature]` states it."""

from __future__ import annotations

from pipeline.config.dimensions.dimension import Dimension, Need


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
            lambda design: design.thermal is not None and part in design.thermal.drawn,
            f"{part}_C in [temperature] with a distribution",
        ),
        counted_where_varied=True,
    )
