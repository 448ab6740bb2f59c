"""The second simulator of blind units against closed forms and against the model, which shares no code with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.identification.fitting.problem import candidates
from pipeline.model.load_history.backbone import backbone, torque_levels
from pipeline.model.load_history.turning_crank import CurvesOverCrank
from pipeline.mounting import drive_of
from pipeline.sampling.errors import Errors, draw
from tests.validation.blind.bench import draw_bench
from tests.validation.blind.catalogue import catalogue, no_compliance
from tests.validation.blind.rigid_drive.drive import Bearing, Curve
from tests.validation.blind.rigid_drive.effects import EFFECTS, NMM_PER_NM, RAD_PER_ARCMIN
from tests.validation.blind.rigid_drive.flank import LineContact
from tests.validation.blind.rigid_drive.readings import SLOW_SHARE, readings
from tests.validation.blind.rigid_drive.train import Train, locked_torques
from tests.validation.blind.rigid_unit import machined, rigid_drive, rigid_unit
from tests.validation.blind.true_unit import true_unit

ROOT = Path(__file__).parents[3]


def reducer(name: str):
    return next(design_reducer for design_reducer in catalogue(ROOT) if design_reducer.name == name)


def without_errors(study) -> Errors:
    sampled = draw(study, 0, 1)
    return Errors(**{name: np.zeros_like(values) for name, values in vars(sampled).items()})


def test_each_contact_in_closed_form_once_nothing_else_yields():
    """No gaps, a rigid bearing: torque = sum of arm (arm angle / k)^(1/0.9) at the pins and at each slide."""
    study = reducer("paper").rigid_truth
    drive = rigid_drive(study.design, without_errors(study), 33.0)
    drive = replace(drive, bearing=Bearing(1e13, 1.0, 0.0))
    curve = drive.curve(12e3)
    gear, output = study.design.cycloid, study.design.output
    beta = -2 * np.pi * np.arange(gear.pins) / gear.pins - np.radians(33.0)
    shortening = gear.eccentricity_mm * gear.pins / gear.pin_circle_radius_mm
    arm = gear.eccentricity_mm * (gear.pins - 1) * np.sin(beta)
    arm = arm / np.sqrt(1 + shortening**2 - 2 * shortening * np.cos(beta))
    slides = np.repeat(np.linspace(output.outer_station_mm, output.inner_station_mm, output.rollers // 8), 2)
    groups = (
        (np.abs(arm[arm < 0]), 3.84e-5 / study.design.disk.thickness_mm**0.8),
        *[(slides, 2 * 3.84e-5 / output.roller_length_mm**0.8)] * 2,
    )
    # a sum of powers of one angle: T = (angle / k)^(1/0.9) sum arm^(1 + 1/0.9)
    angle = sum(k * (6e3 / np.sum(arms ** (1 + 1 / 0.9))) ** 0.9 for arms, k in groups)
    assert curve.at(np.array([6e3]))[0] == pytest.approx(angle, rel=2e-3)


def test_the_play_of_a_smaller_disk_is_that_of_the_publication():
    """0.0632 arcmin for each um of disk size at every crank angle, by the linear programme of the pins' gaps."""
    study = reducer("paper").rigid_truth
    drive = rigid_drive(study.design, replace(without_errors(study), disk_profile=np.array([5.0])), 41.0)
    curve = replace(drive, bearing=Bearing(1e12, 1.0, 0.0)).curve(1e3)
    play = np.diff(curve.angle[len(curve.angle) // 2 - 1 :][:2])[0] / RAD_PER_ARCMIN
    assert play == pytest.approx(5 * 0.0632, rel=0.01)


@pytest.mark.parametrize("name", ["paper", "holes_19"])
def test_two_simulators_of_one_rigid_drive_agree(name):
    """Equal dimensions and Palmgren's law; the model is linear in the pose, which is worth a part in 200."""
    study = reducer(name).rigid_truth
    dimensions = draw(study, 7, 8)
    crank, top = study.cycle.crank_deg[1], NMM_PER_NM * study.design.cycloid.rated_torque_Nm
    curve = rigid_drive(study.design, dimensions, crank).curve(top)
    loose = assembly.bearing_clearance(study.design, dimensions.bearing_clearance)
    model = drive_of(study, crank, None, assembly.errors(dimensions), loose)
    fine = backbone(model, torque_levels(60, 1.0))
    is_loaded = np.abs(fine.torque) > 1e-3 * top
    difference = (curve.at(fine.torque) - fine.angle[0])[is_loaded]
    assert np.max(np.abs(difference)) < 5e-3 * np.ptp(fine.angle)


VALUES = {
    "angle_drift": (60.0,),
    "bearing_clearance": (5.0,),
    "coulomb": (0.8,),
    "creep": (0.01, 20.0),
    "directional_load_friction": (0.2, 0.08),
    "eccentricity_error": (4.0,),
    "encoder_eccentricity": (60.0, -90.0),
    "flank_runout": (12.0, -9.0),
    "flank_wear": (6.0,),
    "load_friction": (0.15,),
    "output_torsion": (0.02,),
    "ovality_2": (4.0, 3.0),
    "ovality_3": (4.0, -3.0),
    "pin_circle_error": (5.0,),
    "pin_circle_runout": (12.0, 9.0),
    "pin_radius_error": (-3.0,),
    "preload": (9.0,),
    "presliding": (1.0, 0.8),
    "run_in": (6.0, 1.5),
    "seat_compliance": (5e-4,),
    "softening_compliance": (0.03, 10.0),
    "thermal_growth": (15.0,),
    "torque_gain": (0.1,),
    "torque_zero": (2.0,),
}


@pytest.fixture(scope="module")
def twins():
    """One unit in both simulators, at one position of the same bench."""
    study = reducer("holes_19").rigid_truth
    bench = draw_bench(np.random.default_rng(12), study.cycle.crank_deg[:3], study.design.cycloid.rated_torque_Nm)
    ramp = bench.ramps[0]
    warm = replace(ramp, temperature=20.0 + 6.0 * np.arange(ramp.n_cycles))
    bench = replace(bench, cranks=bench.cranks[:1], ramps=(warm,), offset=bench.offset[:1])
    sampled, compliances = draw(study, 3, 4), no_compliance(study, bench.cranks)
    return rigid_unit(study, sampled, bench), true_unit(
        study, (), (), assembly.errors(sampled), 0.0, compliances, bench
    )


OFTEN = ("directional_load_friction", "load_friction", "pin_circle_error", "preload", "creep")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.attack] * (n not in OFTEN)) for n in sorted(VALUES)]
)
def test_an_effect_is_the_same_in_both(twins, name):
    """The change of the curves, each written from the effect's description alone."""
    changes = []
    for unit in twins:
        reference, affected = unit.angles(), unit.angles([candidates()[name]], VALUES[name])
        changes_found = [with_it - without_effect for with_it, without_effect in zip(affected, reference, strict=True)]
        changes.append(np.concatenate([rows - rows.mean() for rows in changes_found]))
    model_value, models = changes
    assert np.std(models) > 0.02
    # cells within the play's jump differ by where the jump is; the rest by the forms of the two
    assert np.sqrt(np.median((model_value - models) ** 2)) < 0.03 * np.std(models)


