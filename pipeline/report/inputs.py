"""What went into a study, as the report tells it: reducer, tolerances, settings, and where each number comes from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.config.designs.design import Design
from pipeline.config.dimensions import dimension_library
from pipeline.config.distributions import Distribution
from pipeline.config.files.section import number_at
from pipeline.config.studies.consistency import number_keys
from pipeline.config.studies.study import Cycle, Study
from pipeline.config.studies.tolerances import Case, Tolerances
from pipeline.figures.labels import PARAMETERS
from pipeline.model.contact.line_laws.contact_law import law_of
from pipeline.model.effects import library
from pipeline.report.frames import Frames, flank_fact
from pipeline.report.layout import DASH, count_text, listed_text, plain_number

UNITS = {
    "_N_per_mm_power": "N/mmⁿ",
    "_MPa": "MPa",
    "_deg": "°",
    "_Nm": "N m",
    "_mm": "mm",
    "_um": "µm",
    "_Nm_per_arcmin": "N m/′",
    "_arcmin": "′",
}
RATIO = {
    "housing": "{}, which is the number of lobes; the housing is fixed, the flange turns against the crank",
    "flange": "{}, which is the number of pins; the flange is fixed, the housing turns with the crank",
}
PROPER_NAMES = {"youngs": "Young's", "poisson": "Poisson's"}
EXPERIMENTS = {
    "monte_carlo": "Monte Carlo: independent random samples",
    "sobol": "scrambled Sobol’ points",
    "latin_hypercube": "Latin hypercube",
    "cases": "listed cases",
}
METHODS = {"exact": "exact distances", "first_order": "first order in the errors"}
DISK_READINGS = {
    "radial_on_diameter": "on the disk's diameter: half of it shifts the flank, like the radius of the pin circle",
    "radial": "on the disk's radius: it shifts the flank, like the radius of the pin circle",
    "normal": "along the normal of the flank",
}
STRESS = {"plane_stress": "plane stress", "plane_strain": "plane strain"}


@dataclass(frozen=True)
class DesignNumber:
    """One number of the design file and where it comes from."""

    key: str
    name: str
    value: str
    unit: str
    status: str
    reason: str


@dataclass(frozen=True)
class ToleranceRow:
    """One tolerance that is not zero."""

    title: str
    distribution: str
    lower: str
    upper: str
    allowance: str
    details: str
    sign: str


def design_numbers(design: Design) -> list[tuple[str, list[DesignNumber]]]:
    """Every number of the design by section, in the file's order."""
    raw = design.model_dump()
    sections: dict[str, list[DesignNumber]] = {}
    of_effects = dict(_effect_names(design))
    for key in number_keys(raw):
        section, _, key_tail = key.partition(".")
        name, unit = of_effects.get(key) or _name_and_unit(key_tail)
        provenance = design.provenance.get(key)
        status, reason = (provenance.status, provenance.reason) if provenance else ("not stated", "")
        design_number = DesignNumber(key, name, plain_number(number_at(raw, key)), unit, status, reason)
        sections.setdefault(section, []).append(design_number)
    return list(sections.items())


def names_by_status(numbers: Sequence[tuple[str, list[DesignNumber]]], status: str) -> list[str]:
    """Names of the numbers of one status, with their section where the name alone is not enough."""
    return [f"{item.name} ({section})" for section, items in numbers for item in items if item.status == status]


def tolerance_rows(tolerances: Tolerances) -> list[ToleranceRow]:
    """The tolerances that are not zero."""
    return [_tolerance_row(name, tolerance) for name, tolerance in tolerances if not _is_zero(tolerance)]


def nominal_outside(tolerances: Tolerances) -> list[str]:
    """Tolerances whose limits leave the nominal reducer out, with the zone and its middle [um]."""
    rows = []
    for name, tolerance in tolerances:
        low, high = tolerance.limits_um
        if not low <= 0 <= high:
            zone = f"{plain_number(tolerance.allowance_um + low)} to {plain_number(tolerance.allowance_um + high)}"
            middle = plain_number(tolerance.allowance_um + 0.5 * (low + high))
            rows.append(
                f"{PARAMETERS[name]} (zone {zone} \u00b5m, middle {middle}, nominal "
                f"{plain_number(tolerance.allowance_um)})"
            )
    return rows


