"""How the reducer of a design runs, as objects of the model: sliding, friction, speed and rating, as far as stated."""

import numpy as np

from pipeline.assembly import definitions, profile
from pipeline.config.designs.design import Design
from pipeline.config.designs.sections import Operation
from pipeline.config.studies.study import Study
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.metrics.turn import RunningConditions
from pipeline.model.turn import Running, sliding_speed


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
