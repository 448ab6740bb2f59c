"""Random designs of every output mechanism: what a file may say, far beyond what anybody has built."""

from __future__ import annotations

from math import pi, sin
from typing import Any

import numpy as np

from pipeline.config import Study, parse_design, parse_study
from pipeline.errors import InputError

SAMPLES = 3


def random_study(seed: int) -> Study:
    """The first valid study of a seed's random ones; 4 to 300 pins, 5 mm to a metre, rubber to steel, any bearing."""
    rng = np.random.default_rng([20260101, seed])
    while True:
        design = _design(rng)
        try:
            parsed = parse_design(design, f"design {seed}")
            return parse_study(_study(rng, design), f"random-{seed}", f"study {seed}", lambda _, parsed=parsed: parsed)
        except InputError:
            continue


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is even between two bounds."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _design(rng: np.random.Generator) -> dict[str, Any]:
    pins = round(_between(rng, 4, 300))
    circle = _between(rng, 5, 1000)
    eccentricity = float(rng.uniform(0.1, 0.95)) * circle / pins
    pin = float(rng.uniform(0.1, 0.95)) * circle * sin(pi / pins)
    root = circle - eccentricity - pin
    bore = float(rng.uniform(0.1, 0.6)) * root
    modulus = _between(rng, 10, 2.1e5)
    thickness = _between(rng, 0.05, 1) * circle
    return {
        "title": "random",
        "source": "none",
        "cycloid": {
            "pins": pins,
            "pin_radius_mm": pin,
            "pin_circle_radius_mm": circle,
            "eccentricity_mm": eccentricity,
            # contacts that yield between a hundred-thousandth and a hundredth of their size
            "rated_torque_Nm": _between(rng, 1e-7, 1e-4) * modulus * thickness * circle**2 * 1e-3,
        },
        "housing": {"outer_diameter_mm": 2.3 * (circle + pin)},
        "materials": {"stuff": {"youngs_modulus_MPa": modulus, "poisson_ratio": float(rng.uniform(0, 0.49))}},
        "disk": {
            "material": "stuff",
            "thickness_mm": thickness,
            "bore_radius_mm": bore,
            "stress": str(rng.choice(["plane_stress", "plane_strain"])),
        },
        "pins": {"material": "stuff"},
        "bearing": {
            "stiffness_N_per_mm_power": _between(rng, 1e-3, 1e2) * modulus * thickness,
            "exponent": float(rng.choice([1.0, 10 / 9, 1.5])),
            "clearance_um": float(rng.choice([0.0, 1.0, 20.0])),
        },
        "output": _plate(rng, root, eccentricity, bore)
        if rng.random() < 0.5
        else _holes(rng, root, eccentricity, bore),
    }


def _plate(rng: np.random.Generator, root: float, eccentricity: float, bore: float) -> dict[str, Any]:
    stations = int(rng.integers(1, 6))
    face = float(rng.uniform(1.05, 1.8)) * bore
    reach = float(np.sqrt(max((root - eccentricity) ** 2 - face**2, 1e-4)))
    roller = float(rng.uniform(0.1, 0.9)) * reach / (2 * stations + 2)
    return {
        "mechanism": "roller_plate",
        "roller_radius_mm": roller,
        "rollers": 8 * stations,
        "roller_length_mm": _between(rng, 0.5, 5) * roller,
        "roller_material": "stuff",
        "inner_station_mm": float(rng.uniform(1.0, 1.5)) * roller,
        "outer_station_mm": float(rng.uniform(0.7, 0.95)) * reach,
        "face_offset_mm": face,
        "slide_angle_deg": float(rng.uniform(-180, 180)),
        "plate": str(rng.choice(["rotates", "floats"])),
        "flat_depth_mm": float(rng.uniform(0.5, 2)) * face,
        "plate_material": "stuff",
    }


def _holes(rng: np.random.Generator, root: float, eccentricity: float, bore: float) -> dict[str, Any]:
    number = round(_between(rng, 3, 24))
    circle = (root + bore) / 2
    room = min((root - bore) / 2, circle * sin(pi / number)) - eccentricity
    return {
        "mechanism": "pin_in_hole",
        "pins": number,
        "pin_radius_mm": float(rng.uniform(0.1, 0.9)) * max(room, 1e-2),
        "pin_circle_radius_mm": circle,
        "pin_material": "stuff",
        "hole_clearance_um": float(rng.choice([0.0, 5.0, 100.0])),
        "phase_deg": float(rng.uniform(-180, 180)),
    }


def _study(rng: np.random.Generator, design: dict[str, Any]) -> dict[str, Any]:
    """Few samples, one crank angle, few load steps, a coarse mesh; errors up to a fifth of the eccentricity."""
    cycloid, output = design["cycloid"], design["output"]
    lobes, circle = cycloid["pins"] - 1, cycloid["pin_circle_radius_mm"]
    edges = int(rng.integers(max(8, 60 // lobes), max(17, 240 // lobes)))
    edge = 2 * pi * circle / (lobes * edges)
    roller = output.get("roller_radius_mm", output.get("pin_radius_mm"))
    error = min(_between(rng, 1e-4, 0.2) * 1e3 * cycloid["eccentricity_mm"], 500.0)
    spread = {"distribution": "normal", "lower_um": -error, "upper_um": error}
    return {
        "design": "random",
        "samples": {"count": SAMPLES - 1, "experiment": "monte_carlo", "nominal_first": True, "seed": 1},
        "tolerances": {
            "pin_radial": spread,
            "pin_radius": {**spread, "distribution": "uniform"},
            "lobe_profile": spread,
            "roller_diameter": spread,
            "disk_profile": {"distribution": "fixed", "value_um": float(rng.uniform(-1, 3)) * error / 3},
            "bearing_clearance": {"distribution": "uniform", "lower_um": 0.0, "upper_um": error},
        },
        "clearance": {"method": str(rng.choice(["exact", "first_order"]))},
        "springs": {"law": str(rng.choice(["hertz", "palmgren"], p=[0.85, 0.15]))},
        "reduce": {
            "flank_edges_per_lobe": edges,
            "patch_half_width_mm": min(float(rng.uniform(1, 4)) * edge, 0.9 * cycloid["pin_radius_mm"]),
            "growth": float(rng.uniform(0.3, 1)),
            "largest_edge_mm": max(float(rng.uniform(0.08, 0.3)) * circle, edge),
            "roller_patch_half_width_mm": float(rng.uniform(0.2, 0.9)) * roller,
        },
        "cycle": {
            "crank_deg": [float(rng.choice([0.0, rng.uniform(0, 360)]))],
            "rigid_angles": 1,
            "levels_per_branch": 4,
            "torque_fraction": 1.0,
            "keep_contacts": "all",
        },
    }