def zero_tolerances(tolerances: Tolerances) -> list[str]:
    """Names of the tolerances that are zero."""
    return [PARAMETERS[name] for name, tolerance in tolerances if _is_zero(tolerance)]


def case_columns(cases: Sequence[Case]) -> list[str]:
    """Tolerances that some case sets."""
    return [name for name in PARAMETERS if any(_any(getattr(case, name, 0.0)) for case in cases)]


def case_cells(case: Case, columns: Sequence[str]) -> list[str]:
    """Deviations of one case [um]; of a list its length and range."""
    cells = []
    for name in columns:
        value = getattr(case, name)
        if isinstance(value, tuple):
            cells.append(f"{len(value)} values, {plain_number(min(value))} to {plain_number(max(value))}")
        else:
            cells.append(plain_number(value))
    return cells


def _several(count: int) -> str:
    return f"{count}, each " if count > 1 else ""


def _ratio_fact(design: Design) -> str:
    """The ratio of the disks; of a carrier, whose planets turn before the cranks, that of the whole is told below."""
    fact = RATIO[design.cycloid.fixed].format(design.cycloid.ratio)
    return fact.replace("the flange", "the carrier") if design.output.carries_disks else fact


def reducer_facts(design: Design) -> list[tuple[str, str]]:
    """The reducer in numbers."""
    cycloid, bearing, shaft = design.cycloid, design.bearing, design.input_shaft
    law = "linear" if bearing.exponent == 1 else f"with the power {plain_number(bearing.exponent)} of the deflection"
    return [
        ("Ratio of the disks" if design.output.carries_disks else "Reduction ratio", _ratio_fact(design)),
        (
            "Pins",
            f"{cycloid.pins} of radius {plain_number(cycloid.pin_radius_mm)} mm on a circle of radius "
            f"{plain_number(cycloid.pin_circle_radius_mm)} mm",
        ),
        ("Eccentricity", f"{plain_number(cycloid.eccentricity_mm)} mm"),
        ("Rated torque", f"{plain_number(cycloid.rated_torque_Nm)} N m"),
        (
            "Disk" if design.disk.count == 1 else "Disks",
            f"{_several(design.disk.count)}{plain_number(design.disk.thickness_mm)} mm thick, {design.disk.material}, "
            f"{STRESS[design.disk.stress]}",
        ),
        *([("Flank", flank_fact(design))] if design.flank else []),
        ("Bearing of each crank" if design.output.carries_disks else "Input bearing", f"radial spring, {law}"),
        *([("Input shaft", f"bends over {plain_number(shaft.span_mm)} mm, of {shaft.material}")] if shaft else []),
        ("Output", design.output.fact(design.cycloid, plain_number)),
        *([("Effects", _effects_fact(design))] if design.effects else []),
    ]


def _effects_fact(design: Design) -> str:
    texts = []
    for name, values in design.effects.items():
        effect = library()[name]
        numbers = [
            f"{parameter.quantity} {plain_number(values[parameter.name])} {_unit_text(parameter.unit)}".rstrip()
            for parameter in effect.parameters
        ]
        texts.append(f"{effect.title} ({', '.join(numbers)})")
    return "; ".join(texts)


def _effect_names(design: Design) -> Iterator[tuple[str, tuple[str, str]]]:
    """Key of every number of an effect, with its name and unit as people read them."""
    for name in design.effects:
        effect = library()[name]
        for parameter in effect.parameters:
            words = f"{effect.title}, {parameter.quantity}"
            yield f"effects.{name}.{parameter.name}", (words, _unit_text(parameter.unit))


def _unit_text(unit: str) -> str:
    """A unit as the page writes it; a pure number has none."""
    return "" if unit == "1" else unit.replace("um", "µm").replace("arcmin", "′").replace(")2", ")²")


