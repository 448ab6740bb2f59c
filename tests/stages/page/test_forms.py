"""Other forms of the model: which there are, what rescaling keeps, the tables of the stage, and the page."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tiny_pages import ROOT, tiny_study, written

from pipeline.config import load_study
from pipeline.populations.model_forms import OF_STUDY, contact_factor, model_forms, scaled_contacts
from pipeline.report.results import Results
from pipeline.report.sections.further import FormResults

RIGIDITY = "torsional_rigidity_Nm_per_arcmin"


@pytest.fixture(scope="module")
def tables(page_outputs):
    return {name: pd.DataFrame(dict(page_outputs["forms"].read(name))) for name in ("forms", "estimates", "form_units")}


def test_the_forms_are_laws_bodies_and_both_ends_of_calibrated_numbers():
    study = load_study("paper", ROOT)
    forms = {form.name: form for form in model_forms(study)}
    keys = ("bearing.stiffness_N_per_mm_power", "output.roller_length_mm", "output.outer_station_mm")
    ends = [f"{key} {end}" for key in keys for end in ("low", "high")]
    assert list(forms) == [OF_STUDY, "law palmgren", "plane_strain", "rigid disk", *ends]
    assert forms["law palmgren"].study(study).springs.law == "palmgren"
    assert forms["plane_strain"].study(study).design.disk.stress == "plane_strain"
    assert forms["rigid disk"].study(study).reduce.disk == "rigid"
    assert forms["output.roller_length_mm low"].study(study).design.output.roller_length_mm == pytest.approx(2.1)


def test_palmgren_law_is_no_form_of_a_design_of_plastic():
    forms = {form.name: form for form in model_forms(load_study("printed_drive", ROOT))}
    assert "steel" in forms["law palmgren"].unsuitable


def test_one_factor_of_the_contacts_keeps_the_rigidity():
    """Contacts in series with another part: 1/k = c + 2 f/k_c has one solution, or none."""

    def rigidity(factor: float) -> float:
        return 1 / (0.1 + 0.2 * factor)

    assert contact_factor(rigidity, rigidity(1.7)) == pytest.approx(1.7, rel=1e-3)
    assert contact_factor(rigidity, rigidity(0.3)) == pytest.approx(0.3, rel=1e-3)
    assert np.isnan(contact_factor(rigidity, 11.0))
    study = scaled_contacts(tiny_study("tiny"), 2.0)
    assert (study.springs.pin_deflection_factor, study.springs.output_deflection_factor) == (2.0, 2.0)


def test_every_form_has_the_same_units_and_rescaled_ones_the_same_rigidity(tables):
    forms, units = tables["forms"], tables["form_units"]
    assert (forms.loc[~forms["rescaled"], "status"] == "ok").all()
    assert (units.groupby(["form", "rescaled"])["sample"].apply(list).map(len) == 12).all()
    means = units.groupby(["form", "rescaled"])[RIGIDITY].mean()
    own = means[(OF_STUDY, False)]
    as_stated, rescaled = (means.xs(flag, level="rescaled") for flag in (False, True))
    assert np.abs(as_stated["law palmgren"] / own - 1) > 0.02
    for form in ("law palmgren", "plane_strain"):  # of the worst angle; the mean over both is kept to 1e-4
        assert rescaled[form] == pytest.approx(own, rel=5e-3)


def test_the_own_form_is_that_of_the_chain(tables, frames):
    """At the loaded angles of a study without a search: the same worst values."""
    own = tables["form_units"].query("form == @OF_STUDY").set_index("sample")
    units = frames.units.set_index("sample").loc[own.index]
    for name in (RIGIDITY, "lost_motion_arcmin", "peak_pressure_MPa"):
        np.testing.assert_allclose(own[name], units[f"{name}_worst"], rtol=1e-9)


def test_differences_are_those_of_the_same_units(tables):
    units = tables["form_units"].set_index(["form", "rescaled", "sample"])["peak_pressure_MPa"]
    rows = tables["estimates"].query("metric == 'peak_pressure_MPa' and statistic == 'mean'")
    row = rows.set_index(["form", "rescaled"]).loc[("rigid disk", False)]
    difference = units[("rigid disk", False)] - units[(OF_STUDY, False)]
    assert row["difference"] == pytest.approx(difference.mean())
    assert row["difference_ci_low"] < difference.mean() < row["difference_ci_high"]
    assert row["difference_ci_high"] - row["difference_ci_low"] < row["ci_high"] - row["ci_low"]


def test_the_first_screen_has_both_intervals_and_a_table_follows(page, frames):
    first = page.partition('id="summary"')[2].partition("</section>")[0]
    results = FormResults(frames, Results(frames))
    assert f"other forms of the model</a>: {results.yield_range(is_rescaled=False).text})" in first
    table = page.partition('id="forms"')[2].partition("</section>")[0]
    assert "is that of the loaded crank angles alone" in table
    for title in ("line contact after Palmgren", "plane strain in disk and contacts", "rigid disk"):
        assert title in table


def test_without_the_setting_the_page_says_how_to_get_the_model_form(frames):
    page = written(replace(frames, tables={}))
    assert "[model_forms]" in page.partition('id="summary"')[2]
    assert 'id="forms"' not in page
