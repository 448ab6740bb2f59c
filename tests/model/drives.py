"""A drive of the small reducer for the tests: random errors, laws and compliance, and its play."""

import numpy as np
from reducers import MICROMETRE, SMALL, errors_of, laws_of, random_compliance, random_errors, reducer_at

from pipeline.model.drive import Drive, GapReading
from pipeline.model.friction import Sliders
from pipeline.model.reducer import Bearing

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
    sliders=None,
    profile=SMALL,
):
    """``n`` states of the small reducer with errors up to ``scale`` and gaps wider by ``play`` [mm]."""
    rng = np.random.default_rng(seed)
    at = reducer_at(profile, crank, floats=floats)
    errors = random_errors(profile, at, n, scale, rng) if scale else errors_of(profile, at, n)
    laws = laws_of(profile, at)
    drive = Drive(
        profile=profile,
        reducer=at,
        bearing=bearing,
        laws=laws,
        compliance=random_compliance(len(laws), rng),
        rated_torque=RATED,
        errors=errors,
        reading=GapReading("exact", "radial_on_diameter", "half_diameter"),
        shift=np.zeros((n, len(laws))),
        bearing_clearance=np.full(n, clearance),
        sliders=Sliders.none() if sliders is None else sliders,
    )
    return drive.moved(pin_radius=np.array(-play), roller_diameter=np.array(-2 * play))
