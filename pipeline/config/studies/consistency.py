"""Contradictions between values that are each allowed: in a study, and between provenance and the numbers it is of."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pipeline.config.designs.design import Design
from pipeline.config.designs.problems import stiffness_problems, study_effect_problems
from pipeline.config.designs.sections import Operation
from pipeline.config.files.section import MISSING, NAME, NAME_RULE, Mistake, nearest_name, number_at
from pipeline.config.studies.optional import Tails, without_tails
from pipeline.config.studies.study import (
    FEWEST_BASE_SAMPLES,
    LOADED_ANGLES,
    Clearance,
    Cycle,
    Drivers,
    Limits,
    Metrics,
    Reduce,
    Samples,
)
from pipeline.model.metrics.turn import turn_library
from pipeline.model.metrics.turn.turn_metric import FRICTION, NEEDS, RATING, SPEED

LARGEST_HYPERCUBE = 100_000
"""A Latin hypercube is held as a whole by every worker, some 3 kB a sample."""
LARGEST_RUN = 10**10
"""Samples x contacts: 80 GB of gaps at each crank angle."""
LARGEST_MESH = 2_000_000
"""Triangles whose factors fill some 10 GB; the paper's disk has 30,000."""
RESERVED_NAMES = (
    "verify",
    "calibrate",
    "bench",
    "blind",
    "identify",
    "population",
    "coverage",
    "tails",
    "compare",
    "allocate",
    "bounds",
    "joints",
    "reweigh",
    "lots",
    "assemble",
    "certificate",
    "changed",
    "series",
)
"""Run folders of the targets that are no study."""


def study_problems(parts: Mapping[str, Any], raw: Mapping[str, Any]) -> list[Mistake]:
    """Contradictions among the valid sections of a study.

    Parameters
    ----------
    parts : the sections that are valid by themselves, by name.
    raw : the file as read, which also tells what was left to its default.
    """
    problems: list[Mistake] = []
    samples, cycle, metrics, reduce, design = (
        parts.get(name) for name in ("samples", "cycle", "metrics", "reduce", "design")
    )
    if "name" in parts and not NAME.fullmatch(parts["name"]):
        problems.append(Mistake("file name", parts["name"], NAME_RULE))
    if parts.get("name") in RESERVED_NAMES:
        problems.append(
            Mistake("file name", parts["name"], "is the run folder of another target; rename the study file")
        )
    if samples:
        problems += _samples(samples, raw)
        problems += _until(samples, parts.get("limits"))
    if samples and design:
        problems += _size(samples, design)
    if design and parts.get("limits"):
        problems += _limits(parts["limits"], design)
    if samples and parts.get("drivers"):
        problems += _drivers(parts["drivers"], samples)
    if samples and design and parts.get("limits") and parts.get("tails"):
        problems += _tails(parts["tails"], samples, parts["limits"], design)
    if cycle:
        problems += _cycle(cycle, samples, raw)
        problems += _phases(cycle, design)
    if parts.get("springs"):
        problems += stiffness_problems(parts["springs"].law, parts["springs"].stiffness_N_per_mm)
    if cycle and metrics:
        problems += _metrics(metrics, cycle)
    if reduce and design:
        problems += _patches(reduce, design)
        problems += _mesh(reduce, design)
    if design:
        problems += study_effect_problems(design.effects, design.temperature_rise_K or 0.0)
        problems += _readings(parts.get("clearance"), design)
        problems += _diameters(raw, design)
    return problems


