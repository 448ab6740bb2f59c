"""What the fit of Table 2 owes to each assumption: one is changed at a time and the same numbers are fitted again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.checks.calibrate import Calibration, Parameter, Target, calibrated
from pipeline.checks.paper.table2 import Misfit
from pipeline.checks.response import Condensed, condensed, pins_in_contact, solved, with_numbers
from pipeline.config import Study
from pipeline.model.geometry.clearance import DISK_READINGS, ROLLER_READINGS

HALF_PIN_PITCH = 0.5


@dataclass(frozen=True)
class Assumption:
    """The study with one assumption changed; ``remesh`` where the condensed disk changes with it."""

    name: str
    study: Study
    remesh: bool = False


def _with(study: Study, section: str, **values: object) -> Study:
    return study.model_copy(update={section: getattr(study, section).model_copy(update=values)})


def _designed(study: Study, section: str, **values: object) -> Study:
    changed = getattr(study.design, section).model_copy(update=values)
    return study.model_copy(update={"design": study.design.model_copy(update={section: changed})})


def readings(study: Study) -> Iterator[Assumption]:
    """Every reading of the tolerances D of the disk and R of the rollers."""
    for disk in DISK_READINGS:
        for roller in ROLLER_READINGS:
            yield Assumption(f"{disk}, {roller}", _with(study, "clearance", disk_reading=disk, roller_reading=roller))


def assumptions(study: Study) -> Iterator[Assumption]:
    """The declared study, then one change at a time."""
    yield Assumption("as declared", study)
    for low in (3.0, 10.0, 25.0, 50.0):
        changed = _with(study, "metrics", rigidity_percent=(low, 100.0))
        yield Assumption(f"rigidity between {low:g} and 100 % of the rated torque", changed)
    for name, exponent in (("linear", 1.0), ("of rollers, exponent 10/9", 10 / 9)):
        yield Assumption(f"input bearing {name}", _designed(study, "bearing", exponent=exponent))
    yield Assumption("Palmgren's law in place of Hertz'", _with(study, "springs", law="palmgren"))
    yield Assumption("clearances to first order", _with(study, "clearance", method="first_order"))
    yield Assumption("sliding plate floats", _designed(study, "output", plate="floats"))
    for depth in (2.0, 10.0):
        yield Assumption(f"flats under the rollers {depth:g} mm deep", _designed(study, "output", flat_depth_mm=depth))
    for thickness in (1.0, 1.5, 3.0):
        yield Assumption(f"disk {thickness:g} mm thick", _designed(study, "disk", thickness_mm=thickness))
    yield Assumption("plane strain", _designed(study, "disk", stress="plane_strain"), remesh=True)
    small = with_numbers(study, {"disk.bore_radius_mm": 3.0, "output.face_offset_mm": 5.0})
    yield Assumption("bore 3 mm in radius, rollers 5 mm off the axis", small, remesh=True)
    turned = _designed(study, "output", slide_angle_deg=0.0)
    yield Assumption("first slide along the crank", turned, remesh=True)
    pitch = 360 / study.design.cycloid.pins
    yield Assumption(
        "crank half a pin pitch on", _with(study, "cycle", crank_deg=(HALF_PIN_PITCH * pitch,)), remesh=True
    )


def refitted(
    changes: Iterator[Assumption], disk: Condensed, targets: Sequence[Target], parameters: Sequence[Parameter]
) -> pd.DataFrame:
    """One row per assumption: errors, pins in contact at the lost-motion torque, fitted numbers, and what is met."""
    rows: list[Mapping[str, Any]] = []
    for change in changes:
        own = condensed(change.study) if change.remesh else disk
        rows.append(
            {"assumption": change.name, **_row(calibrated(change.study, targets, parameters, None, own), targets)}
        )
    return pd.DataFrame(rows)


def _row(fit: Calibration, targets: Sequence[Target]) -> dict[str, Any]:
    misfit = Misfit.of(fit.fit.residual)
    used = [target for target, one in zip(targets, fit.used, strict=True) if one]
    errors = {f"{target.metric} {target.case}": error for target, error in zip(used, fit.fit.residual, strict=True)}
    pins = pins_in_contact(fit.study, solved(fit.study, fit.disk))
    numbers = {one.key: value for one, value in zip(fit.parameters, fit.fit.value, strict=True)}
    at_bound = [
        one.key
        for one, value in zip(fit.parameters, fit.fit.value, strict=True)
        if min(np.log(value / one.lower), np.log(one.upper / value)) < 1e-3
    ]
    return {
        "largest_error": misfit.largest,
        "rms_error": misfit.rms,
        "compatible": misfit.met,
        "pins_in_contact": " ".join(str(count) for count in pins),
        **numbers,
        "at_bound": " ".join(at_bound),
        **errors,
    }
