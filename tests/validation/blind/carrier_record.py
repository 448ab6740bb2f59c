"""Records of an RV reducer of the second simulator: a pair of encoders, held torques in both senses, temperatures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, PchipInterpolator

from pipeline.arrays import Complex, Real
from tests.validation.blind.rigid_drive.carrier import CarrierDrive, Gears
from tests.validation.blind.rigid_drive.drive import Bearing
from tests.validation.blind.rigid_drive.flank import Flank, LineContact

NODES = (0.004, 0.02, 0.08, 0.3, 0.65, 1.06)
"""Net torques of each sense at which the drive is solved, over the largest one held."""
RAD_PER_ARCMIN = np.pi / 10800
"""Radians of a minute of arc."""
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


def reducer(rng: np.random.Generator, truth: Truth, perfect: bool = False) -> CarrierDrive:
    """An RV-80E with errors of its parts in micrometres, each from a normal distribution that is cut at two sigma."""
    pins, circle, thrown, cranks, disks = 40, 77.5, 1.5, 3, 2

    def drawn(sigma: float, *shape: int) -> Real:
        size = 0.0 if perfect else sigma * UM
        return size * np.clip(rng.standard_normal(shape), -2, 2)

    lobes = pins - 1
    room = 0.0 if perfect else 4.0 * UM
    flanks = [
        Flank(pins, circle, thrown, room + drawn(1.0, lobes), drawn(1.5, lobes) / circle, 0j) for _ in range(disks)
    ]
    clockwise = np.exp(-2j * np.pi * np.arange(pins) / pins)
    on_circle = 42.0 * np.exp(-2j * np.pi * np.arange(cranks) / cranks)

    def scattered(sigma: float, *shape: int) -> Complex:
        return drawn(sigma, *shape) + 1j * drawn(sigma, *shape)

    eccentrics = np.exp(2j * np.pi * np.arange(disks) / disks)[:, None]
    clearance = 0.0 if perfect else 1.0 * UM
    return CarrierDrive(
        flanks,
        (circle + scattered(2.0, pins)) * clockwise,
        drawn(0.5, pins),
        LineContact(15.0),
        on_circle + scattered(2.0, cranks),
        on_circle + scattered(2.0, disks, cranks),
        eccentrics * (thrown + scattered(1.0, disks, cranks)),
        bearings=[Bearing(87e3 * (truth.unlike if j == 0 else 1.0), 1.0, clearance) for j in range(cranks)],
        gears=Gears(
            *(10, 38, 42.0, 0.0 if perfect else 20.0 * UM, 140e3),
            drawn(4.0, cranks),
            2 * np.pi * rng.uniform(size=cranks),
            float(np.abs(drawn(3.0, 1))[0]),
        ),
    )


def solved(drive: CarrierDrive, bench: Bench) -> tuple[Real, Real, Real]:
    """Places [rad], net torques [N m] and errors (n_places, n_torques) [rad] of a reducer without friction."""
    top = max(abs(torque) for torque in bench.torques)
    shares = np.array(NODES)
    places = np.radians(np.linspace(0, bench.span_deg, bench.places))
    torques = top * np.concatenate([-shares[::-1], shares])
    errors = []
    for place in places:
        back = drive.error(float(place), (-1e3 * top * shares[::-1]).tolist())
        forth = drive.error(float(place), (1e3 * top * shares[::-1]).tolist())
        errors.append(np.concatenate([back, forth[::-1]]))
    return places, torques, np.array(errors)


def record(drive: CarrierDrive, bench: Bench, truth: Truth, rng: np.random.Generator) -> pd.DataFrame:
    """What the bench writes: time, both encoders, torque at the output, temperature, and the number of the repeat."""
    places, torques, errors = solved(drive, bench)
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
                    curves = CubicSpline(places, along(nodes), axis=0)(place)
                    if np.ptp(nodes) > 1e-9:
                        share = (net - nodes[0]) / (nodes[-1] - nodes[0]) * (len(nodes) - 1)
                        low = np.clip(share.astype(int), 0, len(nodes) - 2)
                        rows = np.arange(len(place))
                        error = curves[rows, low] + (share - low) * (curves[rows, low + 1] - curves[rows, low])
                    else:
                        error = curves[:, 0]
                    arcsec = error / RAD_PER_ARCMIN * 60 + warm * truth.warm_zero_arcsec
                    arcsec += truth.outside_arcsec * torque / top * np.cos(truth.outside_order * place)
                    arcsec += bench.noise_arcsec * rng.standard_normal(len(place))
                    output = np.degrees(place) * 3600 + arcsec
                    output = bench.step_arcsec * np.round(output / bench.step_arcsec) / 3600
                    parts.append(
                        pd.DataFrame(
                            {
                                "time_s": np.round(clock + 0.05 * np.arange(len(place)), 3),
                                "input_deg": np.round(drive.ratio * np.degrees(place), 5),
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
    tables = [line for line in text if line.startswith("[")]
    assert not tables
    (folder / "unit.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
    table.to_csv(folder / "data.csv", index=False)
    return folder
