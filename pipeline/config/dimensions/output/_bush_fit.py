"""What makes a bush lie looser on its pin acts as a change of the roller's diameter."""

from pipeline.config.dimensions.dimension import BUSHES, OUTPUT_PINS, Dimension


def bush_fit(
    name: str, title: str, sign: str, meaning: str, rank: int, draw_columns: tuple[int], side: int
) -> Dimension:
    """A diameter between pin and bush; ``side``: +1 where larger makes the roller count larger, else -1."""
    return Dimension(
        name=name,
        title=title,
        sign=sign,
        meaning=f"{meaning}, larger positive; acts through the roller's diameter",
        rank=rank,
        draw_columns=draw_columns,
        elements=OUTPUT_PINS,
        need=BUSHES,
        measure="diameter",
        gap_sign=1 if side < 0 else -1,
        size_um=lambda design: 2e3 * design.output.seat_radius_mm,
        acts_on="roller_diameter",
        shift=lambda diameter, direction, design: side * diameter,
        counted_where_varied=True,
    )
