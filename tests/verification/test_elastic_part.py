"""What the agreement with Table 2 hides: each statement of the page derived a second time, on a coarse mesh."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares

from pipeline.checks.calibrate import target_values
from pipeline.checks.paper import assumptions, comparison, refits, table2
from pipeline.checks.paper.comparison import PaperComparison, paper_page
from pipeline.checks.paper.table2 import Tables
from pipeline.checks.response import metrics_of, solve_cases, with_numbers
from pipeline.model.load_history.load_cycle import ARCMIN

ROOT = Path(__file__).parents[2]
TRUST = (ROOT / "docs/trust.md").read_text()
VARIATIONS = pd.read_csv(ROOT / "data" / comparison.VARIATIONS)
ELASTIC = [0.153, 0.295, 0.372]
"""Lost motion less backlash [arcmin], by hand from the printed Table 2."""
MESH = 0.004
"""By which an elastic part [arcmin] may differ between the coarse mesh and the paper's."""


@pytest.fixture(scope="module")
def paper_shortfalls(study, disk, outputs, targets, parameters):
    table = table2.table2(study, outputs["aggregate"].read("metrics"), targets)
    predicted = table2.prediction(study, disk, targets, parameters)
    return refits.shortfalls(study, targets, parameters, table, predicted, Tables.read(study, outputs))


def with_metrics(study, **values):
    return study.model_copy(update={"metrics": study.metrics.model_copy(update=values)})


def complementary_energy(study, disk, percent):
    """Least complementary energy (n_cases, 2) [N mm] at +- ``percent`` of the rated torque, from the forces alone."""
    cases = solve_cases(with_metrics(study, lost_motion_percent=percent), disk)
    bearing, energy = study.design.bearing, []
    for sense in (1, -1):
        force = cases.force(sense * percent)
        thrust = np.linalg.norm(force @ cases.reducer.contact_jacobian[:, :2], axis=1)
        of_bearing = thrust * (thrust / bearing.stiffness_N_per_mm_power) ** (1 / bearing.exponent)
        energy.append(
            0.5 * np.einsum("ni,ij,nj->n", force, disk.compliance(study.design), force)
            + np.sum(cases.laws.energy(force) + force * cases.gap, axis=1)
            + of_bearing * bearing.exponent / (bearing.exponent + 1)
        )
    return np.stack(energy, axis=1)


def test_the_elastic_part_is_castiglianos(study, disk, paper_shortfalls):
    """The angle is the derivative of the complementary energy by the torque; the play is the rigid program's."""
    percent, step = study.metrics.lost_motion_percent, 1e-3
    ends = [complementary_energy(study, disk, percent * (1 + side * step)) for side in (1, -1)]
    torque = percent / 100 * 1e3 * study.design.cycloid.rated_torque_Nm
    angle = ARCMIN * np.sum(ends[0] - ends[1], axis=1) / (2 * step * torque)
    elastic = angle - metrics_of(study, solve_cases(study, disk))[:, 0]
    assert paper_shortfalls.elastic_part["published"].to_numpy() == pytest.approx(ELASTIC, abs=1e-12)
    assert paper_shortfalls.elastic_part["computed"].to_numpy() == pytest.approx(elastic, rel=1e-3)
    assert paper_shortfalls.elastic_part["relative_error"].to_numpy() == pytest.approx(elastic / ELASTIC - 1, abs=1e-3)
    assert paper_shortfalls.elastic_part["relative_error"].iloc[-1] < -0.12


