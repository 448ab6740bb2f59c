"""The tables of the run of cases that the figures of the paper are drawn from, at its first crank angle."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.checks.paper.table2 import case_of_sample
from pipeline.config import Study
from pipeline.engine.store import Output

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
        return self.contacts.loc[self.contacts["kind"] == "pin", "contact"].to_numpy()

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
