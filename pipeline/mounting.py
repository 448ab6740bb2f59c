"""Drives of a design: its reducer with errors, springs and named effects, and how its contacts run."""

from collections.abc import Mapping

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.assembly import definitions, profile
from pipeline.config.designs.design import Design
from pipeline.config.designs.sections import Operation
from pipeline.config.studies.study import Study
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.effects import Conditions, library
from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.elements import ElasticModulus
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.reducer import Reducer, of_each_disk
from pipeline.model.load_history.drive import Drive, GapReading
from pipeline.model.metrics.turn import RunningConditions
from pipeline.model.turn import Running, sliding_speed
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
        output = slice(reducer.n_pins, None)
        bearing_rows = reducer.n_pins + study.design.output.bearing_rows(reducer.contacts.some(output))
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
        rated_torque=NMM_PER_NM * study.design.cycloid.rated_torque_Nm,
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


def running(design: Design, reducer: Reducer) -> Running:
    """How the contacts run: their lengths, seats, sliding and friction, as far as the design states them."""
    operation, thickness, n_contacts = design.operation, design.disk.thickness_mm, len(reducer.contacts)
    of_pins, in_holes = reducer.contacts.kind == PIN, (reducer.contacts.hole >= 0) & reducer.is_centred
    length = np.where(of_pins, thickness, design.output.contact_length_mm(thickness))
    unknown = np.full(n_contacts, np.nan)
    if operation is None:
        return Running(length, np.zeros(n_contacts), unknown, unknown)
    output_rolls = operation.output_pins == "rolling" or design.output.has_bushes
    rolls = (of_pins & (operation.pins == "rolling")) | (in_holes & output_rolls)
    output_seat = design.output.seat_radius_mm
    diameter = 2 * np.where(of_pins, design.cycloid.pin_radius_mm, output_seat)
    friction = unknown
    if operation.friction:
        output = np.where(in_holes, operation.friction.output_coefficient or 0.0, 0.0)
        friction = np.where(of_pins, operation.friction.pin_coefficient, output)
    speed = sliding_speed(profile(design), reducer, 2 * np.pi * _crank_speed_rpm(design, operation) / 60)
    speed *= np.where(in_holes & output_rolls, output_seat / design.output.contact_radius_mm, 1.0)
    return Running(length, np.where(rolls, diameter * length, 0.0), speed, friction)


def _crank_speed_rpm(design: Design, operation: Operation) -> float:
    """Of the cranks against the housing."""
    return operation.input_speed_rpm * design.output.crank_turns(design.cycloid)


def conditions(study: Study) -> RunningConditions:
    """How the reducer runs at the torque held, as far as the design states it."""
    design, operation = study.design, study.design.operation
    if operation is None:
        return RunningConditions()
    cycloid = design.cycloid
    crank_speed = _crank_speed_rpm(design, operation)
    output_speed = 2 * np.pi * crank_speed / 60 / cycloid.lobes
    friction, rating = operation.friction, operation.rating
    return RunningConditions(
        bearing_speed_rpm=crank_speed * cycloid.pins / cycloid.lobes,
        output_power_W=definitions(study).rigidity_high * output_speed,
        bearing_friction_mm=0.5 * friction.bearing_coefficient * friction.bearing_bore_mm if friction else np.nan,
        load_rating_N=rating.dynamic_load_N if rating else np.nan,
        life_exponent=rating.exponent if rating else np.nan,
    )
