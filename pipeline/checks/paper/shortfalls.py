"""What the agreement with Table 2 hides: the elastic part, a straight line that does as well, and the choices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.checks.calibrate import FittedNumber, Target
from pipeline.checks.paper.refits import BACKLASH, LOST_MOTION, elastic_part
from pipeline.checks.paper.statements import bearing_deflections
from pipeline.checks.paper.table2 import Tables
from pipeline.config import Study
from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.rigid_play.rigid_backlash import separated_play
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.sampling.errors import draw

RIGIDITY = "torsional_rigidity_Nm_per_arcmin"
STUDY_CHOICES = ("metrics.rigidity_percent", "clearance.disk_reading", "clearance.roller_reading")
"""Settings of the study that were picked with Table 2 in sight, as its file says."""
FITTED_PART, CHOSEN_PART = "fitted", "chosen in sight"
MODEL, GEOMETRY = "the model, fitted to the columns before", "geometry, and straight lines in D"
IN_DISK, IN_ROLLER = "straight lines in D", "straight lines in R"
"""What predicts the last column from the two before it. ``GEOMETRY`` takes D's share of the backlash from the geometry,
which nothing is fitted to, R's share in proportion to R, and the elastic part and the rigidity on a line in D."""


@dataclass(frozen=True)
class Shortfalls:
    """What the page says beside the agreement.

    Attributes
    ----------
    elastic_part : per case published, computed [arcmin] and relative error.
    predictions : per predictor and metric the last column's value and relative error.
    choices : key of every number that Table 2 had a part in, and how: fitted, or chosen in its sight.
    targets : numbers of Table 2 that are not zero.
    bearing : per torque [N m] its deflection [um] in the order of the cases, smallest tolerance first.
    """

    elastic_part: pd.DataFrame
    predictions: pd.DataFrame
    choices: pd.DataFrame
    targets: int
    bearing: pd.DataFrame

    @property
    def largest_errors(self) -> pd.Series:
        """Largest relative error of each predictor, by its name."""
        return self.predictions.groupby("predictor", sort=False)["relative_error"].agg(
            lambda errors: errors.abs().max()
        )


def shortfalls(
    study: Study,
    targets: Sequence[Target],
    parameters: Sequence[FittedNumber],
    table: pd.DataFrame,
    predicted_table: pd.DataFrame,
    tables: Tables,
) -> Shortfalls:
    """From the run's Table 2, the prediction of its last column, and its tables.

    Parameters
    ----------
    table, predicted_table : as of ``table2.table2`` and ``table2.prediction``, in the order of the targets.
    """
    return Shortfalls(
        elastic_parts(targets, table["computed"].to_numpy(float)),
        predictions(study, targets, predicted_table),
        choices(study, parameters),
        sum(target.value != 0 for target in targets),
        _bearing(tables),
    )


def elastic_parts(targets: Sequence[Target], values: Real) -> pd.DataFrame:
    """Published and computed elastic part of every case [arcmin]."""
    published_parts = elastic_part(targets, np.array([target.value for target in targets]))
    rows = [(case, value, elastic_part(targets, values)[case]) for case, value in published_parts.items()]
    frame = pd.DataFrame(rows, columns=["case", "published", "computed"])
    return frame.assign(relative_error=frame["computed"] / frame["published"] - 1)


def predictions(study: Study, targets: Sequence[Target], predicted_table: pd.DataFrame) -> pd.DataFrame:
    """The last column of Table 2 by the model and by straight lines through the two columns before it."""
    columns: dict[str, dict[str, float]] = {}
    for target in targets:
        columns.setdefault(target.case, {})[target.metric] = target.value
    fitted_columns, middle, published_column = columns.values()
    sizes = {target.case: (target.tolerance_disk_um, target.tolerance_roller_um) for target in targets}
    _, of_middle, of_last = sizes.values()
    disk, roller = (end / start for start, end in zip(of_middle, of_last, strict=True))
    lines = {
        GEOMETRY: _with_geometry(study, fitted_columns, middle, disk, roller),
        IN_DISK: _line(fitted_columns, middle, disk),
        IN_ROLLER: _line(fitted_columns, middle, roller),
    }
    values = {MODEL: dict(zip(predicted_table["metric"], predicted_table["computed"], strict=True)), **lines}
    rows = [
        {"predictor": name, "metric": metric, "published": published_column[metric], "value": value[metric]}
        for name, value in values.items()
        for metric in published_column
    ]
    frame = pd.DataFrame(rows)
    return frame.assign(relative_error=frame["value"] / frame["published"] - 1)


def _line(fitted_columns: dict[str, float], middle: dict[str, float], reach: float) -> dict[str, float]:
    """The straight line from a column without tolerance through the next one, at ``reach`` times its tolerance."""
    return {
        metric: fitted_columns[metric] + reach * (middle[metric] - fitted_columns[metric]) for metric in fitted_columns
    }


def _with_geometry(
    study: Study, fitted_columns: dict[str, float], middle: dict[str, float], disk: float, roller: float
) -> dict[str, float]:
    """See ``GEOMETRY``; ``disk`` and ``roller`` are the tolerances of the last column over those of the middle one."""
    _, of_disk, of_disk_last = disk_backlash(study)
    backlash = of_disk_last + roller * (middle[BACKLASH] - of_disk)
    line = _line(fitted_columns, middle, disk)
    return {BACKLASH: backlash, LOST_MOTION: backlash + line[LOST_MOTION] - line[BACKLASH], RIGIDITY: line[RIGIDITY]}


def disk_backlash(study: Study) -> Real:
    """Backlash (n_cases,) [arcmin] of the cases with the error of the disk alone: geometry, nothing fitted."""
    reduced_study = tuple(case.model_copy(update={"roller_diameter": 0.0}) for case in study.cases)
    cases = study.model_copy(update={"cases": reduced_study})
    reducer = assembly.reducer(study.design, study.cycle.crank_deg[0])
    errors = assembly.errors(draw(cases, 0, cases.samples.rows))
    play = separated_play(reducer, gaps(assembly.profile(study.design), reducer, errors, **dict(study.clearance)))
    return ARCMIN * (play.pose_plus - play.pose_minus)[:, reducer.output_motion]


def choices(study: Study, parameters: Sequence[FittedNumber]) -> pd.DataFrame:
    """Every number of the design and setting of the study that Table 2 had a part in."""
    fitted_keys = [parameter.key for parameter in parameters]
    in_sight = [
        key
        for key, origin in study.design.provenance.items()
        if key not in fitted_keys and (origin.status == "calibrated" or origin.in_sight_of)
    ]
    keys = [*fitted_keys, *in_sight, *STUDY_CHOICES]
    return pd.DataFrame({"key": keys, "part": [FITTED_PART if key in fitted_keys else CHOSEN_PART for key in keys]})


def _bearing(tables: Tables) -> pd.DataFrame:
    rated_torque = tables.study.design.cycloid.rated_torque_Nm
    labels = [case.label for case in tables.study.cases]
    rows = [
        {"torque_Nm": torque, **dict(zip(labels, bearing_deflections(tables, torque), strict=True))}
        for torque in (tables.lost_motion_torque, rated_torque)
    ]
    return pd.DataFrame(rows)
