"""Temperatures that differ from unit to unit: a mean with a distribution, in `disk_C` and its like.

A draw is told of the growth of the part's characteristic length, a toleranced dimension as any other. A part may have
the temperature of another one: `pins_C = "disk"`.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from pipeline.config.designs.design import Design
from pipeline.config.designs.sections import Thermal, ThermalPart
from pipeline.config.distributions import Distribution
from pipeline.config.files.key_reference import problems_of
from pipeline.config.files.section import MISSING, Mistake, Section, nearest_name
from pipeline.config.stated_temperature import Temperature, Warm, materials_of_parts, temperature_rise
from pipeline.config.studies.tolerances import Tolerance
from pipeline.model.units import UM_PER_MM

PARTS = ("disk", "pins", "housing", "crank")
NOMINAL = "nominal_C"
COLDEST, HOTTEST = -60.0, 250.0
"""Temperatures [deg C] between which a material's expansion and slope are numbers."""
UNLIKE_SOFTENING = 0.01
"""Largest error of a contact's compliance by taking the modulus of all elastic parts to change as the disk's does."""


class _Draw(Section):
    """One temperature's distribution, its deviations [K] under the names that deviations [um] have."""

    draw: Tolerance


def plain_temperatures(raw: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any], dict[str, str], list[Mistake]]:
    """The section with a number for each part, the distributions, who follows whom, and what is wrong.

    Returns
    -------
    temperatures : the section with nominal temperatures [deg C].
    draws : distribution of each part that has one, as the file has it.
    follows : part whose temperature a part has.
    problems : of the parts that follow another one, and of distributions without a nominal temperature.
    """
    temperatures, draws, follows, problems = dict(raw), {}, {}, []
    for part in PARTS:
        key, value = f"{part}_C", raw.get(f"{part}_C")
        if isinstance(value, Mapping):
            draws[part] = {name: item for name, item in value.items() if name != NOMINAL}
            temperatures[key] = value.get(NOMINAL)
            if NOMINAL not in value:
                problems.append(Mistake(f"temperature.{key}.{NOMINAL}", MISSING, "add it"))
    for part in PARTS:
        key, value = f"{part}_C", raw.get(f"{part}_C")
        if not isinstance(value, str):
            continue
        if value not in PARTS or isinstance(raw.get(f"{value}_C", ""), str):
            requirement = (
                f"must be a number, a distribution or the part whose temperature it has; {nearest_name(value, PARTS)}"
            )
            problems.append(Mistake(f"temperature.{key}", value, requirement))
            continue
        follows[part], temperatures[key] = value, temperatures[f"{value}_C"]
    return temperatures, draws, follows, problems


def read_draws(draws: Mapping[str, Any]) -> tuple[dict[str, Distribution], list[Mistake]]:
    """Distribution of each drawn temperature, its deviations [K], and what is wrong with them."""
    read: dict[str, Distribution] = {}
    problems: list[Mistake] = []
    for part, settings in draws.items():
        key = f"temperature.{part}_C"
        try:
            draw = _Draw.model_validate({"draw": {name.replace("_K", "_um"): item for name, item in settings.items()}})
        except ValidationError as error:
            mistakes = problems_of(error, _Draw)
            problems += [
                Mistake(p.key.replace("draw", key, 1).replace("_um", "_K"), p.value, p.requirement) for p in mistakes
            ]
            continue
        mistakes = list(draw.draw.problems(key))
        if draw.draw.in_disc:
            mistakes.append(
                Mistake(f"{key}.distribution", draw.draw.name, "is of a point in a zone; take one with limits")
            )
        problems += [Mistake(p.key.replace("_um", "_K"), p.value, p.requirement.replace("_um", "_K")) for p in mistakes]
        read[part] = draw.draw
    return read, problems


def thermal_of(warm: Warm, design: Design, draws: Mapping[str, Distribution], follows: Mapping[str, str]) -> Thermal:
    """How the parts of a design (that of the drawing) grow and soften about their mean temperatures."""
    cycloid, disk_growth = design.cycloid, warm.growth["disk"]
    sizes = {
        "disk": cycloid.pin_circle_radius_mm,
        "pins": cycloid.pin_radius_mm,
        "housing": cycloid.pin_circle_radius_mm,
        "crank": cycloid.eccentricity_mm,
    }
    parts = {}
    for part, name in materials_of_parts(warm.temperature, design).items():
        material = design.materials[name]
        parts[part] = ThermalPart(
            follows=follows.get(part, part),
            size_um=UM_PER_MM * sizes[part] * disk_growth,
            expansion_per_K=material.expansion_per_K or 0.0,
            slope_per_K=material.modulus_slope_per_K or 0.0,
            rise_K=temperature_rise(warm.temperature, part),
        )
    return Thermal(drawn_parts=tuple(draws), parts=parts)


