"""Make rows.csv of this folder: the stages simulate a unit with a known constant friction, and noise is added.

Run as python generated.py with the project on the path. The truth: seals and bearings rub with 0.5 N m, disk_profile is
10 um and roller_diameter -5 um (dimensions.toml), the angle has noise of 0.02 arcmin.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config import load_study
from pipeline.config.studies.study import Study
from pipeline.config.studies.tolerances import Case, Tolerances
from pipeline.engine.runner import Resources, run
from stages.chain import STAGES

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[2]
FRICTION_NM, NOISE_ARCMIN, SEED = 0.5, 0.02, 5
CRANK_DEG = (0.0, 40.0, 95.0)
LEVELS = 60


def rubbing(study: Study) -> Study:
    """The study with friction, of one unit with the example's dimensions."""
    samples = study.samples.model_copy(update={"count": 1, "experiment": "cases", "nominal_first": False})
    return study.model_copy(
        update={
            "name": "friction_example",
            "design": study.design.model_copy(update={"effects": {"coulomb": {"torque_Nm": FRICTION_NM}}}),
            "samples": samples,
            "tolerances": Tolerances(),
            "cases": (Case(label="unit", disk_profile=10.0, roller_diameter=-5.0),),
            "cycle": study.cycle.model_copy(update={"crank_deg": CRANK_DEG, "levels_per_branch": LEVELS}),
        }
    )


def main() -> None:
    """Write rows.csv beside this file: the load cycle with its first loading, and once more without."""
    with tempfile.TemporaryDirectory() as runs:
        outputs = run(STAGES, rubbing(load_study("quick", ROOT)), ["hysteresis"], Path(runs), Resources(1, 1))
        curves = pd.DataFrame(outputs["hysteresis"].read("curves"))
    curves = curves[curves["torque_Nm"] != 0]
    loop = curves[curves["branch"] != "loading+"]
    table = pd.concat([curves.assign(cycle=0), loop.assign(cycle=1)])
    table = table.sort_values(["crank_deg", "cycle", "step"], kind="stable")
    table["angle_arcmin"] += NOISE_ARCMIN * np.random.default_rng(SEED).standard_normal(len(table))
    columns = ["cycle", "crank_deg", "torque_Nm", "angle_arcmin"]
    table[columns].round({"torque_Nm": 6, "angle_arcmin": 5}).to_csv(FOLDER / "rows.csv", index=False)


if __name__ == "__main__":
    main()
