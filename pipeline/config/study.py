"""The study file: which samples of a design are computed, how, and what is made of them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.cases import Case
from pipeline.config.design import Design
from pipeline.config.section import Millimetres, NotNegative, Positive, Section
from pipeline.config.tolerances import Tolerances

Percent = Annotated[float, Field(gt=0, le=100)]


class Samples(Section):
    """Design of experiment.

    `randomisations` independent scramblings (Sobol') or hypercubes share the samples, so that intervals can be taken
    over them; Monte Carlo and cases ignore it. Sample 0 is the nominal reducer when `nominal_first`.
    """

    count: Annotated[int, Field(ge=1, le=10**9)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    experiment: Literal["monte_carlo", "sobol", "latin_hypercube", "cases"]
    nominal_first: bool = True
    randomisations: Annotated[int, Field(ge=8)] = 8

    @property
    def rows(self) -> int:
        """Number of samples in the tables, the nominal reducer included."""
        return self.count + self.nominal_first

    @property
    def replicated(self) -> bool:
        """Whether the samples come in `randomisations` independent replicates."""
        return self.experiment in ("sobol", "latin_hypercube")


class Clearance(Section):
    """How errors become gaps: exact geometry or first order, and what a tolerance on the drawing means."""

    method: Literal["exact", "first_order"] = "exact"
    disk_reading: Literal["radial_on_diameter", "radial", "normal"] = "radial_on_diameter"
    roller_reading: Literal["half_diameter", "diameter"] = "half_diameter"


class Springs(Section):
    """Law of the line contacts, and the length of its tables."""

    law: Literal["hertz", "palmgren"] = "hertz"
    table_points: Annotated[int, Field(ge=16, le=10**6)] = 200


class Reduce(Section):
    """Mesh of the elastic bodies and the patches that carry the contact loads.

    `roller_patch_half_width_mm` is that of the output's contacts: on the tongue's faces, or on the walls of the disk's
    holes, which are then meshed with edges of half of it.
    """

    flank_edges_per_lobe: Annotated[int, Field(ge=8, le=2000)]
    patch_half_width_mm: Millimetres
    growth: Annotated[float, Field(ge=0.01, le=2)]
    largest_edge_mm: Millimetres
    roller_patch_half_width_mm: Millimetres


class Cycle(Section):
    """Load cycle 0 -> +T -> -T -> +T at each crank angle, T being `torque_fraction` of the rated torque.

    A branch has `levels_per_branch` equal steps and the torques of the metrics; with 0 steps, those alone.
    """

    crank_deg: Annotated[tuple[Annotated[float, Field(ge=0, lt=360)], ...], Field(min_length=1)]
    levels_per_branch: Annotated[int, Field(ge=0, le=10_000)]
    torque_fraction: Annotated[float, Field(gt=0, le=10)] = 1.0
    keep_contacts: Literal["all"] | tuple[Annotated[int, Field(ge=0)], ...] = (0,)


class Metrics(Section):
    """Definitions of the numbers read off a curve, in percent of the rated torque, and the level of their intervals."""

    lost_motion_percent: Percent = 3.0
    rigidity_percent: tuple[Percent, Percent] = (50.0, 100.0)
    confidence: Annotated[float, Field(ge=0.5, lt=1)] = 0.95


class Limits(Section):
    """Limits for the yield: upper ones, and a lower one for the torsional rigidity."""

    clearance_backlash_arcmin: NotNegative | None = None
    zero_torque_width_arcmin: NotNegative | None = None
    lost_motion_arcmin: NotNegative | None = None
    hysteresis_loss_arcmin: NotNegative | None = None
    torsional_rigidity_Nm_per_arcmin: NotNegative | None = None
    peak_pressure_MPa: Positive | None = None


FEWEST_BASE_SAMPLES = 30
"""Fewer rows of a pick-freeze design tell nothing of the variance: their bootstrap intervals are too narrow."""


class Drivers(Section):
    """Extra units for variance-based indices: `base_samples` for each tolerance that varies; 0 for none.

    In a Monte Carlo study the two base sets are its own samples; units that it lacks of them are solved too.
    """

    base_samples: Annotated[int, Field(ge=0, le=10**6)] = 0


class Run(Section):
    """How the work is divided; changes no result."""

    jobs: Annotated[int, Field(ge=1, le=1024)] = 2
    chunk: Annotated[int, Field(ge=1, le=10**9)] = 250


class Study(Section):
    """A study file with its design. `cases` stands in place of `tolerances` when the experiment is a list of cases."""

    name: str
    title: str = ""
    description: str = ""
    design: Design
    samples: Samples
    cases: tuple[Case, ...] = ()
    tolerances: Tolerances = Tolerances()
    clearance: Clearance = Clearance()
    springs: Springs = Springs()
    reduce: Reduce
    cycle: Cycle
    metrics: Metrics = Metrics()
    limits: Limits = Limits()
    drivers: Drivers = Drivers()
    run: Run = Run()
