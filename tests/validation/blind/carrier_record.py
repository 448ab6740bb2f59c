"""Records of an RV reducer of the second simulator: a pair of encoders, held torques in both senses, temperatures."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, PchipInterpolator

from pipeline.arrays import Complex, Real
from tests.validation.blind.rigid_drive.carrier import CarrierDrive, Gears
from tests.validation.blind.rigid_drive.drive import Bearing, NoBalanceError
from tests.validation.blind.rigid_drive.flank import Flank, LineContact

NODES = (0.004, 0.02, 0.08, 0.3, 0.65, 1.06)
"""Net torques of each sense at which the drive is solved, over the largest one held."""
LEAST_SOLVED = 0.95
"""Share of the places of a record that must balance."""
RAD_PER_ARCMIN = np.pi / 10800
"""Radians of a minute of arc."""
ZONE_UM = 3.5
"""Diameter of the zone of each crank hole in disks and carrier, of the study `rv_80e`."""
CLEARANCE_UM = (2.0, 5.0)
"""Clearance of a crank's bearings, of the same."""
UM = 1e-3
"""Millimetres of a micrometre."""


@dataclass(frozen=True)
class Bench:
    """How a reducer is turned.

    Attributes
    ----------
    torques : held [N m].
    span_deg : of the output.
    places : at which the drive is solved.
    rows : of a pass.
    passes : of each torque, sense and temperature.
    temperatures : [deg C].
    noise_arcsec, step_arcsec : of the output's encoder.
    """

    torques: tuple[float, ...] = (-600.0, -200.0, 0.0, 200.0, 600.0)
    span_deg: float = 36.0
    places: int = 97
    rows: int = 480
    passes: int = 2
    temperatures: tuple[float, ...] = (22.0, 45.0)
    noise_arcsec: float = 0.5
    step_arcsec: float = 0.1


@dataclass(frozen=True)
class Truth:
    """What a reducer has that its record may show.

    Attributes
    ----------
    unlike : stiffness of the first crank's bearings over that of the others.
    friction : of the output [N m], and in proportion to the torque.
    friction_wave, wave_order : share by which the friction varies, so often per turn of the output.
    warm_friction : share of the friction that is lost from the lowest to the highest temperature.
    warm_zero_arcsec : by which the zero moves from the lowest to the highest temperature.
    outside_arcsec, outside_order : error in proportion to the torque at an order that is no shaft's.
    """

    unlike: float = 1.0
    friction: float = 8.0
    load_friction: float = 0.01
    friction_wave: float = 0.0
    wave_order: float = 40.0
    warm_friction: float = 0.0
    warm_zero_arcsec: float = 0.0
    outside_arcsec: float = 0.0
    outside_order: float = 57.0


def reducer(rng: np.random.Generator, truth: Truth) -> CarrierDrive:
    """An RV-80E with errors of its parts in micrometres, each from a normal distribution that is cut at two sigma.

    Crank holes lie anywhere in zones of the diameter that the study `rv_80e` states, and the clearance of each crank's
    bearings is as wide as there: wider zones, or tighter bearings, are no reducer of that study.
    """
    pins, circle, thrown, cranks, disks = 40, 77.5, 1.5, 3, 2

    def drawn(sigma: float, *shape: int) -> Real:
        return sigma * UM * np.clip(rng.standard_normal(shape), -2, 2)

    lobes = pins - 1
    flanks = [
        Flank(pins, circle, thrown, 4.0 * UM + drawn(1.0, lobes), drawn(1.5, lobes) / circle, 0j) for _ in range(disks)
    ]
    clockwise = np.exp(-2j * np.pi * np.arange(pins) / pins)
    on_circle = 42.0 * np.exp(-2j * np.pi * np.arange(cranks) / cranks)

    def scattered(sigma: float, *shape: int) -> Complex:
        return drawn(sigma, *shape) + 1j * drawn(sigma, *shape)

    def in_zone(*shape: int) -> Complex:
        radius = 0.5 * ZONE_UM * UM
        place: Complex = radius * np.sqrt(rng.uniform(size=shape)) * np.exp(2j * np.pi * rng.uniform(size=shape))
        return place

    eccentrics = np.exp(2j * np.pi * np.arange(disks) / disks)[:, None]
    clearance = UM * rng.uniform(*CLEARANCE_UM, size=cranks)
    return CarrierDrive(
        flanks,
        (circle + scattered(2.0, pins)) * clockwise,
        drawn(0.5, pins),
        LineContact(15.0),
        on_circle + in_zone(cranks),
        on_circle + in_zone(disks, cranks),
        eccentrics * (thrown + scattered(1.0, disks, cranks)),
        bearings=[Bearing(87e3 * (truth.unlike if j == 0 else 1.0), 1.0, float(clearance[j])) for j in range(cranks)],
        gears=Gears(
            *(10, 38, 42.0, 20.0 * UM, 140e3),
            drawn(4.0, cranks),
            2 * np.pi * rng.uniform(size=cranks),
            float(np.abs(drawn(3.0, 1))[0]),
        ),
    )


