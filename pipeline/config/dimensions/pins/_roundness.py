"""A pin out of round: waves of its radius around it, each pin turned as it happens to sit.

The pins are held against turning in the housing: each shows the disk the same side over the whole turn. One that rolls
in its seat shows another side each time, and its seat bears it on the side away from the disk: an oval pin then counts
twice, a three-lobed one, which has the same width all round, not at all. That is not modelled.
"""

from pipeline.config.dimensions.dimension import PINS, Dimension, Need

HELD = Need(
    lambda design: design.operation is None or design.operation.pins == "fixed", 'pins held, [operation] pins = "fixed"'
)


def roundness(order: int, lobed: str, rank: int, draw_columns: tuple[int, int]) -> Dimension:
    """The roundness error of so many waves."""
    return Dimension(
        name=f"pin_roundness_{order}",
        title=f"{lobed} roundness of pins",
        sign="amplitude of each pin, half of its roundness deviation; direction random; pins held against turning",
        meaning=f"amplitude of the pin's {lobed} wave, half of its roundness deviation",
        rank=rank,
        draw_columns=draw_columns,
        elements=PINS,
        need=HELD,
        one_sided=True,
        direction="direction in which the pin is thickest, counterclockwise from the crank at 0",
        counted_where_varied=True,
    )