def test_the_disks_share_of_the_backlash_is_the_formula_of_its_pin_circle(study):
    """g = D/2 (1 - K1 cos beta)/S at the arm e (N - 1) sin beta/S, over the pins at crank angle 0."""
    cycloid = study.design.cycloid
    ratio = cycloid.eccentricity_mm * cycloid.pins / cycloid.pin_circle_radius_mm
    beta = 2 * np.pi * np.arange(1, cycloid.pins // 2) / cycloid.pins
    per_um = 0.5e-3 * (1 - ratio * np.cos(beta)) / (cycloid.eccentricity_mm * (cycloid.pins - 1) * np.sin(beta))
    expected = ARCMIN * 2 * np.min(per_um) * np.array([0, 5, 10])
    first_order = study.model_copy(update={"clearance": study.clearance.model_copy(update={"method": "first_order"})})
    assert refits.disk_backlash(first_order) == pytest.approx(expected, rel=1e-9)
    assert refits.disk_backlash(study) == pytest.approx(expected, rel=2e-3)


def test_a_straight_line_predicts_the_last_column_as_well(study, disk, paper_shortfalls, targets, parameters):
    errors = paper_shortfalls.predictions.set_index(["predictor", "metric"])["relative_error"]
    published = np.array([target.value for target in targets]).reshape(3, 3)
    for name, tolerance in ((refits.IN_DISK, (0, 5, 10)), (refits.IN_ROLLER, (0, 3, 5))):
        line = np.array([np.polyval(np.polyfit(tolerance[:2], column[:2], 1), tolerance[2]) for column in published.T])
        assert errors[name].to_numpy() == pytest.approx(line / published[2] - 1, abs=1e-9)
    share = refits.disk_backlash(study)
    backlash = share[2] + (1.419 - share[1]) / 3 * 5
    lost_motion = backlash + 0.153 + 2 * (0.295 - 0.153)
    by_hand = np.array([backlash / 2.470, lost_motion / 2.842, (2 * 5.897 - 6.337) / 5.401])
    assert errors[refits.GEOMETRY].to_numpy() == pytest.approx(by_hand - 1, abs=1e-9)
    rebuilt = predicted_anew(study, disk, targets, parameters)
    assert errors[refits.MODEL].to_numpy() == pytest.approx(rebuilt, abs=1e-3)
    largest = paper_shortfalls.largest_errors
    assert largest[refits.GEOMETRY] < 1.1 * largest[refits.MODEL] < 0.03


def predicted_anew(study, disk, targets, parameters):
    """Relative errors of the last column, the numbers fitted by SciPy in their units over their declared values."""
    keys = [parameter.key for parameter in parameters]
    start = np.array([9.925e7, 2.289, 18.62])
    fitted_targets, predicted_targets = targets[1:6], targets[6:]

    def error(scaled, expected):
        variant = with_numbers(study, dict(zip(keys, (start * scaled).tolist(), strict=True)))
        return target_values(variant, disk, expected) / np.array([item.value for item in expected]) - 1

    fit = least_squares(error, np.ones(3), args=(fitted_targets,), x_scale=(1, 0.1, 0.1), diff_step=1e-4, xtol=1e-12)
    return error(fit.x, predicted_targets)


def test_the_choices_are_those_of_the_file(study, paper_shortfalls):
    raw = tomllib.loads((ROOT / "data/designs/pham2017_table2.toml").read_text())["provenance"]
    choices_of_file = {
        key
        for key, origin in raw.items()
        if origin["status"] == "calibrated" or re.search("with Table 2 in sight|fitted to Table 2", origin["reason"])
    }
    keys = set(paper_shortfalls.choices["key"])
    assert keys - choices_of_file == set(refits.STUDY_CHOICES)
    assert choices_of_file < keys
    assert (len(paper_shortfalls.choices), paper_shortfalls.targets) == (10, 8)
    for key in refits.STUDY_CHOICES:
        section, name = key.split(".")
        assert getattr(getattr(study, section), name)


def test_the_bearing_deflects_less_with_tolerance(study, disk, paper_shortfalls):
    """By its law from the force that balances the contacts, against the displacement of the disk's centre."""
    cases, bearing = solve_cases(study, disk), study.design.bearing
    for percent, row in zip((3, 100), paper_shortfalls.bearing.itertuples(index=False), strict=True):
        thrust = np.linalg.norm(cases.force(percent) @ cases.reducer.contact_jacobian[:, :2], axis=1)
        depth = 1e3 * (thrust / bearing.stiffness_N_per_mm_power) ** (1 / bearing.exponent)
        assert row[0] == pytest.approx(0.12 * percent)
        assert row[1:] == pytest.approx(depth, rel=1e-5)
        assert np.all(depth[1:] < depth[0])


def test_the_page_states_them(study, disk, outputs, paper_shortfalls, targets, parameters):
    empty = pd.DataFrame()
    table = table2.table2(study, outputs["aggregate"].read("metrics"), targets)
    predicted = table2.prediction(study, disk, targets, parameters)
    declared = refits.refit_table([assumptions.Assumption("as declared", study)], disk, targets, parameters)
    fit = comparison.calibrate(study, targets, parameters, None, disk)
    pair = pd.concat([table, predicted], ignore_index=True)
    page = paper_page(PaperComparison(study, pair, paper_shortfalls, empty, declared, declared, empty, fit, []))
    text = re.sub(r"\s+", " ", re.sub("<[^>]*>", " ", page))
    shown_part = paper_shortfalls.elastic_part.iloc[-1]
    assert f"is {shown_part['computed']:.3f} arcmin against the published 0.372 at the largest tolerance" in text
    assert "A straight line predicts the last column as well" in text
    assert "10 choices against 8 numbers" in text
    assert "by rising tolerance: less with the largest than with none" in text


def test_an_effect_of_the_design_is_in_the_response(study, disk):
    """Torsion adds its twist; Coulomb friction on the output shifts the torque that the reducer carries."""
    reference = metrics_of(study, solve_cases(study, disk))

    def affected(effects):
        return study.model_copy(update={"design": study.design.model_copy(update={"effects": effects})})

    twisted = affected({"output_torsion": {"compliance_arcmin_per_Nm": 0.01}})
    assert metrics_of(twisted, solve_cases(twisted, disk))[:, 1] == pytest.approx(
        reference[:, 1] + 0.01 * 2 * 0.36, rel=1e-9
    )
    rubbing = affected({"coulomb": {"torque_Nm": 0.1}})
    result = metrics_of(rubbing, solve_cases(rubbing, disk))
    shifted = [with_metrics(study, lost_motion_percent=100 * torque / 12) for torque in (0.26, 0.46)]
    mean = np.mean([metrics_of(item, solve_cases(item, disk))[:, 1] for item in shifted], axis=0)
    assert result[:, 1] == pytest.approx(mean, rel=1e-3)
    assert result[:, 0] == pytest.approx(reference[:, 0], abs=1e-12)


def test_a_backlash_read_at_the_lost_motion_torque_is_the_lost_motion(study, disk):
    values = metrics_of(study, solve_cases(study, disk, 3.0), 3.0)
    assert values[:, 0] == pytest.approx(values[:, 1], rel=1e-12)


def test_assumptions_change_what_they_say(study, disk, targets, parameters):
    changes = {assumption.name: assumption for assumption in assumptions.assumptions(study)}
    first_slide = next(assumption for name, assumption in changes.items() if "first slide alone" in name)
    backlash = metrics_of(study, solve_cases(study, disk))[:, 0]
    variant = first_slide.study
    assert metrics_of(variant, solve_cases(variant, disk))[:, 0] == pytest.approx(backlash, rel=1e-9)
    stiffer = assumptions.with_elastic_plate(study, disk, 0.5).matrix / np.where(disk.matrix == 0, np.nan, disk.matrix)
    assert np.nanmax(np.abs(stiffer[:80, :80] - 1)) == 0
    assert stiffer[80:100, 80:100] == pytest.approx(np.full((20, 20), 1.5))
    touching = replace(
        next(assumption for name, assumption in changes.items() if name.endswith("row touching")), remesh=False
    )
    for fit in refits.refit(touching, disk, targets, parameters):
        output = fit.study.design.output
        assert (output.outer_station_mm - output.inner_station_mm) / 4 == pytest.approx(3.0)
        assert loaded_stations(fit.cases) == [{0, 1, 2, 3, 4}, {0, 1}, {0}]
    assert loaded_stations(solve_cases(study, disk)) == [{0, 1, 2, 3, 4}, {0}, {0}]


def loaded_stations(cases):
    """Stations of the rollers that carry at the lost-motion torque, by case."""
    return [set(cases.reducer.contacts.station[force > 0].tolist()) - {-1} for force in cases.force(3.0)]


@pytest.mark.long
def test_the_table_of_variations_is_the_models(study, disk, targets, parameters):
    """Rows of the file in data, made on the paper's mesh, against the coarse one; and no assumption closes the gap."""
    changes = {assumption.name: assumption for assumption in assumptions.assumptions(study)}
    assert VARIATIONS.loc[VARIATIONS["fitted_to"] == refits.TABLE, "assumption"].tolist() == list(changes)
    names = ["as declared", "rollers of a row touching", "a linear compliance at the pins fitted besides"]
    repeat = refits.refit_table([changes[name] for name in names], disk, targets, parameters)
    merged = repeat.merge(VARIATIONS, on=["assumption", "fitted_to"], suffixes=("", "_stored"))
    assert len(merged) == 2 * len(names)
    columns = [refits.ELASTIC_PART + case for case in ("0", "D 5 R 3", "D 10 R 5")]
    for column in columns:
        assert merged[column].to_numpy() == pytest.approx(merged[f"{column}_stored"], abs=MESH)
    assert not VARIATIONS["closes"].any()
    errors = np.abs(VARIATIONS[columns].to_numpy() / ELASTIC - 1).max(axis=1)
    assert np.all((errors > 0.05) | (VARIATIONS["largest_error"] > 0.02))
    tolerance_range = VARIATIONS[
        (errors < 0.06) & (VARIATIONS["largest_error"] <= 0.02)
    ]  # the 6 % of docs/trust.md, at three pins
    assert tolerance_range["assumption"].tolist() == [
        name for name in changes if "3.8 mm thick" in name for _ in range(len(tolerance_range))
    ]
    assert [pins.split()[-1] for pins in tolerance_range["pins_in_contact"]] == ["3"] * len(tolerance_range)


def test_the_readme_says_what_the_table_says(paper_shortfalls):
    text = re.sub(r"\s+", " ", TRUST)
    part, error = re.search(r"elastic part.{0,99}? ([\d.]+) against 0\.372 arcmin.{0,60}?\((-\d+) %\)", text).groups()
    last_row = paper_shortfalls.elastic_part.iloc[-1]
    assert float(part) == pytest.approx(last_row["computed"], abs=1e-3)
    assert float(error) / 100 == pytest.approx(last_row["relative_error"], abs=0.006)
    nearest = float(re.search(r"touch one another come nearest \((-\d+) %\)", text)[1]) / 100
    of_table = VARIATIONS[VARIATIONS["fitted_to"] == refits.TABLE_AND_ELASTIC].set_index("assumption")
    assert nearest == pytest.approx(of_table.loc["rollers of a row touching", "elastic_error"], abs=0.006)
    assert f"{len(paper_shortfalls.choices)} choices for {paper_shortfalls.targets} numbers" in text
