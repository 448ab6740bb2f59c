"""
My own reducer from a drawing
=============================

A design is a TOML file with the numbers of the drawing. ``python -m pipeline new design mine`` writes a
commented one; here the printed numbers of another reducer change four keys of the paper's design. Every
mistake in a file is reported at once.
"""

from small import SMALL

from pipeline import load_design, load_study, run
from pipeline.errors import InputError

design = load_design("pham2017")
print(design.title)
print(design.cycloid)

# %%
# A wrong number ends in a message with the key, the value and what is allowed.
try:
    design.with_({"cycloid.eccentricity_mm": 9.0})
except InputError as error:
    print(error)

# %%
# A valid change, and the tolerances as they are written on a drawing: ``limits_mm`` in place of micrometres.
study = load_study("quick").with_(
    SMALL
    | {
        "name": "gallery_own",
        "samples.count": 30,
        "design.cycloid.eccentricity_mm": 0.95 * design.cycloid.eccentricity_mm,
        "tolerances.eccentricity": {"distribution": "normal", "limits_mm": "+0.003/-0.003"},
    }
)
units = run(study, ["aggregate"]).units
units.filter(like="_worst").describe().round(3).T
