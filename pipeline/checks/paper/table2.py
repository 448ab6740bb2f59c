"""Table 2 of the paper beside the run's metrics, the prediction of its third column, and the tables of its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.checks.calibrate import Calibration, FittedNumber, Target, calibrate, target_values
from pipeline.checks.response import Condensed
from pipeline.config import Study
from pipeline.engine.store import Output
from pipeline.engine.table import Columns

LARGEST_ERROR, RMS_ERROR = 0.02, 0.01
"""What a fit has to meet: the largest relative error of Table 2's numbers other than zero, and their rms."""
NONE = 1e-6
"""A computed backlash [arcmin] up to this is the published zero."""


@dataclass(frozen=True)
class Misfit:
    """Relative errors of the numbers of Table 2 that are not zero."""

    largest_error: float
    rms: float

    @classmethod
    def from_errors(cls, errors: np.ndarray) -> "Misfit":
        """Of errors (n,); NaN stands for a published zero and is left out."""
        nonzero = errors[np.isfinite(errors)]
        return cls(float(np.max(np.abs(nonzero))), float(np.sqrt(np.mean(nonzero**2))))

    @property
    def met(self) -> bool:
        """Whether the limits are kept."""
        return self.largest_error <= LARGEST_ERROR and self.rms <= RMS_ERROR


def case_of_sample(study: Study) -> dict[str, int]:
    """Sample of each case's label."""
    return {case.label: number + study.samples.nominal_first for number, case in enumerate(study.cases)}


def table2(study: Study, metrics: Columns, targets: Sequence[Target]) -> pd.DataFrame:
    """Each published number with the run's, from ``aggregate/metrics`` at the study's first crank angle."""
    frame = pd.DataFrame(metrics)
    frame = frame[frame["crank_deg"] == study.cycle.crank_deg[0]].set_index("sample")
    samples = case_of_sample(study)
    values = [float(frame.loc[samples[target.case], target.metric]) for target in targets]
    return _rows(targets, values, are_predicted=False)


def prediction(
    study: Study, disk: Condensed, targets: Sequence[Target], parameters: Sequence[FittedNumber]
) -> pd.DataFrame:
    """The last case of the targets computed with the numbers fitted to the other cases alone."""
    held_out = targets[-1].case
    training = [target for target in targets if target.case != held_out]
    predicted_targets = [target for target in targets if target.case == held_out]
    fit = calibrate(study, training, parameters, None, disk)
    return _rows(predicted_targets, list(target_values(fit.study, disk, predicted_targets)), are_predicted=True)


def _rows(targets: Sequence[Target], values: Sequence[float], are_predicted: bool) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "tolerance_disk_um": [target.tolerance_disk_um for target in targets],
            "tolerance_roller_um": [target.tolerance_roller_um for target in targets],
            "metric": [target.metric for target in targets],
            "published": [target.value for target in targets],
            "computed": values,
            "relative_error": [
                value / target.value - 1 if target.value else np.nan
                for target, value in zip(targets, values, strict=True)
            ],
            "predicted": are_predicted,
        }
    )


def contacts(study: Study, curves: Columns, published_folder: Path) -> pd.DataFrame:
    """Pins in contact, published and from ``hysteresis/curves`` on the branch loading+."""
    steps, samples = pd.DataFrame(curves), case_of_sample(study)
    loading = steps[(steps["branch"] == "loading+") & (steps["crank_deg"] == study.cycle.crank_deg[0])]
    table = pd.read_csv(published_folder, dtype={"case": str})
    counts = []
    for row in table.itertuples():
        of_case = loading[loading["sample"] == samples[row.case]]
        counts.append(int(of_case.loc[np.isclose(of_case["torque_Nm"], row.torque_Nm), "pins_in_contact"].iloc[0]))
    table.insert(3, "computed", counts)
    return table.rename(columns={"pins_in_contact": "published"})


def fit_rows(calibration: Calibration) -> list[Mapping[str, object]]:
    """Key, value and interval of every fitted number."""
    fit = calibration.fit
    return [
        {"key": parameter.key, "value": value, "low": low, "high": high}
        for parameter, value, low, high in zip(calibration.parameters, fit.value, fit.low, fit.high, strict=True)
    ]


LOADING = "loading+"


@dataclass(frozen=True)
class Tables:
    """Rows of the run at the first crank angle; one case is called by its label.

    Attributes
    ----------
    gaps, curves, loads : ``clearance/gaps``, ``hysteresis/curves`` and ``hysteresis/contacts``.
    contacts, laws : ``clearance/contacts`` and ``springs/laws``.
    """

    study: Study
    gaps: pd.DataFrame
    curves: pd.DataFrame
    loads: pd.DataFrame
    contacts: pd.DataFrame
    laws: pd.DataFrame

    @classmethod
    def read(cls, study: Study, outputs: Mapping[str, Output]) -> "Tables":
        """The tables of a finished run."""

        def rows(stage: str, table: str) -> pd.DataFrame:
            frame = pd.DataFrame(outputs[stage].read(table))
            return frame[frame["crank_deg"] == study.cycle.crank_deg[0]]

        return cls(
            study,
            rows("clearance", "gaps"),
            rows("hysteresis", "curves"),
            rows("hysteresis", "contacts"),
            rows("clearance", "contacts"),
            rows("springs", "laws"),
        )

    @property
    def lost_motion_torque(self) -> float:
        """[N m]"""
        return self.study.design.cycloid.rated_torque_Nm * self.study.metrics.lost_motion_percent / 100

    @property
    def pins(self) -> np.ndarray:
        """Numbers of the pins' contacts."""
        return np.asarray(self.contacts.loc[self.contacts["kind"] == "pin", "contact"].to_numpy())

    @property
    def with_tolerance(self) -> list[str]:
        """Labels of the cases after the first, which has no tolerance, by rising tolerance."""
        return [case.label for case in self.study.cases[1:]]

    def of_case(self, frame: pd.DataFrame, case: str) -> pd.DataFrame:
        """Rows of one case."""
        return frame[frame["sample"] == case_of_sample(self.study)[case]]

    def loading(self, case: str) -> pd.DataFrame:
        """Curve of one case on its first loading."""
        rows = self.of_case(self.curves, case)
        return rows[rows["branch"] == LOADING]

    def contacts_at(self, case: str, torque: float) -> pd.DataFrame:
        """Contacts of one case at the torque [N m] of its first loading that is nearest."""
        curve = self.loading(case)
        step = int(curve["step"].iloc[int(np.argmin(np.abs(curve["torque_Nm"].to_numpy() - torque)))])
        rows = self.of_case(self.loads, case)
        return rows[rows["step"] == step]

    def loaded_pins(self, case: str, torque: float) -> pd.DataFrame:
        """As `contacts_at`, the pins alone."""
        rows = self.contacts_at(case, torque)
        return rows[np.isin(rows["contact"], self.pins)]

    def clearances(self, case: str) -> pd.DataFrame:
        """Gaps of the pins of one case."""
        rows = self.of_case(self.gaps, case)
        return rows[np.isin(rows["contact"], self.pins)]
