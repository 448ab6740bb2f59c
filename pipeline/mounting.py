"""Drives of a design: its reducer with errors, springs, and the effects that the design file names."""

from collections.abc import Mapping

import numpy as np

from pipeline import assembly
from pipeline.config.study import Study
from pipeline.model.effects import Conditions, library
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.load_history.drive import Drive, GapReading


def drive_of(study: Study, crank_deg: float, compliance: Real, errors: Errors, loose: Real) -> Drive:
    """Drive of a study's design at one crank angle, with the design's effects.

    Parameters
    ----------
    compliance : (n_contacts, n_contacts) [mm/N]
    errors : of ``n`` states.
    loose : (n,) clearance of its bearing [mm].
    """
    at = assembly.reducer(study.design, crank_deg)
    drive = Drive(
        profile=assembly.profile(study.design),
        reducer=at,
        bearing=assembly.bearing(study.design),
        laws=assembly.contact_laws(study, at),
        compliance=compliance,
        rated_torque=assembly.NMM_PER_NM * study.design.cycloid.rated_torque_Nm,
        errors=errors,
        reading=GapReading(**dict(study.clearance)),
        shift=np.zeros((len(loose), len(at.contacts))),
        bearing_clearance=loose,
    )
    return with_effects(drive, study.design.effects)


def with_effects(drive: Drive, effects: Mapping[str, Mapping[str, float]]) -> Drive:
    """The drive with effects of the library at their parameters, run in and at the temperature of the drawing."""
    usual = Conditions.usual(len(drive.bearing_clearance))
    for name, values in effects.items():
        effect = library()[name]
        drive = effect.apply(drive, [values[parameter.name] for parameter in effect.parameters], usual)
    return drive
