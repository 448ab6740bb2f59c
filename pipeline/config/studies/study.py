"""The study file: which samples of a design are computed, how, and what is made of them."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, create_model, model_validator

from pipeline.arrays import Real, Truth
from pipeline.config.designs.design import Design, PlausibleRange, range_within
from pipeline.config.designs.problems import LawName
from pipeline.config.files.section import Derived, Millimetres, NotNegative, Section
from pipeline.config.studies.costs import Costs
from pipeline.config.studies.optional import ModelForms, Tails
from pipeline.config.studies.tolerances import Case, Tolerances
from pipeline.model.metrics import Limited
from pipeline.model.metrics import library as metric_library
from pipeline.model.metrics.turn import turn_library

Percent = Annotated[float, Field(gt=0, le=100)]


class Until(Section):
    """When a study has samples enough: when the interval of the yield against all limits is so narrow.

    It has `samples.count` to begin with, grows by multiples of it, and ends at `at_most` whether it is or not.
    """

    yield_half_width: Annotated[float, Field(gt=0, le=0.5)]
    at_most: Annotated[int, Field(ge=1, le=10**9)] = 100_000


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
    until: Until | None = None

    @property
    def rows(self) -> int:
        """Number of samples in the tables, the nominal reducer included."""
        return self.count + self.nominal_first

    @property
    def has_replicates(self) -> bool:
        """Whether the samples come in `randomisations` independent replicates."""
        return self.experiment in ("sobol", "latin_hypercube")


class Clearance(Section):
    """How errors become gaps: exact geometry or first order, and what a tolerance on the drawing means.

    An error of the disk's profile is a smaller pin circle that generates it (`"radial"`), or half of that where it is
    one of the diameter (`"radial_on_diameter"`), or material taken off along the normal of the flank (`"normal"`).
    """

    method: Literal["exact", "first_order"] = "exact"
    disk_reading: Literal["radial_on_diameter", "radial", "normal"] = "radial_on_diameter"
    roller_reading: Literal["half_diameter", "diameter"] = "half_diameter"


class Springs(Section):
    """Law of the line contacts, the stiffness of each where the law is linear, and the length of its tables.

    Laws: `"hertz"`, `"palmgren"`, `"linear"`, and those that other packages add (`pipeline/model/contact/line_laws`).
    Four factors of the laws, all 1 by default, are what a fit to a unit finds: of the deflection at the pins; of that
    at the output; of how far both fall behind a linear law (1 - the exponent of a power, the coefficient of Hertz'
    logarithm), the deflection at a usual force (`assembly.usual_forces`) left as it is; and of the deflection at a pin
    where the radius of its contact is half of the pin's, against that on a flat flank.
    """

    law: LawName = "hertz"
    stiffness_N_per_mm: Annotated[float, Field(ge=1, le=1e9)] | None = None
    table_points: Annotated[int, Field(ge=16, le=10**6)] = 200
    pin_deflection_factor: Annotated[float, Field(ge=0.05, le=20)] = 1.0
    output_deflection_factor: Annotated[float, Field(ge=0.05, le=20)] = 1.0
    curvature_factor: Annotated[float, Field(ge=0.05, le=5)] = 1.0
    half_radius_factor: Annotated[float, Field(ge=0.5, le=2)] = 1.0


FORCE_LAW = 1.65
"""Factor of the deflection of a contact: Hertz' and Palmgren's laws differ by up to a third on the flank."""
SHORT_CONTACT = 6.0
"""The same of a contact on a part of the width, as of crowned pins or a tilted disk. In Hertz' point contact (Johnson
1985, 4.2) a crown with a radius of 100 mm gives way 4.7 to 6.7 times as far as the whole width of a pin of 4 to 10 mm,
one of 1 m 2.6 to 3.7 times; by Palmgren it is three times as far on a quarter of the width."""
LAW_CURVATURE = 4.0
"""Factor of how far the deflection of a contact falls behind a linear law. The exponent of the force is 0.09 to 0.1
below 1 in Hertz' and Palmgren's line contacts and 1/3 below 1 in Hertz' point contact (Johnson 1985, 4.2): 3.3 to 3.8
times as much."""
HALF_RADIUS = 1.3
"""Factor of the deflection where the radius of a contact is halved: 2^(1/3) = 1.26 of a point contact, and 0.93 makes
Hertz' line contacts alike at all radii, as many models have them."""


class LawFactor(NamedTuple):
    """A factor of the contact laws that a fit may find.

    Attributes
    ----------
    key : below [springs] of a study.
    title : what it is a factor of.
    plausible : range.
    if_short : range where contacts may be on a part of the width; the same if none is given.
    """

    key: str
    title: str
    plausible: PlausibleRange
    if_short: PlausibleRange | None = None


