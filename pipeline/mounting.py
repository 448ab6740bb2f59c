"""Drives of a design: its reducer with errors, springs, and the effects that the design file names."""

from collections.abc import Mapping

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config.studies.study import Study
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.effects import Conditions, library
from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.elements import ElasticModulus
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.reducer import Reducer, of_each_disk
from pipeline.model.load_history.drive import Drive, GapReading
from pipeline.model.units import ARCMIN, NMM_PER_NM


def drive_of(
    study: Study,
    crank_deg: float,
    compliance: Real | None,
    errors: Errors,
    clearance: Real,
    laws: ContactLaws | None = None,
    modulus: Real | None = None,
    reducer: Reducer | None = None,
) -> Drive:
    """Drive of a study's design at one crank angle, with the design's effects: the one place where a drive is made.

    Parameters
    ----------
    compliance : of the disks between the contacts (n_contacts, n_contacts) [mm/N], to which that of the bodies beside
        them is added; None where all bodies are rigid.
    errors : of ``n`` states.
    clearance : (n,) or (n, n_disks) of each disk's input bearing [mm]; where an output mechanism carries the disks, of
        all bearings of the cranks in a disk.
    laws : of the contacts; the study's where none are given.
    modulus : (n,) factor of the modulus of all elastic parts, or None for 1.
    reducer : of a design whose contacts stand alike; the study's where none is given.
    """
    reducer = assembly.reducer(study.design, crank_deg) if reducer is None else reducer
    contacts = len(reducer.contacts)
    shift = np.zeros((len(clearance), contacts))
    if not reducer.is_centred:
        output = np.flatnonzero(reducer.contacts.kind == OUTPUT)
        bearing_rows = output[study.design.output.bearing_rows(reducer.contacts.some(output))]
        shift[:, bearing_rows] = of_each_disk(clearance, reducer.n_disks)[:, reducer.disk_of_contact[bearing_rows]]
        clearance = np.full(len(clearance), study.design.cycloid.eccentricity_mm)  # no bearing is met within it
    of_modulus = () if modulus is None else (ElasticModulus(modulus),)
    in_series = (
        LinearSpring(1 / (NMM_PER_NM * ARCMIN * part.stiffness_Nm_per_arcmin)) for part in study.design.series.values()
    )
    drive = Drive(
        profile=assembly.profile(study.design),
        reducer=reducer,
        bearing=assembly.bearing(study.design),
        laws=assembly.contact_laws(study, reducer) if laws is None else laws,
        compliance=np.zeros((contacts, contacts))
        if compliance is None
        else compliance + assembly.compliance_beside_disks(study.design, reducer),
        rated_torque=assembly.NMM_PER_NM * study.design.cycloid.rated_torque_Nm,
        errors=errors,
        reading=GapReading(**dict(study.clearance)),
        shift=shift,
        bearing_clearance=clearance,
        elements=(*of_modulus, *in_series),
    )
    return with_effects(drive, study.design.effects, study.design.temperature_rise_K or 0.0)


def with_effects(drive: Drive, effects: Mapping[str, Mapping[str, float]], temperature_rise: float = 0.0) -> Drive:
    """The drive with effects of the library at their parameters, run in, at a temperature over the drawing's [K]."""
    conditions = Conditions.run_in(len(drive.bearing_clearance), temperature_rise)
    for name, values in effects.items():
        effect = library()[name]
        drive = effect.apply(drive, [values[parameter.name] for parameter in effect.parameters], conditions)
    return drive