def law_fact(study: Study) -> str:
    """The law of the contacts and where it comes from."""
    law = law_of(study.springs.law, study.springs.stiffness_N_per_mm)
    return f"{law.title} ({law.source})"


def _crank_angles(cycle: Cycle) -> str:
    if cycle.loaded_angles:
        angles_text = f"{cycle.loaded_angles} evenly over the turn"
    else:
        angles_text = listed_text([f"{plain_number(crank)}°" for crank in cycle.crank_deg])
    turn = f"{cycle.turn} ({cycle.crank_turns} turns of the crank)" if cycle.crank_turns > 1 else "crank"
    return f"loaded at {angles_text}; rigid bodies at these and at {cycle.rigid_angles} evenly; turn of the {turn}"


def study_facts(frames: Frames) -> list[tuple[str, str]]:
    """The study in numbers."""
    study = frames.study
    samples, cycle = study.samples, study.cycle
    nominal = ", and the nominal reducer as sample 0" if samples.nominal_first else ""
    experiment = EXPERIMENTS[samples.experiment]
    if samples.has_replicates:
        experiment += f" in {samples.randomisations} independent randomisations"
    seed = "" if frames.is_listed else f", seed {samples.seed}"
    top = cycle.torque_fraction * study.design.cycloid.rated_torque_Nm
    output = study.design.output
    return [
        ("Samples", f"{count_text(samples.count, 'case' if frames.is_listed else 'sample')}{nominal}"),
        ("Design of experiment", f"{experiment}{seed}"),
        ("Crank angles", _crank_angles(cycle)),
        (
            "Load cycle",
            f"0 → +T → −T → +T on the output with T = {plain_number(top)} N m, {cycle.levels_per_branch} equal "
            "steps a branch and the torques of the definitions; input held",
        ),
        (
            "Clearances",
            f"{METHODS[study.clearance.method]}; the disk's tolerance is "
            f"{DISK_READINGS[study.clearance.disk_reading]}; "
            f"{output.diameter_readings[study.clearance.roller_reading]}",
        ),
        ("Contacts", law_fact(study)),
        ("Disk", _disk_fact(frames)),
    ]


def _disk_fact(frames: Frames) -> str:
    design, reduce = frames.study.design, frames.study.reduce
    if frames.mesh is None:
        return "rigid but for its contacts, which are those of solid bodies"
    triangles, nodes = frames.mesh
    on_walls = f", {plain_number(reduce.roller_patch_half_width_mm)} mm in the holes"
    return (
        f"{triangles:,} quadratic triangles, {nodes:,} nodes, {reduce.flank_edges_per_lobe} edges a lobe, "
        f"pressure patches of half width {plain_number(reduce.patch_half_width_mm)} mm"
        f"{on_walls if design.output.holes(design.cycloid) else ''}"
    )


def _name_and_unit(key: str) -> tuple[str, str]:
    """``pin_circle_radius_mm`` -> ``pin circle radius``, ``mm``."""
    suffix = next((suffix for suffix in UNITS if key.endswith(suffix)), "")
    name = key.removesuffix(suffix).replace("_", " ").replace(".", ", ")
    for plain_name, proper_name in PROPER_NAMES.items():
        name = name.replace(plain_name, proper_name)
    return name, UNITS.get(suffix, "")


def _is_zero(tolerance: Any) -> bool:
    return bool(tolerance.limits_um == (0.0, 0.0) and tolerance.allowance_um == 0)


def _any(value: Any) -> bool:
    return any(value) if isinstance(value, tuple) else bool(value)


def _tolerance_row(name: str, tolerance: Distribution) -> ToleranceRow:
    lower, upper = tolerance.limits_um
    return ToleranceRow(
        PARAMETERS[name],
        tolerance.name,
        plain_number(lower),
        plain_number(upper) if tolerance.varies else DASH,
        plain_number(tolerance.allowance_um),
        "; ".join(tolerance.details(plain_number)),
        dimension_library()[name].sign,
    )
