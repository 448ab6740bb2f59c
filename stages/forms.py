"""Stage 4f: some samples solved again under other forms of the model: laws, stress, rigid disk, calibrated numbers."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import groupby

import numpy as np

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.config.studies.study import ALL_LIMITS, Study
from pipeline.engine.parallel import worker_results
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.errors import InputError
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.metrics import library
from pipeline.model.units import UM_PER_MM
from pipeline.mounting import drive_of
from pipeline.populations.model_forms import (
    OF_STUDY,
    ModelForm,
    calibrated_numbers,
    contact_factor,
    model_forms,
    scaled_contacts,
)
from pipeline.populations.turn_drives import TurnDrives, Units, solved_values
from pipeline.populations.turn_ranking import Ranking
from pipeline.populations.turn_search import TRAINING_UNITS, lies_elsewhere, search, train_ranking, worst_at
from pipeline.statistics.differences import mean_difference, order_differences, share_difference
from pipeline.statistics.intervals import Estimate, distribution, pass_share
from stages.reduce import DiskMatrices
from stages.sample import SAMPLED_TABLES
from stages.tables.keys import SAMPLE, STATUS
from stages.worst import RANGES, TRAINING, drives_of, units_of

Found = tuple[Ranking, Index]
"""A ranking of pitches, and the steps (n, n_steps) at which a search with it has found the worst of units."""
RIGIDITY = "torsional_rigidity_Nm_per_arcmin"
CHECKED_UNITS = 20
"""Units that are searched under another form to see whether its worst lie where those of the study's own form do."""
RIGIDITY_UNITS, RIGIDITY_ANGLES = 20, 6
"""Units and crank angles over whose rigidities the mean is taken that a rescaled form keeps."""
DIFFERENCES = ("mean", "std", "p05", "p50", "p95")
"""Statistics of a metric that are told of each form, beside the yield."""
OK = "ok"
FORM = Column("form", "label", "", "form of the model; `as stated` is the study's own")
RESCALED_COLUMN = Column(
    "rescaled",
    "bool",
    "",
    "whether the contacts' deflections are rescaled to the mean rigidity of the study's own form",
)
FORM_LIST = Table(
    "forms",
    "form, rescaled",
    (
        FORM,
        RESCALED_COLUMN,
        Column("title", "label", "", "the form in words"),
        Column("deflection_factor", "float64", "1", "factor of the deflections of all contacts; null without a result"),
        STATUS,
    ),
)
ESTIMATES = Table(
    "estimates",
    "form, rescaled, metric, statistic",
    (
        FORM,
        RESCALED_COLUMN,
        Column("metric", "label", "", "column of metrics; all_limits: the yield against all limits together"),
        Column("statistic", "label", "", "mean, std, quantile, or yield: of the same units under every form"),
        Column("value", "float64", "the metric's", "estimate"),
        *interval_columns("the metric's"),
        Column("difference", "float64", "the metric's", "value less that of the study's own form, same units"),
        *interval_columns("the metric's", prefix="difference_"),
        Column("n", "int32", "1", "units that have a value under both forms"),
    ),
)
FORM_UNITS = Table(
    "form_units",
    "form, rescaled, sample",
    (
        FORM,
        RESCALED_COLUMN,
        SAMPLE,
        *(
            Column(name, "float64", metric.unit, f"{metric.inline} over the turn, as limits mean it")
            for name, metric in library().items()
        ),
        *RANGES.values(),
    ),
)


@dataclass(frozen=True)
class _Result:
    """Metrics (n,) of the units under one form, by name, of a search also the transmission errors; none unless ok."""

    form: ModelForm
    is_rescaled: bool
    factor: float
    metrics: Mapping[str, Real]
    status: str = OK
    found: Found | None = None


