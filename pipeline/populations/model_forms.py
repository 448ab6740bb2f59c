"""Other forms of the model of a study: what each changes, and how its contacts are rescaled to the same rigidity.

A form differs from the study by one choice: the law of the contacts, the plane state of stress, whether the disk is
elastic, or one calibrated number at an end of its range. Numbers of a design that are calibrated were fitted under the
study's own form; a reference that was met under one form is not met under another. So each form is also solved with the
deflections of all contacts times one factor, by which some units have the mean rigidity that they have in the study.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy  # its optimizers are slow to import: they are when they are called

from pipeline.config.changing import changed_design
from pipeline.config.designs.design import Design, plausible_range
from pipeline.config.files.section import number_at
from pipeline.config.studies.study import Study
from pipeline.model.contact.line_laws import library as law_library

OF_STUDY = "as stated"
"""Name of the study's own form."""
STEEL_MPA = 190e3, 215e3
"""Young's modulus of steels."""
LARGEST_FACTOR = 20.0
"""Factor of the contacts' deflections, or its reciprocal, up to which a form is rescaled; the largest of a study."""
FACTOR_STEP = 0.25
"""Steps of the logarithm of that factor, until the rigidity lies between two of them."""
RIGIDITY_TOLERANCE = 1e-4
"""Relative accuracy to which the rigidity is met."""


@dataclass(frozen=True)
class ModelForm:
    """One form of the model.

    Attributes
    ----------
    name, title : in tables and on pages.
    springs, reduce, design : changed values by key of those sections.
    unsuitable : why the form does not hold for the design; empty if it does.
    """

    name: str
    title: str
    springs: Mapping[str, Any] = field(default_factory=dict)
    reduce: Mapping[str, Any] = field(default_factory=dict)
    design: Mapping[str, Any] = field(default_factory=dict)
    unsuitable: str = ""

    def study(self, study: Study) -> Study:
        """A study with this form.

        Raises
        ------
        InputError
            If the design cannot take a changed number.
        """
        design = changed_design(_without_ranges(study.design), self.design) if self.design else study.design
        other_form = study.with_section("springs", **self.springs).with_section("reduce", **self.reduce)
        return other_form.model_copy(update={"design": design})


def calibrated_numbers(design: Design) -> list[str]:
    """Dotted keys of the numbers that were fitted to a reference."""
    return [key for key, origin in design.provenance.items() if origin.status == "calibrated"]


def model_forms(study: Study) -> list[ModelForm]:
    """The study's own form first, then all others."""
    return [ModelForm(OF_STUDY, "as the study states it"), *_laws(study), *_bodies(study), *_ends(study.design)]


def _laws(study: Study) -> Iterator[ModelForm]:
    """Every other law that needs no stated stiffness."""
    design = study.design
    for name, law in law_library().items():
        if name == study.springs.law or law.of_stiffness is not None:
            continue
        moduli = [material.youngs_modulus_MPa for material in design.materials.values()]
        steel = all(STEEL_MPA[0] <= modulus <= STEEL_MPA[1] for modulus in moduli)
        reason = "the law holds for steel bodies alone" if law.steel_alone and not steel else ""
        yield ModelForm(f"law {name}", law.title, springs={"law": name, "stiffness_N_per_mm": None}, unsuitable=reason)


def _bodies(study: Study) -> Iterator[ModelForm]:
    stress = "plane_strain" if study.design.disk.stress == "plane_stress" else "plane_stress"
    yield ModelForm(stress, f"{stress.replace('_', ' ')} in disk and contacts", design={"disk.stress": stress})
    disk = "rigid" if study.reduce.disk == "elastic" else "elastic"
    yield ModelForm(f"{disk} disk", f"{disk} disk", reduce={"disk": disk})


def _ends(design: Design) -> Iterator[ModelForm]:
    """Each calibrated number at both ends of its range."""
    for key in calibrated_numbers(design):
        value, limits = number_at(design, key), plausible_range(design, key)
        for end, factor in (("low", limits.low), ("high", limits.high)):
            number = float(f"{factor * value:.6g}")
            yield ModelForm(f"{key} {end}", f"{key} = {number:g}", design={key: number})


def _without_ranges(design: Design) -> Design:
    """The design without plausible ranges, inside of which a number must lie: the ends are no longer inside."""
    origins = {key: origin.model_copy(update={"plausible": None}) for key, origin in design.provenance.items()}
    return design.model_copy(update={"provenance": origins})


def scaled_contacts(study: Study, factor: float) -> Study:
    """A study with all deflections of its contacts ``factor`` times as large."""
    factors = {
        name: factor * getattr(study.springs, name) for name in ("pin_deflection_factor", "output_deflection_factor")
    }
    return study.with_section("springs", **factors)


def contact_factor(rigidity: Callable[[float], float], target: float) -> float:
    """Factor of the contacts' deflections by which a rigidity that falls with it is the ``target``.

    Parameters
    ----------
    rigidity : factor to the rigidity, in the unit of the target.

    Returns
    -------
    float
        Missing if no factor within `LARGEST_FACTOR` leads there, as where the other parts alone are softer.
    """

    def beyond(log_factor: float) -> float:
        return float(np.log(rigidity(float(np.exp(log_factor))) / target))

    last_factor, at_last = 0.0, beyond(0.0)
    if abs(at_last) <= RIGIDITY_TOLERANCE:
        return 1.0
    step = FACTOR_STEP if at_last > 0 else -FACTOR_STEP
    while abs(last_factor + step) <= np.log(LARGEST_FACTOR):
        at_next = beyond(last_factor + step)
        if not np.isfinite(at_next):
            break
        if at_next * at_last <= 0:
            low, high = sorted((last_factor, last_factor + step))
            return float(np.exp(scipy.optimize.brentq(beyond, low, high, xtol=RIGIDITY_TOLERANCE)))
        last_factor, at_last = last_factor + step, at_next
    return np.nan