OTHER_LAWS = range_within(FORCE_LAW, "contact laws differ by as much")
SHORT_CONTACTS = PlausibleRange(1 / FORCE_LAW, SHORT_CONTACT, "between another law and a crowned pin")
LAW_FACTORS = (
    LawFactor("pin_deflection_factor", "deflection of the pins' contacts", OTHER_LAWS, SHORT_CONTACTS),
    LawFactor("output_deflection_factor", "deflection of the output's contacts", OTHER_LAWS, SHORT_CONTACTS),
    LawFactor(
        "curvature_factor",
        "curvature of the laws of all contacts",
        range_within(LAW_CURVATURE, "between nearly linear and a point contact"),
    ),
    LawFactor(
        "half_radius_factor",
        "deflection of a pin's contact at half of its radius",
        range_within(HALF_RADIUS, "between alike at all radii and a point contact"),
    ),
)
"""All factors of the contact laws, in the order in which a fit has them."""


class Reduce(Section):
    """Mesh of the elastic bodies and the patches that carry the contact loads.

    `roller_patch_half_width_mm` is that of the output's contacts: on the tongue's faces, or on the walls of the disk's
    holes, which are then meshed with edges of half of it. A disk that is `"rigid"` has no mesh: its contacts are those
    of solid bodies, as in many published models. Numbers that a study leaves out follow from its design (`with_mesh`).
    """

    disk: Literal["elastic", "rigid"] = "elastic"
    flank_edges_per_lobe: Annotated[int, Field(ge=8, le=2000), Derived("two edges under half of a patch")]
    patch_half_width_mm: Annotated[Millimetres, Derived("a tenth of the pin's radius")]
    growth: Annotated[float, Field(ge=0.01, le=2), Derived("0.35")]
    largest_edge_mm: Annotated[Millimetres, Derived("a 30th of the radius of the pin circle")]
    roller_patch_half_width_mm: Annotated[
        Millimetres, Derived("a tenth of the radius of pin or hole; of rollers 0.8 of it")
    ]


LOADED_ANGLES = 31
"""Crank angles of a turn that are loaded unless the study says otherwise, or the next number that suits the design."""


