"""A drive of the small reducer for the tests: random errors, laws and compliance, its play, and load histories."""

import numpy as np
from reducers import MICROMETRE, SMALL, errors_of, laws_of, random_compliance, random_errors, reducer_at

from pipeline.model.geometry.reducer import Bearing
from pipeline.model.load_history.drive import Drive, GapReading

RATED = 12000.0  # [N mm]
LINEAR = Bearing(2e5, 1.0)


def small_drive(
    n=1,
    *,
    crank=0.4,
    scale=2 * MICROMETRE,
    play=4 * MICROMETRE,
    bearing=LINEAR,
    clearance=0.0,
    floats=False,
    seed=0,
    elements=(),
    profile=SMALL,
):
    """``n`` states of the small reducer with errors up to ``scale`` and gaps wider by ``play`` [mm]."""
    rng = np.random.default_rng(seed)
    reducer = reducer_at(profile, crank, floats=floats)
    errors = random_errors(profile, reducer, n, scale, rng) if scale else errors_of(profile, reducer, n)
    laws = laws_of(profile, reducer)
    drive = Drive(
        profile=profile,
        reducer=reducer,
        bearing=bearing,
        laws=laws,
        compliance=random_compliance(len(laws), rng),
        rated_torque=RATED,
        errors=errors,
        reading=GapReading("exact", "radial_on_diameter", "half_diameter"),
        shift=np.zeros((n, len(laws))),
        bearing_clearance=np.full(n, clearance),
        elements=elements,
    )
    return drive.with_added_errors(pin_radius=np.array(-play), roller_diameter=np.array(-2 * play))


def drive_with(profile, reducer, bearing, laws, compliance, gap, clearance):
    """States of a reducer with gaps (n, n_contacts) and clearances (n,) [mm] as they are, of no stated errors."""
    return Drive(
        profile=profile,
        reducer=reducer,
        bearing=bearing,
        laws=laws,
        compliance=compliance,
        rated_torque=RATED,
        errors=errors_of(profile, reducer, len(gap)),
        reading=GapReading("exact", "radial", "half_diameter"),
        shift=np.zeros(gap.shape),
        bearing_clearance=clearance,
        known_gap=gap,
    )


def history(*turns, steps=60):
    """Torques from turn to turn, every turn once."""
    legs = [np.linspace(a, b, steps + 1)[1:] for a, b in zip(turns[:-1], turns[1:], strict=True)]
    return np.concatenate([[turns[0]], *legs])


def area(torques, angle):
    """Work of the torques along a path of the angle [N mm]."""
    return float(np.sum(0.5 * (torques[1:] + torques[:-1]) * np.diff(angle)))
