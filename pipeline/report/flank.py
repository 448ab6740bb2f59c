"""The drawn flank in the report: its words, and the gap that it leaves to nominal pins."""

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config.designs.design import Design
from pipeline.model.geometry.clearance import Errors, exact_gaps, first_order_gaps
from pipeline.model.units import UM_PER_MM
from pipeline.report.layout.wording import listed_text, plain_number

CRANKS_PER_PITCH = 16
"""Crank angles within a pitch of the pins: between them their phases fill the lobe."""


def nominal_gaps(design: Design, crank_deg: float) -> pd.DataFrame:
    """Gaps of nominal pins at one crank angle by phase: phase_deg, exact_um, first_order_um."""
    reducer, profile = assembly.reducer(design, crank_deg), assembly.profile(design)
    nominal = Errors.zero(profile.pins, profile.lobes, len(reducer.contacts) - reducer.n_pins)
    gaps = {
        name: UM_PER_MM * method(profile, reducer, nominal, "radial")[0]
        for name, method in (("exact_um", exact_gaps), ("first_order_um", first_order_gaps))
    }
    return pd.DataFrame({"phase_deg": np.degrees(reducer.pins.phase), **gaps})


def nominal_gap_curve(design: Design) -> pd.DataFrame:
    """Gaps of nominal pins over the phase, ascending; columns as of ``nominal_gaps``."""
    cranks = 360 / design.cycloid.pins * np.arange(CRANKS_PER_PITCH) / CRANKS_PER_PITCH
    rows = pd.concat([nominal_gaps(design, float(crank)) for crank in cranks])
    return rows.sort_values("phase_deg", ignore_index=True)


def flank_fact(design: Design) -> str:
    """How the drawing modifies the flank; empty without a modification."""
    flank = design.flank
    if flank is None:
        return ""
    parts = {
        "equidistant {} µm": flank.equidistant_um,
        "moved distance {} µm": flank.moved_distance_um,
        "rotation {}′": flank.rotation_arcmin,
    }
    modifications = [text.format(plain_number(value)) for text, value in parts.items() if value]
    if flank.measured is not None:
        lobes = "each lobe" if len(flank.measured.deviation_um) > 1 else "one for all lobes"
        modifications.append(f"and a measured deviation at {flank.measured.points} points, {lobes}")
    return listed_text(modifications) if modifications else "as the pins generate it"