class Cycle(Section):
    """Load cycle 0 -> +T -> -T -> +T at the loaded crank angles, T being `torque_fraction` of the rated torque.

    The turn is that of the `"output"`, after which a unit repeats, or the first one of the `"crank"`; it has
    `crank_turns`, which follow from the design. The loaded angles are `loaded_angles` evenly over it from 0, or the
    list `crank_deg`; whole curves are kept at `curve_angles` of them. The play of rigid bodies is taken at
    `rigid_angles` evenly over the turn and at the loaded ones. Over a turn of the output with `loaded_angles` the worst
    of each unit is searched for at every pitch of the pins, and `audited_units` are solved at all of them. A branch has
    `levels_per_branch` equal steps and the torques of the metrics; with 0 steps, those alone.
    """

    turn: Literal["output", "crank"] = "output"
    crank_turns: Annotated[int, Field(ge=1, exclude=True)] = 1
    loaded_angles: Annotated[int, Field(ge=1, le=3600)] | None = None
    crank_deg: Annotated[
        tuple[Annotated[float, Field(ge=0)], ...], Field(min_length=1), Derived("loaded_angles evenly over the turn")
    ]
    rigid_angles: Annotated[int, Field(ge=1, le=36_000)] = 181
    audited_units: Annotated[int, Field(ge=10, le=10_000)] = 40
    curve_angles: Annotated[int, Field(ge=1, le=3600)] = 4
    levels_per_branch: Annotated[int, Field(ge=0, le=10_000)]
    torque_fraction: Annotated[float, Field(gt=0, le=10)] = 1.0
    keep_contacts: Literal["all"] | tuple[Annotated[int, Field(ge=0)], ...] = (0,)

    @model_validator(mode="before")
    @classmethod
    def _spread_over_a_turn(cls, raw: Any) -> Any:
        if not isinstance(raw, dict) or "crank_deg" in raw:
            return raw
        angles = raw.get("loaded_angles", LOADED_ANGLES)
        if not isinstance(angles, int) or angles < 1:
            return raw
        turn_deg = 360.0 * raw.get("crank_turns", 1)
        return {**raw, "loaded_angles": angles, "crank_deg": tuple(turn_deg * k / angles for k in range(angles))}

    @property
    def turn_deg(self) -> float:
        """The turn as an angle of the crank [deg]."""
        return 360.0 * self.crank_turns

    @property
    def has_turn_search(self) -> bool:
        """Whether the worst of each unit is searched for over the whole turn of the output."""
        return self.turn == "output" and self.loaded_angles is not None and self.crank_turns > 1

    @property
    def evenly_loaded(self) -> bool:
        """Whether the loaded angles stand evenly over the turn from 0."""
        angles = len(self.crank_deg)
        return np.allclose(self.crank_deg, self.turn_deg * np.arange(angles) / angles)

    @property
    def curve_crank_deg(self) -> tuple[float, ...]:
        """Loaded crank angles [deg] whose whole curves are kept, evenly among all."""
        angles, curves = len(self.crank_deg), min(self.curve_angles, len(self.crank_deg))
        return tuple(self.crank_deg[k * angles // curves] for k in range(curves))

    @property
    def rigid_crank_deg(self) -> tuple[float, ...]:
        """Crank angles [deg] at which rigid bodies are looked at beside the loaded ones, evenly over the turn."""
        return tuple(self.turn_deg * k / self.rigid_angles for k in range(self.rigid_angles))

    @property
    def even_crank_deg(self) -> tuple[float, ...]:
        """Crank angles [deg] evenly over the turn at which the play is known: the loaded ones, if they are more."""
        loaded_are_more = self.evenly_loaded and len(self.crank_deg) > self.rigid_angles
        return self.crank_deg if loaded_are_more else self.rigid_crank_deg


class Metrics(Section):
    """Definitions of the numbers read off a curve, in percent of the rated torque, and the level of their intervals."""

    lost_motion_percent: Percent = 3.0
    rigidity_percent: tuple[Percent, Percent] = (50.0, 100.0)
    confidence: Annotated[float, Field(ge=0.5, lt=1)] = 0.95


ANGLES_TO_CONTINUE = 12
"""Crank angles evenly over the turn whose half and quarter, three, tell how a worst value moves as they double."""
ALL_LIMITS = "all_limits"
"""Name of the yield against all limits together."""


class _Limits(Section):
    """Limits for the yield, one for each metric: upper ones, or lower ones where the smaller is the worse.

    They hold for the worst, mean or best value `over` the turn; those of a metric of the whole turn for its one value.
    """

    over: Literal["worst", "mean", "best"] = "worst"

    @property
    def of_metrics(self) -> dict[str, float]:
        """The limits that are set, by metric, those of loops first."""
        limits = {name: getattr(self, name) for name in (*metric_library(), *turn_library())}
        return {name: limit for name, limit in limits.items() if limit is not None}

    def pass_flags(self, values: Mapping[str, Real]) -> dict[str, Truth]:
        """Whether each value (n,) keeps each limit that is set on one of the ``values``, and `ALL_LIMITS` of them."""
        metrics: Mapping[str, Limited] = {**metric_library(), **turn_library()}
        limits = {name: limit for name, limit in self.of_metrics.items() if name in values}
        kept_samples = {name: metrics[name].keeps(np.asarray(values[name]), limit) for name, limit in limits.items()}
        return {**kept_samples, ALL_LIMITS: np.logical_and.reduce(list(kept_samples.values()))} if kept_samples else {}

    def limited_metrics(self, name: str, values: Container[str]) -> list[str]:
        """Metrics of the ``values`` whose limits a yield of this name counts."""
        return [metric for metric in self.of_metrics if metric in values] if name == ALL_LIMITS else [name]


if TYPE_CHECKING:
    Limits = _Limits
else:
    _of_metrics = dict.fromkeys((*metric_library(), *turn_library()), (NotNegative | None, None))
    Limits = create_model("Limits", __base__=_Limits, __doc__=_Limits.__doc__, **_of_metrics)


class _PublishedUnit(Section):
    """A measured unit of this drive as its authors print it: its metrics, shown beside the predicted ones.

    `orders` are those of the transmission error, in waves per turn of the output, that the source names as its largest.
    """

    label: str
    source: str
    note: str = ""
    orders: tuple[Annotated[int, Field(ge=1, le=10**6)], ...] = ()

    @property
    def of_metrics(self) -> dict[str, float]:
        """The values that were measured, by metric."""
        values = {name: getattr(self, name) for name in (*metric_library(), *turn_library())}
        return {name: value for name, value in values.items() if value is not None}


if TYPE_CHECKING:
    PublishedUnit = _PublishedUnit
else:
    PublishedUnit = create_model(
        "PublishedUnit", __base__=_PublishedUnit, __doc__=_PublishedUnit.__doc__, **_of_metrics
    )


FEWEST_BASE_SAMPLES = 30
"""Fewer rows of a pick-freeze design tell nothing of the variance: their bootstrap intervals are too narrow."""


class Drivers(Section):
    """Extra units for variance-based indices: `base_samples` for each tolerance that varies; 0 for none.

    In a Monte Carlo study the two base sets are its own samples; units that it lacks of them are solved too.
    """

    base_samples: Annotated[int, Field(ge=0, le=10**6)] = 0


class RunSection(Section):
    """How the work is divided; changes no result."""

    jobs: Annotated[int, Field(ge=1, le=1024)] = 2
    chunk: Annotated[int, Field(ge=1, le=10**9)] = 250


class Study(Section):
    """A study file with its design. `cases` stands in place of `tolerances` when the experiment is a list of cases.

    `published` units are shown beside the predicted distributions; nothing is fitted to them.
    """

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
    published: tuple[PublishedUnit, ...] = ()
    costs: Costs = Costs()
    drivers: Drivers = Drivers()
    tails: Tails | None = None
    model_forms: ModelForms | None = None
    run: RunSection = RunSection()

    def with_(self, changes: Mapping[str, Any]) -> Study:
        """The study with other values at dotted keys, as ``{"tolerances.pin_radial.upper_um": 2.0}``, checked.

        Raises
        ------
        InputError
            With everything that is wrong with the new values.
        """
        from pipeline.config.changing import changed_study  # which needs this class

        return changed_study(self, changes)