Curves = tuple[Real, Real, Real]


def solved(drive: CarrierDrive, bench: Bench) -> Curves:
    """Places [rad], net torques [N m] and errors (n_places, n_torques) [rad] of a reducer without friction.

    Raises
    ------
    NoBalanceError
        If more than a few places have none.
    """
    top = max(abs(torque) for torque in bench.torques)
    shares = np.array(NODES)
    places = np.radians(np.linspace(0, bench.span_deg, bench.places))
    torques = top * np.concatenate([-shares[::-1], shares])
    errors = np.full((len(places), len(torques)), np.nan)
    for row, place in zip(errors, places, strict=True):
        with suppress(NoBalanceError):  # a pin at the end of a lobe, where two flanks meet: the neighbours say as much
            back = drive.error(float(place), (-1e3 * top * shares[::-1]).tolist())
            forth = drive.error(float(place), (1e3 * top * shares[::-1]).tolist())
            row[:] = np.concatenate([back, forth[::-1]])
    is_solved = np.all(np.isfinite(errors), axis=1)
    if np.mean(is_solved) < LEAST_SOLVED:
        raise NoBalanceError(f"no balance at {np.sum(~is_solved)} of {len(places)} places")
    return places[is_solved], torques, errors[is_solved]


def record(ratio: float, curves: Curves, bench: Bench, truth: Truth, rng: np.random.Generator) -> pd.DataFrame:
    """What the bench writes: time, both encoders, torque at the output, temperature, and the number of the repeat."""
    places, torques, errors = curves
    along = PchipInterpolator(torques, errors, axis=1)
    top, parts, clock = max(abs(torque) for torque in bench.torques), [], 0.0
    cold, hot = min(bench.temperatures), max(bench.temperatures)
    for repeat in range(bench.passes):
        for temperature in bench.temperatures:
            warm = (temperature - cold) / max(hot - cold, 1e-9)
            for torque in bench.torques:
                for sense in (1, -1):
                    edge = 0.002 * bench.span_deg
                    place = np.radians(np.linspace(edge, bench.span_deg - edge, bench.rows))[::sense]
                    wave = 1 + truth.friction_wave * np.cos(truth.wave_order * place)
                    friction = (truth.friction * wave + truth.load_friction * abs(torque)) * (
                        1 - truth.warm_friction * warm
                    )
                    net = torque - sense * friction
                    nodes = np.array([float(t) for t in np.linspace(net.min(), net.max(), 5)])
                    spline = CubicSpline(places, along(nodes), axis=0)(place)
                    if np.ptp(nodes) > 1e-9:
                        share = (net - nodes[0]) / (nodes[-1] - nodes[0]) * (len(nodes) - 1)
                        low = np.clip(share.astype(int), 0, len(nodes) - 2)
                        rows = np.arange(len(place))
                        error = spline[rows, low] + (share - low) * (spline[rows, low + 1] - spline[rows, low])
                    else:
                        error = spline[:, 0]
                    arcsec = error / RAD_PER_ARCMIN * 60 + warm * truth.warm_zero_arcsec
                    arcsec += truth.outside_arcsec * torque / top * np.cos(truth.outside_order * place)
                    arcsec += bench.noise_arcsec * rng.standard_normal(len(place))
                    output = np.degrees(place) * 3600 + arcsec
                    output = bench.step_arcsec * np.round(output / bench.step_arcsec) / 3600
                    parts.append(
                        pd.DataFrame(
                            {
                                "time_s": np.round(clock + 0.05 * np.arange(len(place)), 3),
                                "input_deg": np.round(ratio * np.degrees(place), 5),
                                "output_deg": np.round(output, 7),
                                "torque_Nm": np.round(torque + 0.5 * rng.standard_normal(len(place)), 2),
                                "temperature_C": np.round(temperature + 0.2 * rng.standard_normal(len(place)), 1),
                                "cycle": repeat,
                            }
                        )
                    )
                    clock += 0.05 * len(place) + 5.0
    return pd.concat(parts, ignore_index=True)


def write_record(folder: Path, table: pd.DataFrame, drive: Sequence[str] = ()) -> Path:
    """A unit of a record, of the design ``rv_80e`` unless other lines say what drive it is."""
    folder.mkdir(parents=True)
    lines = drive or ('design = "rv_80e"', 'study = "rv_80e"', 'as_measured = "unknown"')
    text = [
        'title = "RV-80E of the second simulator"',
        'source = "generated: no measurement"',
        *lines,
        'locked = "neither"',
        'offset = "common"',
    ]
    (folder / "unit.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
    table.to_csv(folder / "data.csv", index=False)
    return folder
