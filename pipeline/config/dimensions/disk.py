"""Dimensions of the disks: flank, bore and holes; growth of the parts by temperatures that a study draws."""

from pipeline.config.dimensions.dimension import HOLES, HOLES_IN_DISK, LOBES, PINS_IN_HOLES, Dimension, Need


def growth(part: str, length: str, rank: int, draw_column: int) -> Dimension:
    """The growth of a part by its temperature, which differs from unit to unit, told of its characteristic length."""
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


GROWTH = (
    growth("disk", "the disk at the pin circle's radius", rank=110, draw_column=160),
    growth("pins", "the pins' radius", rank=120, draw_column=161),
    growth("housing", "the pin circle's radius", rank=130, draw_column=162),
    growth("crank", "the eccentricity", rank=140, draw_column=163),
)
"""Dimensions by drawn temperatures."""


DIMENSIONS = (
    *GROWTH,
    # Size of the disk: material off its whole flank.
    Dimension(
        name="disk_profile",
        title="disk profile (whole disk)",
        sign="material off the whole flank; positive gives clearance",
        meaning="material off the whole flank, as the study reads it",
        rank=40,
        draw_columns=(1,),
        of_disk=True,
        gap_sign=1,
        drawing_sign=-1,
    ),
    # Profile of each lobe, besides the disk's.
    Dimension(
        name="lobe_profile",
        title="lobe profile (each lobe)",
        sign="material off each lobe besides, read as disk_profile is; positive gives clearance",
        meaning="material off this lobe's flank besides disk_profile_um",
        rank=50,
        draw_columns=(10,),
        of_disk=True,
        elements=LOBES,
        gap_sign=1,
        drawing_sign=-1,
    ),
    # Pitch error of each lobe: how far it was indexed around the disk from its nominal direction.
    Dimension(
        name="lobe_pitch",
        title="lobe pitch (each lobe)",
        sign="each lobe around the disk's axis, along the circle at half of the lobes' height; counterclockwise "
        "positive",
        meaning="way of this lobe around the disk's axis at half of the lobes' height, counterclockwise positive",
        rank=55,
        draw_columns=(100,),
        of_disk=True,
        elements=LOBES,
        counted_where_varied=True,
    ),
    # Run-out of each disk's bore against its flank, as the eccentricity of the flank's centre; it turns with the disk.
    # No crank runs in the bore of an RV reducer's disk: there it is the run-out of the flank against the holes.
    Dimension(
        name="bore_runout",
        title="run-out of bore against flank",
        sign="way of the flank's centre from the bore's, of an RV from that of the crank holes, half of an indicator's "
        "reading; direction random",
        meaning="way of the flank's centre from the bore's, half of an indicator's reading",
        rank=66,
        draw_columns=(110, 111),
        of_disk=True,
        one_sided=True,
        direction="direction of the flank's centre from the bore's in the disk's frame",
        counted_where_varied=True,
    ),
    # Position of each of a disk's holes against its bore, as a circular zone about its true place.
    Dimension(
        name="hole_position",
        title="position of holes in the disk",
        sign="offset of each hole axis from its true position, at most half of the zone's diameter; direction random",
        meaning="offset of the hole's axis from its true position",
        rank=73,
        draw_columns=(122, 123),
        elements=HOLES,
        of_disk=True,
        need=HOLES_IN_DISK,
        one_sided=True,
        direction="direction of that offset in the disk's frame, counterclockwise from the crank at 0",
        zone=True,
        counted_where_varied=True,
    ),
    # Diameter of each of a disk's holes, in which an output pin or its bush lies.
    Dimension(
        name="hole_diameter",
        title="hole diameter",
        sign="each hole of the disk; larger gives clearance",
        meaning="diameter error, larger positive",
        rank=74,
        draw_columns=(124,),
        elements=HOLES,
        of_disk=True,
        need=PINS_IN_HOLES,
        measure="diameter",
        size_um=lambda design: 2e3 * design.output.hole_radius(design.cycloid.eccentricity_mm),
        counted_where_varied=True,
        gap_sign=1,
    ),
)
