"""Drives of a design at factors of its calibrated numbers and of its force laws, made once each.

A part of a drive is made anew only where a number that it depends on has changed.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from pipeline import assembly
from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.files.section import number_at, with_value
from pipeline.config.studies.study import Study
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.model.contact.laws import ContactLaws, concatenated_laws
from pipeline.model.effects import Conditions
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.load_history.drive import Drive
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors as SampledErrors

Scales = tuple[float, ...]

GAP_FIELDS = ("kind", "gap", "two_sided", "per_eccentricity")
"""Of a contact: what its gap is made of beside the flank and the errors."""
TRIAL: Rounding = 1.01
"""Factor of a calibrated number by which it is seen whether contacts move with it."""
KEPT_SCALES: Fineness = 64
"""Factors of the calibrated numbers of which the drives of all positions are kept."""


def scaled_design(design: Design, keys: Sequence[str], scales: Sequence[float]) -> Design:
    """The design with the numbers at ``keys`` times their scales, not checked again."""
    for key, scale in zip(keys, scales, strict=True):
        design = with_value(design, key, number_at(design, key) * scale)
    return design


def softness(design: Design) -> float:
    """The compliance of the disk is in proportion to this."""
    return 1 / (design.materials[design.disk.material].youngs_modulus_MPa * design.disk.thickness_mm)


def _with_gaps(drive: Drive, known_drive: Drive | None = None) -> Drive:
    """The drive, its states alike, with the gaps of one of them; those of ``known_drive`` where that has the same."""
    if known_drive is not None and _same_gaps(drive, known_drive):
        return replace(drive, known_gap=known_drive.gap_of_errors)
    first_sample = {name: values[:1] for name, values in vars(drive.errors).items()}
    state = replace(
        drive, errors=Errors(**first_sample), shift=drive.shift[:1], bearing_clearance=drive.bearing_clearance[:1]
    )
    return replace(drive, known_gap=np.repeat(state.gap_of_errors, len(drive.bearing_clearance), axis=0))


def _same_gaps(drive: Drive, known_drive: Drive) -> bool:
    """Whether two drives with the same errors at one crank angle differ in nothing that gaps are made of."""
    contacts, counterparts = drive.reducer.contacts, known_drive.reducer.contacts
    return drive.profile == known_drive.profile and all(
        np.array_equal(getattr(contacts, name), getattr(counterparts, name)) for name in GAP_FIELDS
    )


def _repeated_errors(errors: Errors, n: int) -> Errors:
    return Errors(**{name: np.repeat(values[:1], n, axis=0) for name, values in vars(errors).items()})


class _Part:
    """A part of a study's drives that depends on some of its calibrated numbers, kept for each of their scales.

    Parameters
    ----------
    scaled_study : the study at scales of its ``n_numbers`` numbers.
    make : the part of a study at a crank angle [degrees].
    content : its numbers; those whose trial leaves it as it is are left as declared.
    cranks : angles at which it is asked for [degrees].
    """

    def __init__(
        self,
        scaled_study: Callable[[Scales], Study],
        n_numbers: int,
        make: Callable[[Study, float], Any],
        content: Callable[[Any], bytes],
        cranks: Sequence[float],
    ):
        trials = [tuple(TRIAL if k == number else 1.0 for k in range(n_numbers)) for number in range(-1, n_numbers)]
        declared_content, *contents = (content(make(scaled_study(trial), cranks[0])) for trial in trials)
        self.depends = [trial_content != declared_content for trial_content in contents]
        self.cached_part = lru_cache(maxsize=KEPT_SCALES * len(cranks))(
            lambda numbers, crank_deg: make(scaled_study(numbers), crank_deg)
        )

    def part_at(self, numbers: Scales, crank_deg: float) -> Any:
        """The part at scales of the numbers."""
        scales = zip(numbers, self.depends, strict=True)
        return self.cached_part(tuple(scale if depends else 1.0 for scale, depends in scales), crank_deg)


def _places(reducer: Reducer) -> bytes:
    """Where the contacts of a reducer stand, and what their gaps are made of."""
    return b"".join(values.tobytes() for values in vars(reducer.contacts).values())


def drives_of(
    study: Study,
    keys: Sequence[str],
    sampled_errors: SampledErrors,
    cranks: Real,
    compliances: Sequence[Real],
    conditions: Sequence[Conditions],
) -> Callable[[Scales, int], Drive]:
    """Drive of a position at factors of the numbers at ``keys`` and of the force laws.

    Parameters
    ----------
    sampled_errors : errors of one unit [um].
    cranks : (n_positions,) [degrees].
    compliances : per position, of the disks as condensed (n_contacts, n_contacts) [mm/N].
    conditions : per position, of its states.
    """
    declared_scales, counts = (1.0,) * len(keys), [len(position.cycle) for position in conditions]
    errors = [_repeated_errors(assembly.errors(sampled_errors), count) for count in counts]
    clearances = [np.repeat(sampled_errors.bearing_clearance, count, axis=0) for count in counts]
    own_factors = np.array(assembly.law_factors(study))
    angles, kept_drives = cranks.tolist(), KEPT_SCALES * len(cranks)

    @lru_cache(maxsize=4 * KEPT_SCALES)
    def scaled_study(numbers: Scales) -> Study:
        return study.model_copy(update={"design": scaled_design(study.design, keys, numbers)}) if keys else study

    of_numbers = scaled_study, len(keys)
    reducers = _Part(*of_numbers, lambda scaled, crank: assembly.reducer(scaled.design, crank), _places, angles)
    pins = _Part(*of_numbers, _laws_of_pins, _content, angles)
    output = _Part(*of_numbers, lambda scaled, _: assembly.output_laws(scaled), _content, angles[:1])
    forces = _Part(*of_numbers, lambda scaled, _: assembly.usual_forces(scaled.design), np.ndarray.tobytes, angles[:1])

    @lru_cache(maxsize=kept_drives)
    def compliance(factor: float, position: int) -> Real:
        return factor * compliances[position]

    @lru_cache(maxsize=kept_drives)
    def with_numbers(numbers: Scales, position: int) -> Drive:
        refined_study = scaled_study(numbers)
        drive = drive_of(
            refined_study,
            angles[position],
            compliance(softness(refined_study.design) / softness(study.design), position),
            errors[position],
            assembly.bearing_clearance(refined_study.design, clearances[position]),
            laws=concatenated_laws([pins.part_at(numbers, angles[position]), output.part_at(numbers, angles[0])]),
            reducer=reducers.part_at(numbers, angles[position]),
        )
        return _with_gaps(drive, None if numbers == declared_scales else with_numbers(declared_scales, position))

    @lru_cache(maxsize=4 * kept_drives)
    def drive(scales: Scales, position: int) -> Drive:
        numbers, factors = scales[: len(keys)], own_factors * scales[len(keys) :]
        declared = with_numbers(numbers, position)
        design, usual_forces = scaled_study(numbers).design, forces.part_at(numbers, angles[0])
        laws = assembly.with_factors(declared.laws, design, declared.reducer, factors.tolist(), usual_forces)
        return replace(declared, laws=laws, known_gap=declared.gap_of_errors)

    return drive


def _content(laws: ContactLaws) -> bytes:
    return laws.content


def _laws_of_pins(study: Study, crank_deg: float) -> ContactLaws:
    return assembly.pin_laws(study, assembly.reducer(study.design, crank_deg))