@dataclass(frozen=True)
class _Body:
    """Condensed disks of a form: over the whole turn where the worst is searched for, else at the loaded angles."""

    drives: TurnDrives | None
    at_angles: Mapping[float, Real]

    @classmethod
    def from_study(cls, job: Job, study: Study) -> "_Body":
        """The disks of a study with some form."""
        disks = DiskMatrices(job, study)
        if _has_search(study):
            return cls(drives_of(study, disks), {})
        return cls(None, {crank: _full_compliance(study, disks, crank) for crank in study.cycle.crank_deg})

    def solvers(self, study: Study) -> Iterator[Callable[[Units], Real]]:
        """Units to metrics (n, n_metrics), at some angles evenly over the turn of a study with these disks."""
        cycle = assembly.load_cycle(study, 0)
        if self.drives is not None:
            drives = TurnDrives.from_blocks(study, self.drives.phases, self.drives.blocks)
            for k in range(RIGIDITY_ANGLES):
                step = k * drives.pitches // RIGIDITY_ANGLES * drives.phases + k % drives.phases
                yield partial(_metrics_of_step, drives, step)
        for crank, compliance in self.at_angles.items():
            yield partial(_metrics_at, study, crank, compliance, cycle)

    def mean_rigidity(self, study: Study, units: Units) -> float:
        """Mean over units and some angles."""
        column = list(library()).index(RIGIDITY)
        return float(np.nanmean([metrics_of_units(units)[:, column] for metrics_of_units in self.solvers(study)]))

    def over_turn(self, study: Study, units: Units, found: Found | None) -> tuple[dict[str, Real], Found | None]:
        """Each metric of units over the turn (n,), as the limits mean it, and how their worst were found.

        Of a search also the transmission errors that have a limit, for which more would be searched than without.
        They are looked at where another form has ``found`` them, if a search of some units finds them there too.
        """
        if self.drives is not None:
            drives = TurnDrives.from_blocks(study, self.drives.phases, self.drives.blocks)
            names = [*library(), *(name for name in study.limits.of_metrics if name in RANGES)]
            if found is not None:
                worst_values = worst_at(drives, units, found[1])
                checked_values = search(drives, found[0], units.some(slice(CHECKED_UNITS)))
                if not lies_elsewhere(worst_values, checked_values, names):
                    return {name: worst_values.of_turn[name] for name in names}, found
            seed = np.random.SeedSequence(study.samples.seed, spawn_key=(TRAINING,))
            ranking = train_ranking(drives, units.some(slice(TRAINING_UNITS)), seed)
            worst_values = search(drives, ranking, units)
            return {name: worst_values.of_turn[name] for name in names}, (ranking, worst_values.best_steps)
        values = np.stack([metrics_of_units(units) for metrics_of_units in self.solvers(study)], axis=1)
        values[np.broadcast_to(np.isnan(values).any(axis=1, keepdims=True), values.shape)] = np.nan
        columns = {}
        for k, (name, metric) in enumerate(library().items()):
            worst_value, best_value = metric.over_turn(values[:, :, k])
            columns[name] = {"worst": worst_value, "mean": values[:, :, k].mean(axis=1), "best": best_value}[
                study.limits.over
            ]
        return columns, None


def _has_search(study: Study) -> bool:
    return study.cycle.has_turn_search and study.limits.over == "worst"


def _full_compliance(study: Study, disks: DiskMatrices, crank: float) -> Real:
    reducer = assembly.reducer(study.design, crank)
    blocks = disks.at_crank(crank) if study.reduce.disk == "elastic" else ()
    return assembly.joined_blocks(reducer, (block / UM_PER_MM for block in blocks))


def _metrics_of_step(drives: TurnDrives, step: int, units: Units) -> Real:
    return drives.solve_step(step, units)[2].metrics


def _metrics_at(study: Study, crank: float, compliance: Real, cycle: LoadCycle, units: Units) -> Real:
    drive = drive_of(study, crank, compliance, units.errors, units.clearance, modulus=units.modulus)
    return solved_values(study, drive, cycle)[1].metrics


