"""What the paper's text states of its figures, each held against the run's tables."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.checks.paper.table2 import Tables

NONUNIFORM = 1.01
"""Largest over smallest clearance of the pins from which a clearance is not uniform."""
ROUNDING = 1e-9
"""By which equal shares may differ."""
SHARES = (0.03, 0.25, 0.5, 1.0)
"""Of the rated torque, at which quantities that grow with torque are compared."""


@dataclass(frozen=True)
class FigureStatement:
    """One statement of the paper's text on a figure, and what the run shows.

    Attributes
    ----------
    figure : number of the paper's figure.
    text : the statement.
    observation : what the run shows.
    agrees : whether that is what the text states.
    """

    figure: str
    text: str
    observation: str
    agrees: bool


def statements(tables: Tables, published_contacts: Path) -> list[FigureStatement]:
    """Every statement, in the order of the figures."""
    return [
        *_clearances(tables),
        *_springs(tables),
        *_contacts(tables, published_contacts),
        *_forces(tables),
        *_rising(tables),
        *_bearing(tables),
        *_rollers(tables),
        *_curves(tables),
    ]


def _value_list(values: list[float], digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _rises(values: list[float]) -> bool:
    return all(upper > lower for lower, upper in zip(values, values[1:], strict=False))


def _clearances(tables: Tables) -> Iterator[FigureStatement]:
    ratios = []
    for case in tables.with_tolerance:
        gap = tables.clearances(case)["clearance_um"].to_numpy()
        ratios.append(float(gap.max() / gap.min()))
    yield FigureStatement(
        "4",
        "a uniform tolerance does not give a uniform clearance at the contact points",
        f"largest over smallest clearance of the pins: {_value_list(ratios, 1)}",
        min(ratios) > NONUNIFORM,
    )


def _springs(tables: Tables) -> Iterator[FigureStatement]:
    laws = tables.laws[tables.laws["force_N"] > 0]

    def stiffness(contact: int) -> tuple[float, float]:
        """At the smallest and the largest force of the table."""
        rows = laws[(laws["contact"] == contact) & ~laws["beyond_limit"].to_numpy(bool)].sort_values("force_N")
        return float(rows["stiffness_N_per_um"].iloc[0]), float(rows["stiffness_N_per_um"].iloc[-1])

    softest = [stiffness(int(pin))[0] for pin in tables.pins]
    yield FigureStatement(
        "5a",
        "the contact stiffness varies from pin to pin with the curvature of the disk",
        f"at the smallest force {min(softest):.0f} to {max(softest):.0f} N/µm",
        max(softest) / min(softest) > NONUNIFORM,
    )
    roller = int(tables.contacts.loc[tables.contacts["kind"] == "output", "contact"].iloc[0])
    for name, contact in (("input bearing", -1), ("output roller", roller)):
        low, high = stiffness(contact)
        yield FigureStatement(
            "5b", f"the stiffness of the {name} depends on its force", f"{low:.0f} to {high:.0f} N/µm", high > low
        )


def _contacts(tables: Tables, published_folder: Path) -> Iterator[FigureStatement]:
    for row in pd.read_csv(published_folder, dtype={"case": str}).itertuples():
        pins = tables.loaded_pins(row.case, row.torque_Nm)
        count = int(np.count_nonzero(pins["force_N"] > 0))
        yield FigureStatement(
            "9",
            f"{row.pins_in_contact} pins touch the disk at {row.torque_Nm:g} N m with {row.case}",
            f"{count} pins",
            count == row.pins_in_contact,
        )
    for case in tables.with_tolerance:
        pins = tables.loaded_pins(case, tables.lost_motion_torque)
        open_pins = pins[pins["force_N"] <= 0]
        deformation = open_pins["approach_um"] - open_pins["elastic_um"]  # the loaded disk recedes there
        slack = float((open_pins["clearance_um"] - deformation).min())
        yield FigureStatement(
            "9",
            f"where the clearance exceeds the deformation the pin has lost contact, with {case}",
            f"the open pins lack {slack:.2f} µm at least",
            slack >= 0,
        )


def _forces(tables: Tables) -> Iterator[FigureStatement]:
    loads = [
        tables.loaded_pins(case.label, tables.lost_motion_torque)["force_N"].to_numpy() for case in tables.study.cases
    ]
    counts = [float(np.count_nonzero(force > 0)) for force in loads]
    yield FigureStatement(
        "10",
        "the number of contacts changes with the tolerance of the disk",
        f"{_value_list(counts, 0)} pins by rising tolerance",
        _rises(counts[::-1]),
    )
    peaks = [float(force.max()) for force in loads]
    yield FigureStatement(
        "10",
        "the force distribution changes with the tolerance of the disk",
        f"peak force {_value_list(peaks, 2)} N by rising tolerance",
        _rises(peaks),
    )


def _rising(tables: Tables) -> Iterator[FigureStatement]:
    rated_torque = tables.study.design.cycloid.rated_torque_Nm
    for case in tables.with_tolerance:
        loads = [tables.loaded_pins(case, share * rated_torque)["force_N"].to_numpy() for share in SHARES]
        for name, values, digits in (
            ("peak contact force (N)", [float(force.max()) for force in loads], 1),
            ("number of contacts", [float(np.count_nonzero(force > 0)) for force in loads], 0),
        ):
            torques = ", ".join(f"{share * rated_torque:g}" for share in SHARES)
            text = f"{_value_list(values, digits)} at {torques} N m"
            yield FigureStatement("11", f"the {name} increases with the torque, with {case}", text, _rises(values))


def _deflection(curve: pd.DataFrame) -> np.ndarray:
    deflection: np.ndarray = np.hypot(curve["bearing_x_um"].to_numpy(), curve["bearing_y_um"].to_numpy())
    return deflection


def bearing_deflections(tables: Tables, torque: float) -> list[float]:
    """Deflection [um] of the input bearing in every case at a torque [N m] of the first loading."""
    curves = [tables.loading(case.label) for case in tables.study.cases]
    return [float(np.interp(torque, curve["torque_Nm"], _deflection(curve))) for curve in curves]


def _bearing(tables: Tables) -> Iterator[FigureStatement]:
    curves = [tables.loading(case.label) for case in tables.study.cases]
    for case, curve in zip(tables.study.cases, curves, strict=True):
        deflection = _deflection(curve)
        yield FigureStatement(
            "12",
            f"the bearing deflects more as the torque increases, with {case.label}",
            f"up to {deflection[-1]:.3f} µm",
            bool(np.all(np.diff(deflection) > 0)),
        )
    transverse = [float(abs(curve["bearing_y_um"].iloc[-1])) for curve in curves]
    for name, torque in (
        (f"{tables.lost_motion_torque:g} N m", tables.lost_motion_torque),
        ("the rated torque", tables.study.design.cycloid.rated_torque_Nm),
    ):
        values = bearing_deflections(tables, torque)
        yield FigureStatement(
            "12",
            f"the bearing deflects more as the tolerances increase, at {name}",
            f"{_value_list(values, 3)} µm by rising tolerance; "
            f"across the eccentric {_value_list(transverse, 3)} at most",
            _rises(values),
        )
    longitudinal = [float(curve["bearing_x_um"].iloc[-1]) for curve in curves]
    yield FigureStatement(
        "12",
        "the disk moves to the right as the torque increases, read as along the eccentric",
        f"by {_value_list(longitudinal, 3)} µm at the rated torque, by rising tolerance",
        min(longitudinal) > 0,
    )


def _rollers(tables: Tables) -> Iterator[FigureStatement]:
    output = tables.contacts.loc[tables.contacts["kind"] == "output", ["contact", "station"]]
    shares = []
    for case in tables.study.cases:
        rows = tables.contacts_at(case.label, tables.lost_motion_torque).merge(output, on="contact")
        outermost = rows.loc[rows["station"] == 0, "force_N"].sum()
        shares.append(float(outermost / rows["force_N"].sum()))
    yield FigureStatement(
        "13",
        "as the clearance increases, the force concentrates on the outside rollers",
        f"share of the outermost rollers {_value_list(shares, 3)} by rising tolerance",
        shares[0] < min(shares[1:]) and all(b >= a - ROUNDING for a, b in zip(shares, shares[1:], strict=False)),
    )


def _curves(tables: Tables) -> Iterator[FigureStatement]:
    metrics = {"backlash": _backlash, "lost motion": _lost_motion}
    values = {name: [measure(tables, case.label) for case in tables.study.cases] for name, measure in metrics.items()}
    for name, angles in values.items():
        text = f"the {name} increases with the tolerance"
        yield FigureStatement("14", text, f"{_value_list(angles, 3)} arcmin", _rises(angles))
    yield FigureStatement(
        "14",
        "the lost motion is larger than the backlash, because the connecting elements yield",
        f"by {_value_list([b - a for a, b in zip(*values.values(), strict=True)], 3)} arcmin",
        all(b > a for a, b in zip(*values.values(), strict=True)),
    )
    top = [_slope(tables.loading(case.label)) for case in tables.study.cases]
    yield FigureStatement(
        "14",
        "the torsional stiffness decreases as the tolerance increases",
        f"slope of the curve at the rated torque {_value_list(top, 3)} N m/arcmin",
        _rises(top[::-1]),
    )


def _angle(tables: Tables, case: str, branch: str, torque: float) -> float:
    rows = tables.of_case(tables.curves, case)
    of_branch = rows[rows["branch"] == branch]
    return float(of_branch.loc[np.isclose(of_branch["torque_Nm"], torque), "angle_arcmin"].iloc[0])


def _backlash(tables: Tables, case: str) -> float:
    return _angle(tables, case, "unloading+", 0.0) - _angle(tables, case, "unloading-", 0.0)


def _lost_motion(tables: Tables, case: str) -> float:
    torque = tables.lost_motion_torque
    return _angle(tables, case, "unloading+", torque) - _angle(tables, case, "unloading-", -torque)


def _slope(curve: pd.DataFrame) -> float:
    end = curve.iloc[-2:]
    return float(np.diff(end["torque_Nm"])[0] / np.diff(end["angle_arcmin"])[0])
