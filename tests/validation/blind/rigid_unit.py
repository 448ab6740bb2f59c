"""A blind unit of the second simulator: a study's design as rigid bodies, with tolerances and a bench of its own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.arrays import Real
from pipeline.config.designs.design import Design
from pipeline.config.studies.study import Study
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.sampling.errors import Errors
from tests.validation.blind.bench import Bench, Ramp
from tests.validation.blind.rigid_drive.drive import Bearing, Curve, NoBalanceError, RigidDrive
from tests.validation.blind.rigid_drive.effects import EFFECTS, MM_PER_UM, NMM_PER_NM, RAD_PER_ARCMIN
from tests.validation.blind.rigid_drive.flank import CrossedSlides, Flank, LineContact, Output, PinsInHoles
from tests.validation.blind.rigid_drive.readings import Loading, Position
from tests.validation.blind.true_unit import Outside, Track, UnsoundError, encoder_places

ON_DIAMETER = 0.5
"""Material off the flank for an error of the disk's size on its diameter."""
LOTS = ("disk_profile", "eccentricity", "lobe_profile", "pin_radial", "pin_radius", "pin_tangential", "roller_diameter")
"""Dimensions that the second simulator draws by itself."""
HALF = 0.5
"""Of a diameter's error at each side of a roller or an output pin."""


@dataclass(frozen=True)
class RigidUnit:
    """A unit as it is; attributes as those of ``TrueUnit``, its drives measured ``positions``.

    Attributes
    ----------
    study : with the unit's own numbers, its disk rigid and its contacts after Palmgren.
    positions : one per position.
    bench : how it is measured.
    """

    study: Study
    positions: tuple[Position, ...]
    bench: Bench

    def angles(self, effects: Sequence[Candidate] = (), values: Sequence[float] = ()) -> list[Real]:
        """Angle [arcmin] at the rows of every position with effects of the library, before noise.

        Raises
        ------
        UnsoundError : an equilibrium was not found.
        """
        by_name = {effect.name: tuple(own_values) for effect, own_values in Model(tuple(effects)).split(values)}
        try:
            return [position.angle(by_name) for position in self.positions]
        except NoBalanceError as error:
            raise UnsoundError(str(error)) from error

    def angles_outside(self, effect: Outside) -> list[Real]:
        """The same with an effect that the library lacks."""
        angles = []
        for position, ramp, crank in zip(self.positions, self.bench.ramps, self.bench.cranks, strict=True):
            curve = position.curve({}, (0.0, 0.0), NMM_PER_NM * float(np.max(np.abs(ramp.turns))))

            def angle_at(torque: Real, curve: Curve = curve) -> Real:
                return curve.at(NMM_PER_NM * np.asarray(torque)) / RAD_PER_ARCMIN

            span = float(np.ptp(angle_at(ramp.torque)))
            angles.append(effect(Track(ramp, angle_at, span, float(np.radians(crank)))))
        return angles

    @staticmethod
    def knows(name: str) -> bool:
        """Whether the simulator has an effect of the library."""
        return name in EFFECTS


def machined(study: Study, sampled: Errors, rng: np.random.Generator) -> Errors:
    """A sample with every toleranced dimension drawn anew, as one lot of a shop has it: even within its limits [um].

    Half of each deviation is the lot's, the other half each element's own; neighbours are not alike.
    """
    deviations = {}
    for name in LOTS:
        tolerance, shape = getattr(study.tolerances, name), np.shape(getattr(sampled, name))
        low, high = tolerance.limits_um
        share = 0.5 * rng.uniform() + 0.5 * rng.uniform(size=shape) if len(shape) > 1 else rng.uniform(size=shape)
        deviations[name] = tolerance.allowance_um + low + (high - low) * share
    return replace(sampled, **deviations)


def rigid_unit(study: Study, dimensions: Errors, bench: Bench) -> RigidUnit:
    """A unit of a study of rigid disks, with errors [um] of one sample."""
    places = encoder_places(bench, study.design.cycloid.lobes)
    at_output = bench.locked != "output"
    turns = 1.0 if at_output else float(study.design.cycloid.lobes)
    positions = tuple(
        Position(rigid_drive(study.design, dimensions, crank), _loading(ramp), turns, float(encoder_place), at_output)
        for crank, ramp, encoder_place in zip(bench.cranks, bench.ramps, places, strict=True)
    )
    return RigidUnit(study, positions, bench)


def rigid_drive(design: Design, dimensions: Errors, crank_deg: float) -> RigidDrive:
    """The drive of a design with errors [um] of one sample, its disk's size read on the diameter."""
    gear, crank = design.cycloid, np.radians(crank_deg)
    errors = {name: MM_PER_UM * np.asarray(values[0]) for name, values in vars(dimensions).items()}
    clockwise = np.exp(-2j * np.pi * np.arange(gear.pins) / gear.pins)
    runout = errors["bore_runout_amplitude"] * np.exp(1j * dimensions.bore_runout_phase[0])
    flank = Flank(
        pins=gear.pins,
        circle_radius=gear.pin_circle_radius_mm,
        eccentricity=gear.eccentricity_mm,
        taken_off=ON_DIAMETER * (errors["disk_profile"] + errors["lobe_profile"]),
        turned=errors["lobe_pitch"] / (gear.pin_circle_radius_mm - gear.pin_radius_mm),
        centre=complex(runout),
    )
    thrown = gear.eccentricity_mm + errors["eccentricity"] + 1j * errors["eccentric_phase"]
    bearing = design.bearing
    return RigidDrive(
        crank=float(crank),
        flank=flank,
        pin_centres=(gear.pin_circle_radius_mm + errors["pin_radial"] + 1j * errors["pin_tangential"]) * clockwise,
        pin_growth=errors["pin_radius"],
        pin_contact=LineContact(design.disk.thickness_mm),
        eccentric=complex(thrown * np.exp(1j * crank)),
        bearing=Bearing(
            bearing.stiffness_N_per_mm_power,
            bearing.exponent,
            MM_PER_UM * bearing.clearance_um + float(errors["bearing_clearance"]),
        ),
        output=OUTPUTS[design.model_dump()["output"]["mechanism"]](design, errors["roller_diameter"]),
    )


def _slides(design: Any, diameter: Real) -> Output:
    output = design.output
    reach = np.linspace(output.outer_station_mm, output.inner_station_mm, output.rollers // 8)
    contact = LineContact(output.roller_length_mm, interfaces=2)
    return CrossedSlides(contact, float(np.radians(output.slide_angle_deg)), reach, -HALF * diameter)


def _holes(design: Any, diameter: Real) -> Output:
    output = design.output
    angle = np.radians(output.phase_deg) - 2 * np.pi * np.arange(output.pins) / output.pins
    room = design.cycloid.eccentricity_mm + MM_PER_UM * output.hole_clearance_um - HALF * diameter
    return PinsInHoles(LineContact(design.disk.thickness_mm), angle, output.pin_circle_radius_mm, room)


OUTPUTS: Mapping[str, Callable[[Any, Real], Output]] = {"roller_plate": _slides, "pin_in_hole": _holes}
"""By the mechanism of a design: its output with errors of the diameters [mm]."""


def _loading(ramp: Ramp) -> Loading:
    warmer = np.asarray(ramp.states(wears=False)[1].temperature_rise, float)
    return Loading(ramp.torque, ramp.begin + ramp.time, ramp.turns, ramp.leg, ramp.cycle, warmer, ramp.travelled)
