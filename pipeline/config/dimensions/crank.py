"""Dimensions of the crank, its eccentrics and their bearings."""

from functools import partial

from pipeline.config.dimensions.dimension import CRANKS, CRANKSHAFTS, HOLES, LOOSE_SUPPORTS, Dimension

of_cranks = partial(Dimension, need=CRANKS, counted_where_varied=True)
"""A dimension of an RV reducer's second stage alone."""


def support_clearance(place: str, rank: int, draw_column: int) -> Dimension:
    """The clearance of one support bearing of each crank, "first" or "second"."""
    return Dimension(
        name=f"{place}_support_clearance",
        title=f"clearance of the cranks' {place} supports",
        sign="radial, of each crank, besides the design's",
        meaning=f"radial clearance of the crank's {place} support bearing beyond the design's",
        rank=rank,
        draw_columns=(draw_column,),
        elements=CRANKSHAFTS,
        need=LOOSE_SUPPORTS,
        one_sided=True,
        counted_where_varied=True,
        displaces=True,
    )


DIMENSIONS = (
    # Eccentricity of the crank.
    Dimension(
        name="eccentricity",
        title="eccentricity",
        sign="larger positive",
        meaning="eccentricity error, larger positive",
        rank=60,
        draw_columns=(0,),
        of_disk=True,
        size_um=lambda design: 1e3 * design.cycloid.eccentricity_mm,
    ),
    # Direction of each eccentric on the crank, as the displacement of its centre around the crank's axis.
    Dimension(
        name="eccentric_phase",
        title="phase of eccentric",
        sign="displacement of each eccentric's centre around the crank; counterclockwise positive",
        meaning="displacement of the eccentric's centre around the crank, counterclockwise positive",
        rank=65,
        draw_columns=(90,),
        of_disk=True,
        fewest_disks=2,
    ),
    # Position of each crank's axis in the carrier, as a circular zone about its true place.
    of_cranks(
        name="crank_position",
        title="position of cranks in the carrier",
        sign="displacement of each crank's axis, at most half of the zone's diameter; direction random",
        meaning="displacement of the crank's axis from its true place",
        rank=77,
        draw_columns=(140, 141),
        elements=CRANKSHAFTS,
        one_sided=True,
        direction="direction of that displacement in the carrier's frame, counterclockwise from the crank at 0",
        zone=True,
        displaces=True,
    ),
    # Eccentricity of each eccentric of each crank, besides that of its disk's eccentrics alike.
    of_cranks(
        name="crank_eccentricity",
        title="eccentricity of each eccentric",
        sign="of each crank in each disk, beside what all cranks have; larger positive",
        meaning="eccentricity error of the eccentric of one crank, larger positive",
        rank=78,
        draw_columns=(142,),
        elements=HOLES,
        of_disk=True,
        size_um=lambda design: 1e3 * design.cycloid.eccentricity_mm,
        displaces=True,
    ),
    # Direction of each eccentric of each crank, as the displacement of its centre around the crank's axis.
    of_cranks(
        name="crank_phase",
        title="phase of each eccentric",
        sign="displacement of the centre of each eccentric around its crank; counterclockwise positive",
        meaning="displacement of the centre of one crank's eccentric around the crank, counterclockwise positive",
        rank=79,
        draw_columns=(143,),
        elements=HOLES,
        of_disk=True,
        displaces=True,
    ),
    # Radial clearance of each disk's input bearing, besides the design's; of the cranks' bearings in it all alike.
    Dimension(
        name="bearing_clearance",
        title="bearing clearance",
        sign="radial, besides the design's",
        meaning="radial clearance of the input bearing beyond the design's",
        rank=80,
        draw_columns=(2,),
        of_disk=True,
        one_sided=True,
        gap_sign=1,
    ),
    # Radial clearance of each bearing of a crank in a disk, besides the design's and its disk's.
    of_cranks(
        name="crank_bearing_clearance",
        title="clearance of each crank bearing",
        sign="radial, of each crank in each disk, besides the design's",
        meaning="radial clearance of the bearing of one crank beyond the design's; acts through the hole's diameter",
        rank=81,
        draw_columns=(127,),
        elements=HOLES,
        of_disk=True,
        one_sided=True,
        acts_on="hole_diameter",
        shift=lambda clearance, direction, design: 2 * clearance,
        gap_sign=1,
    ),
    # Run-out of each planet on its crank, as the eccentricity of its pitch circle.
    of_cranks(
        name="planet_runout",
        title="run-out of planets",
        sign="eccentricity of the pitch circle about the crank's axis, half of its run-out; direction random",
        meaning="eccentricity of the planet's pitch circle about the crank's axis, half of its run-out",
        rank=82,
        draw_columns=(144, 145),
        elements=CRANKSHAFTS,
        one_sided=True,
        direction="direction of that eccentricity, counterclockwise from the crank at 0; it turns with the crank",
        displaces=True,
    ),
    # Teeth of each planet against the eccentrics of its crank, along the pitch circle.
    of_cranks(
        name="planet_timing",
        title="timing of planets",
        sign="displacement of each planet's teeth against the eccentrics; counterclockwise positive",
        meaning="displacement of the planet's teeth along its pitch circle, counterclockwise positive",
        rank=83,
        draw_columns=(146,),
        elements=CRANKSHAFTS,
        displaces=True,
    ),
    # Backlash of each planet with the sun along the pitch circle, beside the design's.
    of_cranks(
        name="planet_backlash",
        title="backlash of planets",
        sign="backlash of each planet along its pitch circle, beyond the design's; larger gives clearance",
        meaning="backlash of the planet along its pitch circle, beyond the design's",
        rank=84,
        draw_columns=(147,),
        elements=CRANKSHAFTS,
        displaces=True,
    ),
    # Run-out of the sun, as the eccentricity of its pitch circle; it turns with the input.
    of_cranks(
        name="sun_runout",
        title="run-out of sun",
        sign="eccentricity of the pitch circle about the axis, half of its run-out; direction random",
        meaning="eccentricity of the sun's pitch circle about the axis, half of its run-out",
        rank=85,
        draw_columns=(148, 149),
        one_sided=True,
        direction="direction of that eccentricity, counterclockwise from the crank at 0; it turns with the sun",
        displaces=True,
    ),
    # Radial clearance of each crank's support bearings, besides the design's.
    support_clearance("first", rank=86, draw_column=150),
    support_clearance("second", rank=87, draw_column=151),
)
