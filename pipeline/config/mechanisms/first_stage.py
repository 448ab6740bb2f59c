"""First stage of an RV reducer: a held sun and a planet on each crank."""

from typing import Annotated

from pydantic import Field

from pipeline.config.files.section import Clearance, Section


class FirstStage(Section):
    """Sun on the input, held, and a planet on each crank.

    `backlash_um` along the pitch circle is the way of a planet from flank to flank; `mesh_stiffness_N_per_mm` is that
    of one planet's mesh along it. By the pressure angle a mesh also pushes sun and planet apart.
    """

    sun_teeth: Annotated[int, Field(ge=5, le=1000)]
    planet_teeth: Annotated[int, Field(ge=5, le=1000)]
    backlash_um: Clearance
    mesh_stiffness_N_per_mm: Annotated[float, Field(ge=1, le=1e9)]
    pressure_angle_deg: Annotated[float, Field(ge=10, le=35)] = 20.0
