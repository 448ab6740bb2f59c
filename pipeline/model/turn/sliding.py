"""Sliding at the contacts of a running reducer, by the kinematics of rigid nominal bodies."""

import numpy as np

from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.cycloid_profile import CycloidProfile, Real
from pipeline.model.geometry.reducer import Reducer


def sliding_speed(profile: CycloidProfile, reducer: Reducer, crank_speed: float) -> Real:
    """Speed (n_contacts,) [mm/s] at which the surfaces of the contacts pass each other; 0 of rollers and of teeth.

    Parameters
    ----------
    crank_speed : of the crank, housing held [rad/s].

    Notes
    -----
    The disk turns about the pitch point, at the crank's speed over the ratio: at a pin it slides by that times the
    distance of the contact from the pitch point, R S - r. Disk and output turn alike, so a hole passes its output pin
    as the disk's centre moves for the output, e N/(N - 1) times the crank's speed, along the wall. Where a cylinder
    rolls on the disk instead, it slides at the same speed in its seat.

    Source
    ------
    Instantaneous centres: Litvin and Fuentes, Gear Geometry and Applied Theory (2004), ch. 3 and 13.
    """
    contacts = reducer.contacts
    bodies = [disk.body for disk in reducer.disks]
    of_disk = np.array([bodies.index(body) if body in bodies else 0 for body in contacts.body_b])
    pitch_point = profile.pins * np.array([disk.eccentric for disk in reducer.disks])[of_disk]
    at_pins = np.abs(contacts.point - pitch_point) / profile.lobes
    slides = (contacts.hole >= 0) & reducer.is_centred  # else they are rollers of the bearings that carry the disk
    in_holes = np.where(slides, profile.eccentricity * profile.pins / profile.lobes, 0.0)
    return abs(crank_speed) * np.where(contacts.kind == PIN, at_pins, in_holes)
