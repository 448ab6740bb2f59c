"""Temperatures of the parts of a reducer: the optional section `[temperature]` of a study, resolved as it is read.

A study at a temperature is one of another design and other allowances. All lengths of the design grow as the disk does;
what the pins' circle, the pins and the eccentric grow more than it goes into the allowances of their errors, and every
tolerance grows with its part. So a uniform temperature of one material leaves a similar reducer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from pipeline.config.designs.design import Design, MaterialSection
from pipeline.config.files.section import Mistake, Section, nearest_name
from pipeline.model.units import UM_PER_MM

Celsius = Annotated[float, Field(ge=-60, le=250)]
LENGTHS = ("_mm", "_um")
"""Endings of the names of lengths."""
GROWING = ("cycloid", "housing", "disk", "bearing", "flank", "output")
"""Sections of a design whose lengths grow with the disk."""
PART_OF = {
    "pin_radial": "housing",
    "pin_tangential": "housing",
    "ovality_2": "housing",
    "ovality_3": "housing",
    "pin_radius": "pins",
    "pin_roundness_2": "pins",
    "pin_roundness_3": "pins",
    "eccentricity": "crank",
}
"""Part with which a toleranced dimension grows; all others grow with the disk."""


class Temperature(Section):
    """Uniform temperatures of the parts [deg C]; the drawing holds at `reference_C`.

    The output has the temperature of the disk. The materials of housing and crank count for their expansion alone.
    """

    reference_C: Celsius = 20.0
    disk_C: Celsius
    pins_C: Celsius
    housing_C: Celsius
    crank_C: Celsius
    housing_material: str
    crank_material: str


@dataclass(frozen=True)
class Warm:
    """Factors by which the parts have grown, and the temperatures of the materials.

    Attributes
    ----------
    growth : of `disk`, `pins`, `housing` and `crank`.
    """

    temperature: Temperature
    growth: Mapping[str, float]


def temperature_problems(temperature: Temperature, design: Design) -> list[Mistake]:
    """Materials that are not there, do not say how they grow, or have lost their stiffness."""
    problems = []
    for part, name in materials_of_parts(temperature, design).items():
        key = f"temperature.{part}_material"
        if name not in design.materials:
            requirement = f"no such material in the design; {nearest_name(name, design.materials)}"
            problems.append(Mistake(key, name, requirement))
        elif design.materials[name].expansion_per_K is None:
            requirement = f"the design's materials.{name} must have expansion_per_K, as 1.2e-5 of steel"
            problems.append(
                Mistake(key if hasattr(temperature, f"{part}_material") else f"temperature.{part}_C", name, requirement)
            )
    for part in ("disk", "pins"):
        material = design.materials[materials_of_parts(temperature, design)[part]]
        if _softening(material, temperature_rise(temperature, part)) <= 0:
            requirement = "leaves the material no modulus by its modulus_slope_per_K; take a lower temperature"
            problems.append(Mistake(f"temperature.{part}_C", getattr(temperature, f"{part}_C"), requirement))
    return problems


def materials_of_parts(temperature: Temperature, design: Design) -> dict[str, str]:
    """Material of each part."""
    return {
        "disk": design.disk.material,
        "pins": design.pins.material,
        "housing": temperature.housing_material,
        "crank": temperature.crank_material,
    }


def temperature_rise(temperature: Temperature, part: str) -> float:
    """Temperature of a part less that of the drawing [K]."""
    return float(getattr(temperature, f"{part}_C")) - temperature.reference_C


def _softening(material: MaterialSection, rise: float) -> float:
    return 1 + (material.modulus_slope_per_K or 0.0) * rise


def thermal_growth(temperature: Temperature, design: Design) -> Warm:
    """How the parts of a design have grown."""
    growth = {}
    for part, name in materials_of_parts(temperature, design).items():
        growth[part] = 1 + (design.materials[name].expansion_per_K or 0.0) * temperature_rise(temperature, part)
    return Warm(temperature, growth)


def warm_design(warm: Warm, design: Design) -> Design:
    """The design with the disk's growth in all of its lengths, and each part's modulus at its temperature."""
    raw = design.model_dump()
    for section in GROWING:
        raw[section] = _scale_lengths(raw[section], warm.growth["disk"])
    warm_materials = {}
    for part, section in (("disk", "disk"), ("pins", "pins"), ("disk", "output")):
        rise = temperature_rise(warm.temperature, part)
        for key, value in list(raw[section].items()):
            if key.endswith("material") and value in design.materials:
                material = design.materials[value]
                name = f"{value} at {rise + warm.temperature.reference_C:g} deg C"
                modulus = material.youngs_modulus_MPa * _softening(material, rise)
                warm_materials[name] = {**material.model_dump(), "youngs_modulus_MPa": modulus}
                raw[section][key] = name
    raw["materials"] = {**raw["materials"], **warm_materials}
    return Design.model_validate(raw)


def _scale_lengths(value: Any, factor: float, length: bool = False) -> Any:
    """Lengths of nested settings times a factor."""
    if isinstance(value, Mapping):
        return {key: _scale_lengths(item, factor, str(key).endswith(LENGTHS)) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return tuple(_scale_lengths(item, factor, length) for item in value)
    return value * factor if length and isinstance(value, int | float) else value


def shifts_um(warm: Warm, design: Design) -> dict[str, float]:
    """What pin circle, pins and eccentricity of the drawing have grown more than the disk [um]."""
    cycloid, growth = design.cycloid, warm.growth
    sizes = {
        "pin_radial": cycloid.pin_circle_radius_mm,
        "pin_radius": cycloid.pin_radius_mm,
        "eccentricity": cycloid.eccentricity_mm,
    }
    return {name: UM_PER_MM * size * (growth[PART_OF[name]] - growth["disk"]) for name, size in sizes.items()}


def warm_tolerances(warm: Warm, tolerances: Mapping[str, Any], design: Design) -> dict[str, Any]:
    """The tolerances of a study, each grown with its part, with the shifts in their allowances."""
    shifts = shifts_um(warm, design)
    tolerance_sections = {}
    for name, settings in tolerances.items():
        warm_settings = _scale_lengths(settings, _growth_of(warm, name))
        if isinstance(warm_settings, Mapping) and shifts.get(name):
            warm_settings = {
                **warm_settings,
                "allowance_um": _shift_value(warm_settings.get("allowance_um", 0.0), shifts[name]),
            }
        tolerance_sections[name] = warm_settings
    for name, shift in shifts.items():
        if name not in tolerance_sections and shift:
            tolerance_sections[name] = {"distribution": "fixed", "value_um": 0.0, "allowance_um": shift}
    return tolerance_sections


def warm_case(warm: Warm, case: Mapping[str, Any], design: Design) -> dict[str, Any]:
    """A stated unit, each deviation grown with its part and shifted."""
    deviations = {name: _scale_lengths(value, _growth_of(warm, name), name != "label") for name, value in case.items()}
    for name, shift in shifts_um(warm, design).items():
        deviations[name] = _shift_value(deviations.get(name, 0.0), shift)
    return deviations


def _shift_value(value: Any, shift: float) -> Any:
    """A number, or each of a list, more by ``shift``; what is no number is left to the validation."""
    if isinstance(value, tuple):
        return tuple(_shift_value(item, shift) for item in value)
    return value + shift if isinstance(value, int | float) else value


def _growth_of(warm: Warm, dimension: str) -> float:
    return warm.growth[PART_OF.get(dimension, "disk")]


def temperature_sentence(temperature: Temperature) -> str:
    """The temperatures in a sentence."""
    parts = ", ".join(f"{part} {getattr(temperature, f'{part}_C'):g}" for part in ("disk", "pins", "housing", "crank"))
    reference = f"the drawing at {temperature.reference_C:g}"
    return f"Temperatures: {parts} degrees C; lengths, moduli and allowances are at these, {reference}."