def test_every_effect_has_a_comparison():
    assert set(VALUES) == set(EFFECTS) <= set(candidates())


def test_a_contact_in_a_soft_seat_gives_way_as_both_together():
    contact = LineContact(8.0, compliance=2e-5)
    force = np.array([1e-3, 1.0, 300.0, 4e4])
    approach = 3.84e-5 * force**0.9 / 8**0.8 + 2e-5 * force
    assert contact.force(approach) == pytest.approx(force, rel=1e-10)
    step = 1e-6 * approach
    slope = (contact.force(approach + step) - contact.force(approach - step)) / (2 * step)
    assert contact.stiffness(force) == pytest.approx(slope, rel=1e-5)
    work = np.array([np.trapezoid(contact.force(x := np.linspace(0, a, 4001)), x) for a in approach])
    assert contact.energy(contact.force(approach)) == pytest.approx(work, rel=1e-3)


def test_friction_keeps_what_its_limits_say():
    """After a rise to T and a fall by less than twice the friction the torque carried stays; then it lags by it."""
    train, torque = Train(friction=100.0, load_friction=0.1), np.array([1000.0, 900.0, 750.0, 400.0, -1000.0])
    straight = Curve(np.linspace(-2e3, 2e3, 40), np.linspace(-2e-3, 2e-3, 40))
    angle, carried_torque = train.walked(straight, torque)
    assert carried_torque == pytest.approx([900 / 1.1, 900 / 1.1, 900 / 1.1, 500 / 0.9, -900 / 1.1])
    assert angle == pytest.approx(1e-6 * carried_torque)
    sided = replace(train, drive_friction=0.15, backdrive_friction=0.05)
    _, carried_torque = sided.walked(straight, torque)
    assert carried_torque == pytest.approx([900 / 1.25, 900 / 1.25, 900 / 1.25, 500 / 0.85, -900 / 1.25])


