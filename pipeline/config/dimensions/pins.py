"""Dimensions of the housing's pins and of the output mechanism."""

import numpy as np

from pipeline.arrays import Real
from pipeline.config.dimensions.dimension import BUSHES, OUTPUT_PINS, PINS, PINS_IN_HOLES, ROLLERS, Dimension, Need


# What makes a bush lie looser on its pin acts as a change of the roller's diameter.
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


OF_OUTPUT = (
    # Diameter of each output roller, or of what lies in the disk's holes: output pins, or their bushes outside.
    Dimension(
        name="roller_diameter",
        title="output roller or pin diameter",
        sign="each output roller, pin or bush; smaller gives clearance",
        meaning="diameter error, larger positive",
        rank=70,
        draw_columns=(11,),
        elements=ROLLERS,
        measure="diameter",
        size_um=lambda design: 2e3 * design.output.contact_radius_mm,
        gap_sign=-1,
    ),
    # Position of each output pin in the flange, as a circular zone about its true place.
    Dimension(
        name="output_pin_position",
        title="position of output pins",
        sign="offset of each pin axis from its true position, at most half of the zone's diameter; direction random",
        meaning="offset of the output pin's axis from its true position; 0 of rollers",
        rank=72,
        draw_columns=(120, 121),
        elements=OUTPUT_PINS,
        need=PINS_IN_HOLES,
        one_sided=True,
        direction="direction of that offset in the flange's frame, counterclockwise from the crank at 0",
        zone=True,
        counted_where_varied=True,
    ),
    # Diameter of each output pin under its bush; without bushes the pin is what `roller_diameter` is of.
    bush_fit(
        "output_pin_diameter",
        title="output pin diameter under bushes",
        sign="each pin under its bush; smaller gives clearance",
        meaning="diameter error of the pin under its bush",
        rank=75,
        draw_columns=(125,),
        side=1,
    ),
    # Bore of each bush: larger, it lies looser on its pin, as with a smaller bush.
    bush_fit(
        "bush_bore",
        title="bore diameter of bushes",
        sign="each bush; larger gives clearance",
        meaning="error of the bush's bore diameter",
        rank=76,
        draw_columns=(126,),
        side=-1,
    ),
)


# A pin circle out of round: waves of the pins' radial position along the circle.
def oval_shift(amplitude: Real, phase: Real, order: int, pins: int) -> Real:
    """Radial shift of the pins by a ring out of round, amplitude cos(order (theta - phase)).

    Parameters
    ----------
    amplitude : (n_samples,), in any unit of length.
    phase : (n_samples,) [rad].
    order : waves around the circle.
    pins : number of pins, clockwise from theta = 0.

    Returns
    -------
    (n_samples, pins), in the unit of the amplitude.
    """
    theta = -2 * np.pi * np.arange(pins) / pins
    return amplitude[:, None] * np.cos(order * (theta - phase[:, None]))


def two_points(order: int) -> str:
    """What the amplitude of a wave of the radius is of the largest diameter less the smallest one."""
    return "a quarter of Dmax - Dmin" if order % 2 == 0 else "not seen in Dmax - Dmin, which is 0"


def ovality(order: int, shape: str, rank: int, draw_columns: tuple[int, int]) -> Dimension:
    """The ovality of so many waves."""
    return Dimension(
        name=f"ovality_{order}",
        title=f"{shape} ovality of pin circle",
        sign=f"amplitude, half of the roundness deviation, {two_points(order)}; direction random",
        meaning=f"{shape} ovality of the pin circle, part of radial_um",
        rank=rank,
        draw_columns=draw_columns,
        one_sided=True,
        direction="direction in which the pin circle is widest",
        acts_on="pin_radial",
        shift=lambda amplitude, phase, design: oval_shift(amplitude, phase, order, design.cycloid.pins),
    )


# A pin out of round: waves of its radius around it, each pin turned as it happens to sit.
#
# The pins are held against turning in the housing: each shows the disk the same side over the whole turn. One that
# rolls in its seat shows another side each time, and its seat bears it on the side away from the disk: an oval pin then
# counts twice, a three-lobed one, which has the same width all round, not at all. That is not modelled.
HELD = Need(
    lambda design: design.operation is None or design.operation.pins == "fixed", 'pins held, [operation] pins = "fixed"'
)


def roundness(order: int, shape: str, rank: int, draw_columns: tuple[int, int]) -> Dimension:
    """The roundness error of so many waves."""
    return Dimension(
        name=f"pin_roundness_{order}",
        title=f"{shape} roundness of pins",
        sign=f"amplitude of each pin, half of its roundness deviation, {two_points(order)}; direction random; pins "
        "held against turning",
        meaning=f"amplitude of the pin's {shape} wave, half of its roundness deviation",
        rank=rank,
        draw_columns=draw_columns,
        elements=PINS,
        need=HELD,
        one_sided=True,
        direction="direction in which the pin is thickest, counterclockwise from the crank at 0",
        counted_where_varied=True,
    )


DIMENSIONS = (
    *OF_OUTPUT,
    # Radial position of each pin.
    Dimension(
        name="pin_radial",
        title="radial pin position",
        sign="each pin; outwards positive",
        meaning="position error outwards, ovalities included",
        rank=10,
        draw_columns=(7,),
        elements=PINS,
        gap_sign=1,
    ),
    # Tangential position of each pin.
    Dimension(
        name="pin_tangential",
        title="tangential pin position",
        sign="each pin; counterclockwise positive",
        meaning="position error counterclockwise",
        rank=20,
        draw_columns=(8,),
        elements=PINS,
    ),
    # Radius of each pin.
    Dimension(
        name="pin_radius",
        title="pin radius",
        sign="each pin; smaller gives clearance",
        meaning="radius error, larger positive",
        rank=30,
        draw_columns=(9,),
        elements=PINS,
        measure="radius",
        size_um=lambda design: 1e3 * design.cycloid.pin_radius_mm,
        gap_sign=-1,
    ),
    # Pins of two lobes.
    roundness(2, "two-lobed", rank=32, draw_columns=(130, 131)),
    # Pins of three lobes.
    roundness(3, "three-lobed", rank=34, draw_columns=(132, 133)),
    # A pin circle of two lobes.
    ovality(2, "two-lobed", rank=90, draw_columns=(3, 5)),
    # A pin circle of three lobes.
    ovality(3, "three-lobed", rank=100, draw_columns=(4, 6)),
)