def _solve(
    job: Job, study: Study, forms: list[ModelForm], units: Units, rigidity: float, found: Found | None
) -> list[_Result]:
    """Results of forms that share their disks, as stated and rescaled to a mean rigidity; missing: none is kept.

    Other laws, stresses and bearings leave the worst where the study's own form has ``found`` them: 0.03 % of a value
    are missed in the mean. With a rigid disk they lie elsewhere (1.3 % of the rigidity), and are searched for.
    """
    try:
        body = _Body.from_study(job, forms[0].study(study))
    except InputError as error:
        return [_Result(form, False, np.nan, {}, str(error)) for form in forms]
    return [result for form in forms for result in _of_form(body, study, form, units, rigidity, found)]


def _of_form(
    body: _Body, study: Study, form: ModelForm, units: Units, rigidity: float, found: Found | None
) -> Iterator[_Result]:
    try:
        form_study = form.study(study)
        metrics, found = body.over_turn(form_study, units, found)
        yield _Result(form, False, 1.0, metrics, found=found)
        if np.isnan(rigidity) or form.name == OF_STUDY:
            return
        few_units = units.some(slice(RIGIDITY_UNITS))
        factor = contact_factor(
            lambda scale: body.mean_rigidity(scaled_contacts(form_study, scale), few_units), rigidity
        )
        if np.isnan(factor):
            yield _Result(form, True, np.nan, {}, "no factor of the contacts' deflections leads to the same rigidity")
            return
        yield _Result(form, True, factor, body.over_turn(scaled_contacts(form_study, factor), units, found)[0])
    except InputError as error:
        yield _Result(form, False, np.nan, {}, str(error))


def _study_of(job: Job) -> Study:
    """The sections that the stage names as a study, which takes other forms."""
    names = ("name", "samples", "design", "clearance", "springs", "reduce", "cycle", "metrics", "limits")
    return Study.model_construct(**{name: getattr(job.study, name) for name in names})


def _run(job: Job) -> Tables:
    settings, study = job.study.model_forms, _study_of(job)
    if settings is None or study.samples.experiment == "cases":
        return {table.name: table.empty() for table in (FORM_LIST, ESTIMATES, FORM_UNITS)}
    first_unit = int(study.samples.nominal_first)
    samples = np.arange(first_unit, min(first_unit + settings.units, study.samples.rows))
    units = units_of(
        study, {name: job.read_items("sample", name, first_unit, samples[-1] + 1) for name in SAMPLED_TABLES}
    )
    forms = model_forms(study)
    suitable = [form for form in forms if not form.unsuitable]
    (own_form,) = (form for form in suitable if form.name == OF_STUDY)
    body, rigidity = _Body.from_study(job, study), np.nan
    if calibrated_numbers(study.design):
        rigidity = body.mean_rigidity(study, units.some(slice(RIGIDITY_UNITS)))
    results = list(_of_form(body, study, own_form, units, rigidity, None))
    suitable = sorted((form for form in suitable if form is not own_form), key=partial(_disks, job, study))
    groups = [list(forms_alike) for _, forms_alike in groupby(suitable, key=partial(_disks, job, study))]
    inputs = ((job, study, group, units, rigidity, results[0].found) for group in sorted(groups, key=len)[::-1])
    results += [result for part in worker_results(job.jobs, _solve, inputs) for result in part]
    results += [_Result(form, False, np.nan, {}, form.unsuitable) for form in forms if form.unsuitable]
    order = [form.name for form in forms]
    results.sort(key=lambda result: (result.is_rescaled, order.index(result.form.name)))
    return {
        "forms": _form_rows(results),
        "estimates": _estimate_rows(study, results),
        "form_units": _unit_rows(samples, results),
    }


def _disks(job: Job, study: Study, form: ModelForm) -> str:
    """Settings of a form's disks: forms with equal ones share them."""
    return DiskMatrices(job, form.study(study)).settings


