"""Parts of a unit as a shop makes them, drawn by seed, and the files in which a user would describe them."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import Real
from tests.validation.blind.compliant_drive.statics import UM, Disk, PowerLaw, coupled_compliance

CALIBRATED = "disk.thickness_mm", "bearing.stiffness_N_per_mm_power"
"""Numbers of the design that the files state wrongly, within the stated range."""
OFF, RANGE = (1.03, 1.18), 1.25
"""Factor, up or down, by which they are off; factor of the range that is stated."""
UNKNOWN_LOT = 0.4
"""Width of the tolerances of units that were not measured, in those of the study."""
MEASURED_UM = 0.3
"""Standard deviation of a measured dimension, of the part that all of a kind share and of each."""
STEEL = 206e3
"""Young's modulus [MPa]."""
PALMGREN_MM, BY_FORCE, BY_LENGTH = 3.84e-5, 0.9, 0.8
"""Approach of steel cylinders 3.84e-5 Q^0.9 / L^0.8: Palmgren, Ball and Roller Bearing Engineering (1959). It gives the
size of a contact's law at its usual force; the power is drawn."""
COUPLED_SHARE = 0.25
"""Share of a half-plane's compliance that the web of an elastic disk has. The unit files state rigid disks. With all of
it one unit without an effect was named a torsion in series. On one unit the disk did less than half of the work of a
finite-element disk, so the share is a choice and no validation of elastic disks."""
POWERS, LAW_OFF = (1.02, 1.16), 0.08
"""Powers of the law, and deviation of the logarithm of its size."""


@dataclass(frozen=True)
class Parts:
    """What a unit is made of.

    Attributes
    ----------
    design, study : as its files state them.
    errors : by name of a dimension, its deviation [um]: scalar, or one per element.
    factors : by key of the design, truth over what is stated.
    elastic : whether the disk is.
    known : whether the dimensions were measured.
    power, law_size : of the contacts' law; its size in Palmgren's at the usual force.
    """

    design: Mapping[str, Any]
    study: Mapping[str, Any]
    errors: Mapping[str, Real]
    factors: Mapping[str, float]
    elastic: bool
    known: bool
    power: float
    law_size: float

    @property
    def rated(self) -> float:
        """Rated torque [N m]."""
        return float(self.design["cycloid"]["rated_torque_Nm"])

    def _law(self, usual: float, length: float) -> PowerLaw:
        approach = self.law_size * PALMGREN_MM * usual**BY_FORCE / length**BY_LENGTH / UM
        return PowerLaw(usual / approach**self.power, self.power)

    def disk(self, crank_deg: float) -> Disk:
        """The drive at a crank angle [deg]."""
        gear, output, errors = self.design["cycloid"], self.design["output"], self.errors
        n, radius, throw = gear["pins"], gear["pin_circle_radius_mm"], gear["eccentricity_mm"]
        thickness = self.design["disk"]["thickness_mm"] * self.factors[CALIBRATED[0]]
        spring = self.design["bearing"]["stiffness_N_per_mm_power"] * self.factors[CALIBRATED[1]] * UM
        crank, clockwise = np.radians(crank_deg), -2 * np.pi * np.arange(n) / n
        pins = (radius + UM * errors["pin_radial"] + 1j * UM * errors["pin_tangential"]) * np.exp(1j * clockwise)
        at = clockwise + crank / (n - 1)
        locus = radius * np.exp(1j * at) - throw * np.exp(1j * n * at)
        slope = 1j * (radius * np.exp(1j * at) - n * throw * np.exp(1j * n * at))
        normals = np.angle(-1j * slope)
        flank = locus - gear["pin_radius_mm"] * np.exp(1j * normals)
        depth = radius - self.design["disk"]["bore_radius_mm"]
        coupled = np.zeros((n, n))
        if self.elastic:
            coupled = coupled_compliance(flank, normals, thickness, STEEL, depth, 0.12 * gear["pin_radius_mm"])
            coupled *= COUPLED_SHARE
        usual = 1e3 * self.rated / (0.3 * n * radius)
        return Disk(
            crank=float(crank),
            radius=radius,
            eccentricity=throw,
            taken_off=UM * 0.5 * (errors["disk_profile"] + errors["lobe_profile"]),
            pins=pins,
            growth=UM * errors["pin_radius"],
            throw=throw + UM * float(errors["eccentricity"]),
            holes=np.radians(output["phase_deg"]) - 2 * np.pi * np.arange(output["pins"]) / output["pins"],
            hole_circle=output["pin_circle_radius_mm"],
            room=throw + UM * output["hole_clearance_um"] - UM * 0.5 * errors["roller_diameter"],
            at_pins=self._law(usual, thickness),
            at_holes=self._law(3e3 * self.rated / (output["pins"] * output["pin_circle_radius_mm"]), thickness),
            bearing=(spring, 0.0),
            compliance=coupled,
        )