def growth_tolerances(thermal: Thermal, draws: Mapping[str, Distribution]) -> dict[str, dict[str, Any]]:
    """Tolerance of the growth [um] of each part whose temperature is drawn."""
    tolerances = {}
    for part, draw in draws.items():
        settings = draw.model_dump(exclude_none=True)
        factor = thermal.parts[part].growth_um(1.0)
        tolerance = {name: factor * value if name.endswith("_um") else value for name, value in settings.items()}
        tolerances[f"{part}_growth"] = tolerance
    return tolerances


def draw_problems(
    temperature: Temperature, thermal: Thermal, design: Design, draws: Mapping[str, Distribution]
) -> list[Mistake]:
    """Temperatures out of range, parts that do not grow, moduli that do not change as one, and effects beside them."""
    problems = []
    limits = {part: _limits(draw) for part, draw in draws.items()}
    for part, (lower, upper) in limits.items():
        key, nominal = f"temperature.{part}_C", getattr(temperature, f"{part}_C")
        for name, end in (("lower_K", lower), ("upper_K", upper)):
            if not COLDEST <= nominal + end <= HOTTEST:
                requirement = f"is {nominal + end:g} degrees C; must lie within {COLDEST:g} and {HOTTEST:g}"
                problems.append(Mistake(f"{key}.{name}", end, requirement))
        if thermal.parts[part].expansion_per_K == 0:
            problems.append(Mistake(key, None, "is drawn of a material with expansion_per_K = 0; state one number"))
    if not problems and draws:
        problems += _modulus_problems(thermal, design, limits)
    return problems


def _limits(draw: Distribution) -> tuple[float, float]:
    lower, upper = draw.limits_um
    return draw.allowance_um + lower, draw.allowance_um + upper


def _modulus_problems(thermal: Thermal, design: Design, limits: Mapping[str, tuple[float, float]]) -> list[Mistake]:
    """Whether one factor of the modulus serves all elastic parts, and whether it is known of all that resists."""
    disk = design.materials[design.disk.material]
    elastic = {"pins": (thermal.parts["pins"], design.materials[design.pins.material])}
    for key, name in design.output.model_dump().items():
        if key.endswith("material") and name in design.materials:
            material = design.materials[name]
            slope = material.modulus_slope_per_K or 0.0
            elastic[f"output.{key}"] = thermal.parts["disk"].model_copy(update={"slope_per_K": slope}), material
    ends_of_disk = _range(thermal, "disk", limits)
    if min(thermal.parts["disk"].softening(warmer) for warmer in ends_of_disk) <= 0:
        return [Mistake("temperature.disk_C", None, "leaves its material no modulus; take narrower limits")]
    for name, (part, material) in elastic.items():
        share = disk.youngs_modulus_MPa / (disk.youngs_modulus_MPa + material.youngs_modulus_MPa)
        are_coupled = part.follows == thermal.parts["disk"].follows
        ends = _range(thermal, part.follows, limits)
        pairs = zip(ends_of_disk, ends, strict=True) if are_coupled else ((x, y) for x in ends_of_disk for y in ends)
        spread = max(abs(part.softening(y) / thermal.parts["disk"].softening(x) - 1) for x, y in pairs)
        if share * spread > UNLIKE_SOFTENING:
            requirement = (
                f"{name} and disk soften unlike, by up to {100 * share * spread:.2g} % of a contact's compliance, and "
                f"a drawn temperature changes all moduli as the disk's; must be within {100 * UNLIKE_SOFTENING:g} %: "
                "draw less, or state the temperatures"
            )
            return [Mistake("temperature", None, requirement)]
    if (design.effects or design.series) and any(part.slope_per_K for part in thermal.parts.values()):
        parts = ", ".join([*(f"[effects] {n}" for n in design.effects), *(f"[series] {n}" for n in design.series)])
        requirement = f"are drawn beside {parts}, whose change with the modulus is not known"
        return [Mistake("temperature", None, f"{requirement}: state the temperatures, or delete modulus_slope_per_K")]
    return []


def _range(thermal: Thermal, part: str, limits: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Least and largest temperature above the mean [K] of the part and of those with its temperature."""
    return limits.get(thermal.parts[part].follows, (0.0, 0.0))


def draw_sentence(draws: Mapping[str, Distribution], follows: Mapping[str, str]) -> str:
    """The distributions in a sentence."""
    parts = [f"{part} {draw.name}, {'{:+g} to {:+g}'.format(*_limits(draw))} K" for part, draw in draws.items()]
    coupled_parts = [f"{part} as the {source}" for part, source in follows.items() if source in draws]
    return f"Drawn about these: {'; '.join(parts + coupled_parts)}."