def test_friction_in_proportion_to_the_load_stays_beside_bristles():
    """Bristles next to nothing leave the walk without them, at no load too."""
    sided = Train(friction=100.0, load_friction=0.1, drive_friction=0.15, backdrive_friction=0.05)
    torque = np.array([1000.0, 900.0, 750.0, 400.0, 0.0, -10.0, -1000.0, -700.0, -200.0, 0.0, 300.0])
    straight = Curve(np.linspace(-2e3, 2e3, 40), np.linspace(-2e-1, 2e-1, 40))
    _, reference = sided.walked(straight, torque)
    _, carried_torque = replace(sided, bristles=1e-3, reach=1e-6).walked(straight, torque)
    assert carried_torque == pytest.approx(reference, abs=0.5)


def test_what_its_bench_reads_has_the_noise_that_is_asked_for():
    read = readings(np.linspace(0.0, 40.0, 20000), 0.2, 0.05, np.random.default_rng(3))
    offset = read - np.linspace(0.0, 40.0, 20000)
    assert read / 0.05 == pytest.approx(np.round(read / 0.05))
    assert np.std(offset) == pytest.approx(np.hypot(0.2, 0.05 / np.sqrt(12)), rel=0.05)
    centred_offset = offset - offset.mean()
    assert np.mean(centred_offset[1:] * centred_offset[:-1]) > 0.3 * SLOW_SHARE**2 * 0.2**2  # neighbours are alike


def test_its_tolerances_lie_within_the_limits_of_the_study():
    study = reducer("holes_19").rigid_truth
    draws = [machined(study, draw(study, 1, 2), np.random.default_rng(seed)) for seed in range(30)]
    for name in ("pin_radial", "pin_tangential", "disk_profile", "eccentricity"):
        tolerance = getattr(study.tolerances, name)
        values = np.concatenate([np.ravel(getattr(variant, name)) for variant in draws]) - tolerance.allowance_um
        low, high = tolerance.limits_um
        assert low <= values.min() < low + 0.3 * (high - low)
        assert high - 0.3 * (high - low) < values.max() <= high


def test_both_simulators_turn_the_crank_of_a_locked_output_alike():
    """A run-out of the pin circle lets the motor feel 1 % less than the output, by virtual work.

    In the median over torques: where a pin comes to bear within the step of the derivative, single ones differ by 0.4 %
    of the torque.
    """
    study, start = reducer("holes_19").rigid_truth, 2.0
    gear, dimensions = study.design.cycloid, without_errors(study)
    angle = -2 * np.pi * np.arange(gear.pins) / gear.pins
    dimensions = replace(
        dimensions,
        pin_radial=10.0 * np.cos(angle)[None],
        pin_tangential=10.0 * np.sin(angle)[None],
        disk_profile=np.array([20.0]),
    )
    loose = assembly.bearing_clearance(study.design, dimensions.bearing_clearance)
    cranks = start + np.radians(np.linspace(-4.0, 2.0, 9))
    models = [drive_of(study, crank, None, assembly.errors(dimensions), loose) for crank in np.degrees(cranks)]
    curves = CurvesOverCrank.from_drives(models, [backbone(model, torque_levels(24, 1.0)) for model in models], cranks)
    locked = curves.locked_curve(start, -gear.lobes)
    nodes, most = np.arange(7), 2 * NMM_PER_NM * gear.rated_torque_Nm
    motor, output = locked_torques(
        lambda crank: rigid_drive(study.design, dimensions, float(np.degrees(crank))),
        start,
        -gear.lobes,
        locked.angle[nodes],
        most,
    )
    np.testing.assert_allclose(motor, locked.torque[nodes], rtol=0.015)  # the model is linear in the pose
    felt = (locked.torque / locked.carried_torque)[nodes] - 1
    assert np.all(felt < -0.008)
    assert np.median(motor / output - 1) == pytest.approx(np.median(felt), rel=0.1)