def drawn_parts(rng: np.random.Generator, designs: Mapping[str, Any], elastic: bool | None = None) -> Parts:
    """Parts of a drive of drawn proportions.

    Parameters
    ----------
    designs : "design" and "study" as a user's files have them, of a drive with pins in holes.
    elastic : or drawn.
    """
    elastic = bool(rng.random() < 0.35) if elastic is None else elastic
    known = bool(rng.random() < 0.5)
    design, study = copy.deepcopy(dict(designs["design"])), copy.deepcopy(dict(designs["study"]))
    size = _proportions(design, rng)
    width = size * (1.0 if known else UNKNOWN_LOT)
    for tolerance in study["tolerances"].values():
        for key in [key for key in tolerance if key.endswith("_um")]:
            tolerance[key] *= size if key == "allowance_um" else width
    design["title"] = f"Drive of ratio {design['cycloid']['pins'] - 1}"
    design["provenance"] = {key: {"status": "chosen", "reason": "drawn"} for key in design["provenance"]}
    for key in CALIBRATED:
        section, name = key.split(".")
        value, reason = design[section][name], "fitted to another unit"
        low, high = value / RANGE, value * RANGE
        design["provenance"][key] = {"status": "calibrated", "reason": reason, "plausible": [low, high]}
    study["reduce"] = {**study["reduce"], "disk": "rigid"}
    study["cycle"].pop("loaded_angles", None)  # of the drive that was copied: it may share a factor with these lobes
    study["title"] = design["title"]
    study.pop("description", None)
    return Parts(
        design=design,
        study=study,
        errors={name: _drawn(study["tolerances"], name, design, rng) for name in study["tolerances"]},
        factors={key: float(np.exp(rng.choice([-1, 1]) * rng.uniform(*np.log(OFF)))) for key in CALIBRATED},
        elastic=elastic,
        known=known,
        power=float(rng.uniform(*POWERS)),
        law_size=float(np.exp(LAW_OFF * rng.standard_normal())),
    )


def _proportions(design: dict[str, Any], rng: np.random.Generator) -> float:
    """Draw the proportions of a design; its radius in that of the design at hand."""
    pins, old = int(rng.choice([12, 16, 20, 24, 30, 40])), design["cycloid"]["pin_circle_radius_mm"]
    radius = round(float(rng.uniform(35, 80)), 1)
    size: float = radius / old
    throw = round(float(rng.uniform(0.5, 0.72)) * radius / pins, 2)
    pin = round(0.5 * 2 * np.pi * radius / pins * float(rng.uniform(0.4, 0.52)), 2)
    pin = min(pin, round(0.085 * radius, 2))
    thickness = round(float(rng.uniform(0.16, 0.24)) * radius, 1)
    torque = round(400 * size**2 * thickness / 15, 0)
    design["cycloid"].update(
        pins=pins, pin_radius_mm=pin, pin_circle_radius_mm=radius, eccentricity_mm=throw, rated_torque_Nm=torque
    )
    design["housing"]["outer_diameter_mm"] = round(2 * radius + 4 * pin + 0.2 * radius, 1)
    design["disk"].update(thickness_mm=thickness, bore_radius_mm=round(0.3 * radius, 1))
    design["bearing"]["stiffness_N_per_mm_power"] = round(6e5 * thickness / 15, -3)
    design["output"].update(
        pins=int(rng.integers(6, 11)),
        pin_radius_mm=round(0.07 * radius, 2),
        pin_circle_radius_mm=round(0.6 * radius, 1),
    )
    design.pop("operation", None)
    design["provenance"] = {key: value for key, value in design["provenance"].items() if "operation" not in key}
    return size


