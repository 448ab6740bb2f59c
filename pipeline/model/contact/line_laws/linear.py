"""A linear spring of a stated stiffness at every contact, for comparison with models that take one."""

import numpy as np

from pipeline.model.contact.laws import ContactLaws, LineContact
from pipeline.model.contact.line_laws.contact_law import ContactLaw


def linear_law(stiffness: float) -> ContactLaw:
    """The law of springs of one ``stiffness`` [N/mm], whatever their contact; the pressure stays that of Hertz."""

    def springs(contact: LineContact) -> ContactLaws:
        shape = contact.radius.shape
        return ContactLaws(
            linear=np.full(shape, 1 / stiffness),
            logarithmic=np.zeros(shape),
            power=np.zeros(shape),
            exponent=np.ones(shape),
            force_limit=np.full(shape, np.inf),
            pressure=contact.pressure_factor,
        )

    return ContactLaw(
        name="linear",
        title=f"linear springs of {stiffness:g} N/mm",
        source="set, not derived",
        on_mesh=lambda contact, radius, patch_half_width: springs(contact),
        on_solid=lambda contact, radius: springs(contact),
        between_flats=lambda sides, radius, depth: springs(sides[0]),
        of_stiffness=linear_law,
    )


LAW = linear_law(np.nan)
