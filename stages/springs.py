"""Stage 3: the nonlinear springs: law of every contact at every crank angle, as coefficients and as tables."""

import numpy as np
import pandas as pd

from pipeline import assembly
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.units import NMM_PER_NM, UM_PER_MM
from stages.tables.keys import CONTACT, CRANK

BEARING = -1
"""Contact number of the input bearing in the table of laws."""

COEFFICIENT_COLUMNS = {
    "linear_mm_per_N": ("linear", "mm/N", "a of delta = a F - c F ln F + k F^m, F in N"),
    "logarithmic_mm_per_N": ("logarithmic", "mm/N", "c"),
    "power_mm": ("power", "mm/N^m", "k"),
    "exponent": ("exponent", "1", "m"),
    "force_limit_N": ("force_limit", "N", "force beyond which the law is extrapolated linearly"),
    "pressure_MPa": ("pressure", "MPa/N^0.5", "peak Hertz pressure over the square root of the force"),
}
COEFFICIENTS = Table(
    "coefficients",
    "contact, crank",
    (
        CONTACT,
        CRANK,
        *(Column(name, "float64", unit, meaning) for name, (_, unit, meaning) in COEFFICIENT_COLUMNS.items()),
    ),
)
LAWS = Table(
    "laws",
    "law curve, table point; at the crank angles whose load curves are kept, of all angles in coefficients",
    (
        CONTACT,
        CRANK,
        Column("law", "label", "", "law of the contact, or bearing (contact -1)"),
        Column("force_N", "float64", "N", "force"),
        Column("local_um", "float64", "um", "local deflection beyond the clearance"),
        Column("stiffness_N_per_um", "float64", "N/um", "tangent stiffness"),
        Column("beyond_limit", "bool", "", "whether the force lies beyond the law's range, on its tangent"),
    ),
)


def laws_of_columns(columns: dict[str, np.ndarray], crank_deg: float) -> ContactLaws:
    """The laws at one crank angle read back from the table of coefficients."""
    rows = columns["crank_deg"] == crank_deg
    return ContactLaws(**{field: columns[name][rows] for name, (field, _, _) in COEFFICIENT_COLUMNS.items()})


def _coefficients(laws: ContactLaws) -> dict[str, np.ndarray]:
    """Columns of the table of coefficients, a row per contact."""
    return {name: getattr(laws, field) for name, (field, _, _) in COEFFICIENT_COLUMNS.items()}


def _curve(laws: ContactLaws, force: np.ndarray) -> dict[str, np.ndarray]:
    """Rows of the tables of ``laws`` (n,) at ``force`` (points,)."""
    grid = np.repeat(force[:, None], len(laws), axis=1)
    with np.errstate(divide="ignore"):  # the compliance at no force may be infinite: no stiffness
        stiffness = 1 / (UM_PER_MM * laws.compliance(grid))
    return {
        "force_N": grid.T.ravel(),
        "local_um": UM_PER_MM * laws.deflection(grid).T.ravel(),
        "stiffness_N_per_um": stiffness.T.ravel(),
        "beyond_limit": (grid > laws.force_limit).T.ravel(),
    }


def _bearing_curve(study: Study, force: np.ndarray) -> dict[str, np.ndarray]:
    bearing = study.design.bearing
    exponent = bearing.exponent
    local = (force / bearing.stiffness_N_per_mm_power) ** (1 / exponent)
    stiffness = exponent * bearing.stiffness_N_per_mm_power * local ** (exponent - 1)
    return {
        "force_N": force,
        "local_um": UM_PER_MM * local,
        "stiffness_N_per_um": stiffness / UM_PER_MM,
        "beyond_limit": np.zeros(len(force), bool),
    }


def _run(job: Job) -> Tables:
    study: Study = job.study
    coefficients, curves = [], []
    points = study.springs.table_points
    for crank in study.cycle.crank_deg:
        reducer = assembly.reducer(study.design, crank)
        laws = assembly.contact_laws(study, reducer)
        number = np.arange(len(laws))
        coefficients.append(pd.DataFrame({"contact": number, "crank_deg": crank, **_coefficients(laws)}))
        if crank not in study.cycle.curve_crank_deg:
            continue
        # up to the force with which one contact would carry the whole rated torque; dense where the law bends
        largest_force = NMM_PER_NM * study.design.cycloid.rated_torque_Nm / np.max(np.abs(reducer.contacts.arm))
        force = largest_force * np.linspace(0, 1, points) ** 2
        curves.append(
            pd.DataFrame(
                {
                    "contact": np.repeat(number, points),
                    "crank_deg": crank,
                    "law": study.springs.law,
                    **_curve(laws, force),
                }
            )
        )
        curves.append(
            pd.DataFrame({"contact": BEARING, "crank_deg": crank, "law": "bearing", **_bearing_curve(study, force)})
        )
    return {
        name: {key: column.to_numpy() for key, column in pd.concat(frames).items()}
        for name, frames in (("coefficients", coefficients), ("laws", curves))
    }


SPRINGS = Stage(
    name="springs",
    reads=(),
    sections=(
        "design.cycloid",
        "design.materials",
        "design.disk",
        "design.pins",
        "design.bearing",
        "design.output",
        "design.flank",
        "springs",
        "reduce.disk",
        "reduce.patch_half_width_mm",
        "reduce.roller_patch_half_width_mm",
        "cycle.crank_deg",
        "cycle.curve_crank_deg",
    ),
    tables=(COEFFICIENTS, LAWS),
    module="stages.springs",
    run=_run,
)