def number_keys(raw: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Dotted keys of all numbers of a design file, its provenance left out."""
    keys: list[str] = []
    for name, value in raw.items():
        if isinstance(value, Mapping) and prefix + name != "provenance":
            keys += number_keys(value, f"{prefix}{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            keys.append(prefix + name)
    return keys


def provenance_problems(parts: Mapping[str, Any], raw: Mapping[str, Any]) -> Iterator[Mistake]:
    """Provenance of a number that the design ``raw`` does not have, that a part in series lacks, and wrong ranges."""
    numbers = number_keys(raw)
    for name in parts.get("series", {}):
        key = f"series.{name}.stiffness_Nm_per_arcmin"
        if key not in parts.get("provenance", {}):
            yield Mistake(f'provenance."{key}"', MISSING, "add it: where the stiffness of a part in series comes from")
    for key, provenance in parts.get("provenance", {}).items():
        if key not in numbers:
            yield Mistake(f'provenance."{key}"', None, f"no such number in this file; {nearest_name(key, numbers)}")
        elif provenance.plausible:
            low, high = provenance.plausible
            value = number_at(raw, key)
            if not low < value < high:
                requirement = f"must be [lower, upper] about the number itself, {value:g}"
                yield Mistake(f'provenance."{key}".plausible', list(provenance.plausible), requirement)


def stated_needs(operation: Operation | None) -> dict[str, bool]:
    """Whether a design's operation states each of what metrics of the turn need of it."""
    return {
        SPEED: operation is not None,
        RATING: operation is not None and operation.rating is not None,
        FRICTION: operation is not None and operation.friction is not None,
    }


def _limits(limits: Limits, design: Design) -> Iterator[Mistake]:
    """Limits on metrics that have no value, since the design does not state what they need."""
    is_stated = stated_needs(design.operation)
    for name, limit in limits.of_metrics.items():
        needs = turn_library()[name].needs if name in turn_library() else ()
        if missing := [NEEDS[need] for need in needs if not is_stated.get(need, True)]:
            requirement = f"has no value without {' and '.join(missing)}; add that, or delete the limit"
            yield Mistake(f"limits.{name}", limit, requirement)


def _samples(samples: Samples, raw: Mapping[str, Any]) -> Iterator[Mistake]:
    cases = raw.get("cases", ())
    n_cases = len(cases) if isinstance(cases, tuple) else 0
    if samples.experiment == "cases":
        if n_cases == 0:
            yield Mistake("cases", MISSING, 'experiment = "cases" needs at least one [[cases]]')
        elif samples.count != n_cases:
            yield Mistake(
                "samples.count", samples.count, f"must be {n_cases}, the number of [[cases]]; or leave it out"
            )
        if "tolerances" in raw:
            yield Mistake("tolerances", None, "a case states total values; delete the section, or the cases")
    elif n_cases:
        yield Mistake("samples.experiment", samples.experiment, 'must be "cases" where [[cases]] are listed')
    if samples.experiment == "latin_hypercube" and samples.count > LARGEST_HYPERCUBE:
        requirement = (
            f"must be <= {LARGEST_HYPERCUBE} in a Latin hypercube, which is held as a whole; take sobol or monte_carlo"
        )
        yield Mistake("samples.count", samples.count, requirement)
    if samples.has_replicates and samples.count % samples.randomisations:
        next_count = -(-samples.count // samples.randomisations) * samples.randomisations
        requirement = f"must be a multiple of randomisations = {samples.randomisations}; take {next_count}"
        yield Mistake("samples.count", samples.count, requirement)


def _until(samples: Samples, limits: Limits | None) -> Iterator[Mistake]:
    key, stop_rule = "samples.until", samples.until
    if stop_rule is None:
        return
    if samples.experiment != "monte_carlo":
        yield Mistake(
            f"{key} with experiment", samples.experiment, 'must be "monte_carlo", whose samples are independent'
        )
    if stop_rule.at_most < samples.count:
        requirement = f"must be >= samples.count = {samples.count}, which the study begins with"
        yield Mistake(f"{key}.at_most", stop_rule.at_most, requirement)
    if limits is not None and not limits.of_metrics:
        yield Mistake(key, None, "requires a yield, but [limits] sets no limit; set one, as lost_motion_arcmin = 2.8")


def _tails(tails: Tails, samples: Samples, limits: Limits, design: Design) -> Iterator[Mistake]:
    if reason := without_tails(samples, limits):
        yield Mistake("tails", None, reason)
    if tails.solve > tails.units:
        yield Mistake("tails.solve", tails.solve, f"must be <= tails.units = {tails.units}, of which they are taken")


def _drivers(drivers: Drivers, samples: Samples) -> Iterator[Mistake]:
    key, count = "drivers.base_samples", drivers.base_samples
    if 0 < count < FEWEST_BASE_SAMPLES:
        yield Mistake(
            key, count, f"must be 0 (no drivers by variance) or >= {FEWEST_BASE_SAMPLES}; use 1000 for results"
        )
    if count and samples.experiment == "cases":
        yield Mistake(key, count, "must be 0 where cases are listed: stated units have no variance to share")


def _size(samples: Samples, design: Design) -> Iterator[Mistake]:
    contacts = design.disk.count * (design.cycloid.pins + design.output.contacts)
    key, count = ("samples.until.at_most", samples.until.at_most) if samples.until else ("samples.count", samples.count)
    if count * contacts > LARGEST_RUN:
        requirement = (
            f"with {contacts} contacts a unit must be <= {LARGEST_RUN // contacts}: the gaps alone of more would fill "
            "the disk; take fewer samples, whose intervals the report states"
        )
        yield Mistake(key, count, requirement)


def _mesh(reduce: Reduce, design: Design) -> Iterator[Mistake]:
    radius, edge = design.cycloid.pin_circle_radius_mm, reduce.largest_edge_mm
    triangles = math.pi * radius**2 / (math.sqrt(3) / 4 * edge**2) + design.cycloid.lobes * reduce.flank_edges_per_lobe
    if triangles > LARGEST_MESH:
        requirement = (
            f"with {reduce.flank_edges_per_lobe} edges a lobe makes some {triangles:.2g} triangles, must be <= "
            f"{LARGEST_MESH:.0g}; take larger or fewer edges"
        )
        yield Mistake("reduce.largest_edge_mm", edge, requirement)


def periods(cycle: Mapping[str, Any] | Cycle, design: Design) -> dict[str, int]:
    """Numbers of parts, in words, with which angles evenly over the turn must share no factor to see all phases."""
    turn = cycle.turn if isinstance(cycle, Cycle) else cycle.get("turn", "output")
    parts = {f"{design.cycloid.pins} pins": design.cycloid.pins}
    if turn == "output":
        parts[f"{design.cycloid.lobes} lobes"] = design.cycloid.lobes
        parts[f"{design.disk.count} disks"] = design.disk.count
        holes = design.output.holes(design.cycloid)
        if holes:
            parts[f"{len(holes.centres)} holes"] = len(holes.centres)
    return parts


def with_turn(cycle: Mapping[str, Any], design: Design) -> dict[str, Any]:
    """The section `cycle` of a study file with what follows from its design.

    That is how many turns of the crank its turn has and, where the file states no angles, how many are loaded.
    """
    turns = 1 if cycle.get("turn", "output") == "crank" else design.cycloid.lobes
    stated_keys = {"crank_deg", "loaded_angles"} & set(cycle)
    angles = {} if stated_keys else {"loaded_angles": _next_coprime(LOADED_ANGLES, periods(cycle, design).values())}
    return {**cycle, "crank_turns": turns, **angles}


def _next_coprime(number: int, parts: Iterable[int]) -> int:
    numbers = tuple(parts)
    return next(k for k in itertools.count(number) if all(math.gcd(k, part) == 1 for part in numbers))


def _phases(cycle: Cycle, design: Design | None) -> Iterator[Mistake]:
    """Evenly spread angles that share a factor with the parts: they see few phases of their pitch."""
    if design is None:
        return
    parts = periods(cycle, design)
    counts = {"loaded_angles": cycle.loaded_angles or 1, "rigid_angles": cycle.rigid_angles}
    for (name, angles), (part, number) in itertools.product(counts.items(), parts.items()):
        divisor = math.gcd(angles, number)
        if divisor > 1 and angles > 1:
            phases = f"{angles // divisor} phase{'s' * (angles > divisor)}"
            requirement = f"must share no factor with the {part}, or the angles see {phases} of their pitch"
            yield Mistake(f"cycle.{name}", angles, f"{requirement}; take {_next_coprime(angles + 1, parts.values())}")


def _cycle(cycle: Cycle, samples: Samples | None, raw: Mapping[str, Any]) -> Iterator[Mistake]:
    if {"loaded_angles", "crank_deg"} <= set(raw["cycle"]):
        yield Mistake("cycle.crank_deg", cycle.crank_deg, "cannot be combined with loaded_angles; keep one of them")
    if any(angle_after <= angle_before for angle_before, angle_after in itertools.pairwise(cycle.crank_deg)):
        yield Mistake("cycle.crank_deg", cycle.crank_deg, "angles must rise")
    if cycle.crank_deg[-1] >= cycle.turn_deg:
        requirement = f"must be < {cycle.turn_deg:g}, a turn of the {cycle.turn}"
        yield Mistake(f"cycle.crank_deg[{len(cycle.crank_deg) - 1}]", cycle.crank_deg[-1], requirement)
    if cycle.keep_contacts == "all":
        return
    if len(set(cycle.keep_contacts)) < len(cycle.keep_contacts):
        yield Mistake("cycle.keep_contacts", cycle.keep_contacts, "samples must differ")
    if samples and max(cycle.keep_contacts, default=0) >= samples.rows:
        yield Mistake("cycle.keep_contacts", cycle.keep_contacts, f"samples are numbered 0 to {samples.rows - 1}")


def _metrics(metrics: Metrics, cycle: Cycle) -> Iterator[Mistake]:
    low, high = metrics.rigidity_percent
    if low >= high:
        yield Mistake("metrics.rigidity_percent", metrics.rigidity_percent, "must rise: [lower, upper]")
    if metrics.lost_motion_percent in metrics.rigidity_percent:
        requirement = (
            f"must differ from rigidity_percent = {list(metrics.rigidity_percent)}: the lost motion is read where the "
            "play is being taken up, the rigidity beyond it; makers use 3 % for the one, 50 and 100 % for the other"
        )
        yield Mistake("metrics.lost_motion_percent", metrics.lost_motion_percent, requirement)
    top_percent = 100 * cycle.torque_fraction
    for name, percent in {"rigidity_percent": high, "lost_motion_percent": metrics.lost_motion_percent}.items():
        if percent > top_percent:
            requirement = (
                f"must be <= {top_percent:g}, which cycle.torque_fraction reaches; raise the one or lower the other"
            )
            yield Mistake(f"metrics.{name}", getattr(metrics, name), requirement)


def _patches(reduce: Reduce, design: Design) -> Iterator[Mistake]:
    radii = {
        "patch_half_width_mm": design.cycloid.pin_radius_mm,
        "roller_patch_half_width_mm": design.output.contact_radius_mm,
    }
    for name, radius in radii.items():
        if getattr(reduce, name) >= radius:
            yield Mistake(f"reduce.{name}", getattr(reduce, name), f"must be < {radius:g} mm, the rolling radius")


def _readings(clearance: Clearance | None, design: Design) -> Iterator[Mistake]:
    requirement = design.output.diameter_readings
    if clearance and clearance.roller_reading not in requirement:
        meanings = " or ".join(f'"{reading}": {meaning}' for reading, meaning in requirement.items())
        yield Mistake("clearance.roller_reading", clearance.roller_reading, f"must be {meanings}")


def _diameters(raw: Mapping[str, Any], design: Design) -> Iterator[Mistake]:
    """Tolerances of diameters that no part of the output has, and an effect on a bearing that is not there."""
    if design.output.carries_disks and "bearing_clearance" in design.effects:
        requirement = "acts on a bearing of the disk, which is carried by the output; set bearing.clearance_um"
        yield Mistake("design.effects.bearing_clearance", None, requirement)
    if design.output.toleranced_diameters:
        return
    cases = raw.get("cases", ())
    sections = {"tolerances": raw.get("tolerances", {})}
    sections |= {f"cases[{k}]": case for k, case in enumerate(cases if isinstance(cases, tuple) else ())}
    for key, section in sections.items():
        if isinstance(section, Mapping) and "roller_diameter" in section:
            requirement = f"acts on nothing: a {design.output.name} has no part of toleranced diameter; delete it"
            yield Mistake(f"{key}.roller_diameter", None, requirement)
