"""Factors between the model's units (N, mm, MPa, rad) and those of files and reports, once."""

import numpy as np

UM_PER_MM = 1e3
"""Micrometres in a millimetre."""
MM_PER_UM = 1e-3
"""Millimetres in a micrometre."""
NMM_PER_NM = 1e3
"""Newton millimetres in a newton metre."""
NM_PER_NMM = 1e-3
"""Newton metres in a newton millimetre."""
ARCMIN = 180 * 60 / np.pi
"""Minutes of arc in a radian."""
SECONDS_AN_HOUR = 3600.0
"""Seconds in an hour."""
TURN_DEG = 360.0
"""Degrees in a turn."""
ARCMIN_A_DEGREE = 60.0
"""Minutes of arc in a degree."""