def _drawn(tolerances: Mapping[str, Any], name: str, design: Mapping[str, Any], rng: np.random.Generator) -> Real:
    """Deviations [um] of a dimension: scalar, or one per element."""
    pins = design["cycloid"]["pins"]
    counts = {
        "lobe_profile": pins - 1,
        "pin_radial": pins,
        "pin_tangential": pins,
        "pin_radius": pins,
        "roller_diameter": design["output"]["pins"],
    }
    tolerance, shape = tolerances[name], (counts[name],) if name in counts else ()
    low, high = tolerance["lower_um"], tolerance["upper_um"]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    if tolerance["distribution"] == "uniform":
        deviation = rng.uniform(-1, 1, shape)
    elif tolerance["distribution"] == "triangular":
        deviation = 0.5 * (rng.uniform(-1, 1, shape) + rng.uniform(-1, 1, shape))
    else:
        deviation = rng.standard_normal(shape)
        if "correlation_length_mm" in tolerance and shape:
            angle = 2 * np.pi * np.arange(shape[0]) / shape[0]
            apart = np.abs(np.exp(1j * angle[:, None]) - np.exp(1j * angle)) * design["cycloid"]["pin_circle_radius_mm"]
            kernel = np.exp(-apart / tolerance["correlation_length_mm"]) + 1e-9 * np.eye(shape[0])
            deviation = np.linalg.cholesky(kernel) @ deviation
        deviation = np.clip(deviation / 3, -1, 1)
    return np.asarray(tolerance.get("allowance_um", 0.0) + middle + half * deviation)


def written_files(parts: Parts, name: str, offset: str, angle_step: float, rng: np.random.Generator) -> dict[str, str]:
    """By name of a file its text: design, study, unit and, where they were measured, dimensions."""
    unit = {
        "title": f"Unit {name}",
        "design": "design.toml",
        "study": "study.toml",
        "locked": "input",
        "offset": offset,
        "as_measured": "dimensions.toml" if parts.known else "unknown",
        "instrument": {"angle_resolution_arcmin": angle_step},
    }
    files = {"design.toml": _toml(parts.design), "unit.toml": _toml(unit)}
    files["study.toml"] = _toml({**parts.study, "design": "design.toml"})
    if parts.known:
        stated = {}
        for key, value in parts.errors.items():
            shared, own = rng.standard_normal(), rng.standard_normal(value.shape)
            measured = value + MEASURED_UM * (shared + own * (value.ndim > 0))
            stated[key] = np.round(measured, 1).tolist()
        files["dimensions.toml"] = _toml(stated)
    return files


def _toml(table: Mapping[str, Any], path: str = "") -> str:
    """TOML of nested tables, quoted keys throughout."""
    plain = [f'"{key}" = {_value(value)}' for key, value in table.items() if not isinstance(value, Mapping)]
    parts = ["\n".join(plain) + "\n"] if plain else []
    for key, value in table.items():
        if isinstance(value, Mapping):
            inner = f'{path}."{key}"' if path else f'"{key}"'
            parts.append(f"[{inner}]\n" + _toml(value, inner))
    return "\n".join(parts)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)