def _form_rows(results: list[_Result]) -> Columns:
    return {
        "form": np.array([result.form.name for result in results]),
        "rescaled": np.array([result.is_rescaled for result in results]),
        "title": np.array([result.form.title for result in results]),
        "deflection_factor": np.array([result.factor for result in results]),
        "status": np.array([result.status for result in results]),
    }


def _unit_rows(samples: Index, results: list[_Result]) -> Columns:
    solved_results, n = [result for result in results if result.metrics], len(samples)
    unknown = np.full(n, np.nan)
    return {
        "form": np.repeat([result.form.name for result in solved_results], n),
        "rescaled": np.repeat([result.is_rescaled for result in solved_results], n),
        "sample": np.tile(samples, len(solved_results)),
        **{
            name: np.concatenate([result.metrics.get(name, unknown) for result in solved_results])
            for name in (*library(), *RANGES)
        },
    }


def _estimate_rows(study: Study, results: list[_Result]) -> Columns:
    study_result = next(result for result in results if result.form.name == OF_STUDY)
    rows = [
        {"form": result.form.name, "rescaled": result.is_rescaled, **row}
        for result in results
        if result.metrics
        for row in _estimates(study, study_result.metrics, result.metrics)
    ]
    return ESTIMATES.columns_of_rows(rows)


def _estimates(
    study: Study, study_metrics: Mapping[str, Real], form_metrics: Mapping[str, Real]
) -> Iterator[dict[str, object]]:
    """Rows of one form: its statistics, and their differences from the study's own form on the same units.

    Without a yield against all limits where a metric that has one is not known.
    """
    confidence, seed = study.metrics.confidence, study.samples.seed
    for name in study_metrics:
        has_both = np.isfinite(study_metrics[name]) & np.isfinite(form_metrics[name])
        a, b = study_metrics[name][has_both], form_metrics[name][has_both]
        if not len(b) or np.ptp(b) == 0:
            continue
        form_statistics, study_statistics = distribution(b, confidence), distribution(a, confidence)
        ends = {"mean": mean_difference(a, b, confidence, True), **order_differences(a, b, confidence, True, seed)}
        for statistic in DIFFERENCES:
            change = form_statistics[statistic].value - study_statistics[statistic].value
            yield _row(name, statistic, form_statistics[statistic], change, ends[statistic])
    pass_flags = [study.limits.pass_flags(metrics) for metrics in (study_metrics, form_metrics)]
    for name in pass_flags[0]:
        if name == ALL_LIMITS and not set(study.limits.of_metrics) <= set(study_metrics):
            continue
        limited_metrics = study.limits.limited_metrics(name, study_metrics)
        has_both = np.all(
            [np.isfinite(study_metrics[metric]) & np.isfinite(form_metrics[metric]) for metric in limited_metrics],
            axis=0,
        )
        if has_both.any():
            of_own, of_form = (passes[name][has_both] for passes in pass_flags)
            difference = float(of_form.mean() - of_own.mean())
            ends_of_share = (
                share_difference(of_own, of_form, confidence, True) if form_metrics is not study_metrics else (0.0, 0.0)
            )
            yield _row(name, "yield", pass_share(of_form, confidence), difference, ends_of_share)


def _row(
    metric: str, statistic: str, estimate: Estimate, difference: float, ends: tuple[float, float]
) -> dict[str, object]:
    of_difference = {"difference": difference, "difference_ci_low": ends[0], "difference_ci_high": ends[1]}
    return {"metric": metric, "statistic": statistic, **vars(estimate), **of_difference}


FORMS = Stage(
    name="forms",
    reads=("sample",),
    sections=(
        "model_forms",
        "samples",
        "design",
        "clearance",
        "springs",
        "reduce",
        "cycle.has_turn_search",
        "cycle.crank_deg",
        "cycle.torque_fraction",
        "metrics",
        "limits",
    ),
    tables=(FORM_LIST, ESTIMATES, FORM_UNITS),
    module="stages.forms",
    run=_run,
)
