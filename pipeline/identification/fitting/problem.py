"""A measured unit against its model: cells, drives, what is not known of them, and what may be added."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from scipy.linalg import svd

from pipeline.arrays import Real, Truth
from pipeline.identification.bench.instrument_effects import FEWEST_WAVES, InstrumentEffect, instrument_effects
from pipeline.identification.bench.load_path import Instrument
from pipeline.identification.bench.simulator import Forward
from pipeline.identification.fitting.data import Data, TurningData
from pipeline.identification.measurement.enough import FEWEST_COMPARED, FEWEST_OF_A_WAVE, UNLOADED_SHARE
from pipeline.model.effects import Conditions, Effect, library
from pipeline.model.effects.effect import CRANKS, CYCLES, MOVES, TEMPERATURE, TIME
from pipeline.model.geometry.clearance import Errors
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import SECONDS_AN_HOUR
from pipeline.sampling.errors import Errors as SampledErrors
from pipeline.statistics.resampling import LEVEL

Candidate = Effect | InstrumentEffect

STATE_EFFECTS = frozenset({CYCLES, TEMPERATURE})
LIMIT = 3.0
"""Standard deviations of the population that a mode of the tolerances may move, within which a dimension is no effect:
further out lies what no drawing allows."""
LEAST_RECORD = 2.0
"""Longest time constant over the shortest where the record is no longer than its sampling interval."""
REMAINING_SHARE = 0.75
"""Structure, in the noise of a cell, that the form of the model may leave: with the noise, 1.25 of it."""


@dataclass(frozen=True)
class Problem:
    """What is fitted.

    Attributes
    ----------
    data : the cells.
    training : (n_cells,) those that noise, bounds, modes and what is offered are of: others are held out of all of it.
    trained_on : the same problem of other training cells.
    forward : predictions on their courses, all legs in a drive's first state.
    forward_by_state : predictions with every cycle in its own state.
    stations : per position, the numbers of its drives: one, or where the crank turns within the loop those of the crank
        angles that it goes through.
    halvings : of the distance between the stations (``stations_of``).
    drives : of the declared unit at scale factors (n_scales,) and the number of a station.
    calibrated_keys : keys of the design's calibrated numbers, whose scales come first.
    scale_range : (2, n_scales) logarithms of the factors between which each scale is plausible; scales after those of
        the calibrated numbers are of the force laws of pins and output.
    short_range : the same where contacts may be on a part of the width.
    modes : patterns of gaps of the unmeasured tolerances per station (n_modes, n_contacts) [mm], of unit variance.
    influences : per station d angle / d gap along the frictionless curve (n_nodes, n_contacts) [rad/mm].
    compliances : per station, of the disks between the contacts as condensed (n_contacts, n_contacts) [mm/N].
    conditions : per station, of the states of its drive.
    met_needs : what the data have of what effects need (``effects.effect``).
    rated_torque : [N m]
    mean_unit : dimensions of the unit without any mode [um], one sample.
    modes_of_errors : amounts of the modes (n_modes,) to deviations [mm] from the usual dimensions.
    """

    data: Data
    training: Truth
    trained_on: "Callable[[Truth], Problem]"
    forward: Forward
    forward_by_state: Forward
    stations: tuple[range, ...]
    halvings: int
    drives: Callable[[tuple[float, ...], int], Drive]
    calibrated_keys: tuple[str, ...]
    scale_range: Real
    short_range: Real
    modes: tuple[Real, ...]
    influences: tuple[Real, ...]
    compliances: tuple[Real, ...]
    conditions: tuple[Conditions, ...]
    met_needs: frozenset[str]
    rated_torque: float
    mean_unit: SampledErrors
    modes_of_errors: Callable[[Real], Errors]

    @property
    def n_modes(self) -> int:
        return len(self.modes[0])

    @cached_property
    def span(self) -> float:
        """Largest range of the angle at a position [arcmin]."""
        trained_positions = self.data.position[self.training]
        return max(
            float(np.ptp(self.data.angle[self.training][trained_positions == p])) for p in np.unique(trained_positions)
        )

    @cached_property
    def hours(self) -> float:
        """Longest time that a position was measured [h]; one hour without time stamps."""
        trained_positions = np.unique(self.data.position[self.training])
        return max(float(np.ptp(self.forward.courses[p].time)) for p in trained_positions) / SECONDS_AN_HOUR or 1.0

    @cached_property
    def waves(self) -> tuple[float, float]:
        """Fewest and most waves of a ripple over the range of the angle.

        Half of the fewest lie where the drive is loaded: waves within the play are passed at once, and a part of one is
        a bend of the curve. The rows of a usual branch resolve one for every two of them; by the sampling theorem finer
        ones look like coarser ones (Shannon, Proc. IRE 37 (1949) 10).
        """
        data, training = self.data, self.training
        sense = np.sign(data.torque) * (np.abs(data.torque) > UNLOADED_SHARE * np.max(np.abs(data.torque[training])))
        loaded_range = max(
            sum(float(np.ptp(data.angle[at & (sense == s)])) for s in (1, -1) if np.any(at & (sense == s)))
            for at in (training & (data.position == p) for p in np.unique(data.position[training]))
        )
        rows = np.bincount(data.block[training], data.count[training])
        most = float(np.median(rows[rows > 0])) / 2
        return FEWEST_WAVES * max(1.0, 0.5 * self.span / max(loaded_range, 1e-9)), most

    @cached_property
    def record(self) -> Mapping[str, float]:
        """Lengths that time constants are held against: of a position in time [s], and in cycles [1]."""
        position, cycle = self.data.position[self.training], self.data.cycle[self.training]
        cycles = [len(np.unique(cycle[position == p])) for p in np.unique(position)]
        return {TIME: self.hours * SECONDS_AN_HOUR, CYCLES: float(max(cycles))}

    @cached_property
    def interval(self) -> Mapping[str, float]:
        """Shortest times that are resolved: the usual one from cell to cell [s], and one cycle [1]."""
        training_positions = np.unique(self.data.position[self.training])
        steps = np.concatenate([np.diff(self.forward.courses[p].time) for p in training_positions])
        return {TIME: float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0, CYCLES: 1.0}

    @cached_property
    def nominal(self) -> tuple[Drive, ...]:
        """Declared drives."""
        return tuple(self.drives((1.0,) * len(self.scale_spread), station) for station in range(len(self.modes)))

    def with_short_contacts(self) -> "Problem":
        """The problem, and that of any other training cells, with the ranges of contacts on a part of the width."""
        of_others = self.trained_on
        return replace(
            self, scale_range=self.short_range, trained_on=lambda training: of_others(training).with_short_contacts()
        )

    @property
    def scale_spread(self) -> Real:
        """Prior standard deviation (n_scales,) of the logarithm of each scale: its range holds two on either side."""
        spread: Real = np.ptp(self.scale_range, axis=0) / 4
        return spread

    def bounds(self, candidate: Candidate) -> tuple[tuple[float, float], ...]:
        """(low, high) of every parameter of an effect; of a time constant within what the record resolves."""
        key = candidate.name, len(candidate.parameters)
        if key not in self._bounds:
            self._bounds[key] = self._bounds_of(candidate)
        return self._bounds[key]

    @cached_property
    def _bounds(self) -> dict[tuple[str, int], tuple[tuple[float, float], ...]]:
        """Bounds of the effects that were asked for, by name and number of parameters: a fit asks at every step."""
        return {}

    def candidates_for(self, offered: Mapping[str, Candidate], cells: Truth) -> dict[str, Candidate]:
        """Those of some effects that some cells (n_cells,) can test, with the parameters that this unit gives them."""
        count = len(self.forward.courses)
        return {
            name: effect.of_positions(count) if isinstance(effect, InstrumentEffect) else effect
            for name, effect in offered.items()
            if not self.why_not(effect, cells)
        }

    def _bounds_of(self, candidate: Candidate) -> tuple[tuple[float, float], ...]:
        bounds = (
            candidate.bounds(self.rated_torque, self.span, self.hours, self.waves)
            if isinstance(candidate, InstrumentEffect)
            else candidate.bounds(self.nominal[0])
        )
        return tuple(
            self._time_constant_bounds(parameter.record, *ends) if parameter.record else ends
            for parameter, ends in zip(candidate.parameters, bounds, strict=True)
        )

    def _time_constant_bounds(self, record: str, low: float, high: float) -> tuple[float, float]:
        """Bounds of a time constant: to the length of the record, from where 95 % is over at the second reading."""
        shortest = float(np.clip(self.interval[record] / np.log(1 / LEVEL), low, high))
        return shortest, max(float(np.clip(self.record[record], low, high)), LEAST_RECORD * shortest)

    def within_tolerance(self, model: "Model", values: Sequence[float]) -> bool:
        """Whether an effect of the model is a dimension that stays within what the tolerances allow.

        Tolerances within ``LIMIT`` of the usual unit then follow its change of the frictionless curves but for what
        the noise hides.
        """
        nominal = first_states(self.nominal)
        for effect, parameters in model.split(values):
            if isinstance(effect, InstrumentEffect) or effect.needs & STATE_EFFECTS:
                continue
            gaps = [effect.apply(drive, parameters, Conditions.run_in(1)).gap - drive.gap for drive in nominal]
            if any(np.any(gap) for gap in gaps) and self._left_by_tolerances(gaps) < REMAINING_SHARE * self.data.noise:
                return True
        return False

    def _left_by_tolerances(self, gaps: Sequence[Real]) -> float:
        """Rms [arcmin] of what modes within ``LIMIT`` leave of a change of gaps, per position (1, n_contacts) [mm]."""
        one_zero = isinstance(self.data, TurningData)
        (change,) = _curves(gaps, self.influences, one_zero)
        patterns = _curves(self.modes, self.influences, one_zero)
        sizes = np.linalg.lstsq(patterns.T, change, rcond=None)[0]
        sizes *= min(1.0, LIMIT / max(float(np.linalg.norm(sizes)), LIMIT))
        return float(np.sqrt(np.mean((change - sizes @ patterns) ** 2)))

    def why_not(self, candidate: Candidate, cells: Truth | None = None) -> str:
        """Why the data, or some cells (n_cells,) of them, cannot test an effect; empty if they can."""
        offered_names = set(self.met_needs)
        if cells is not None and len(np.unique(self.data.position[cells])) < FEWEST_COMPARED:
            offered_names.discard(CRANKS)
        reasons = [self.data.shortfalls[need] for need in sorted(candidate.needs - offered_names)]
        if isinstance(candidate, InstrumentEffect) and candidate.common_offset and MOVES not in self.met_needs:
            n_positions = len(np.unique(self.data.position if cells is None else self.data.position[cells]))
            if not self.data.common_offset:
                reasons.append("every position has its own zero of the angle")
            elif n_positions < FEWEST_OF_A_WAVE and self.forward.courses[0].encoder_turns <= 1:
                reasons.append(f"offsets of {n_positions} positions lie on some wave; {FEWEST_OF_A_WAVE} can test one")
        if not reasons and not all(low < high for low, high in self.bounds(candidate)):
            (fewest, most), is_ripple = self.waves, isinstance(candidate, InstrumentEffect) and candidate.own_phases
            no_range = "the angle of a position has no range" + (" outside of the play" if is_ripple else "")
            reasons.append("a branch has too few rows" if is_ripple and most <= fewest else no_range)
        return "; ".join(reasons)


def _curves(gaps: Sequence[Real], influences: Sequence[Real], one_zero: bool) -> Real:
    """Change of the curves of all positions (n, n_nodes n_positions) [arcmin] by gaps, per position (n, n_contacts).

    Each less its mean, or with ``one_zero`` less that of all.
    """
    curves = [ARCMIN * gap @ influence.T for gap, influence in zip(gaps, influences, strict=True)]
    if one_zero:
        curves_of_stations = np.concatenate(curves, axis=1)
        centred: Real = curves_of_stations - curves_of_stations.mean(axis=1, keepdims=True)
        return centred
    return np.concatenate([curve - curve.mean(axis=1, keepdims=True) for curve in curves], axis=1)


def candidates() -> Mapping[str, Candidate]:
    """Every effect of the library and of the bench by name."""
    return {**library(), **instrument_effects()}


def twins(name: str) -> tuple[str, ...]:
    """Effects that curves alone hardly tell from one: those that it says it is confused with, or that name it."""
    library = candidates()
    confusable = [candidate for candidate, effect in library.items() if name in effect.confused_with]
    return tuple(dict.fromkeys([*library[name].confused_with, *confusable]))


def limit_cases() -> Mapping[str, str]:
    """By name of an effect, the simpler one that it becomes at a limit of its parameters."""
    return {name: effect.limit_case for name, effect in candidates().items() if effect.limit_case}


def with_limit_cases(names: Iterable[str]) -> set[str]:
    """Effects, the simpler ones that they become at a limit of their parameters, and those that become them."""
    simpler_effects, included_names = limit_cases(), set(names)
    more_general = {name for name, simpler in simpler_effects.items() if simpler in included_names}
    return included_names | more_general | {simpler_effects.get(name, name) for name in included_names}


@dataclass(frozen=True)
class Model:
    """A set of effects that are put into the declared drives."""

    effects: tuple[Candidate, ...] = ()

    @property
    def name(self) -> str:
        """Names of the effects in alphabetical order, joined by +."""
        return "+".join(sorted(effect.name for effect in self.effects))

    @property
    def n_parameters(self) -> int:
        return sum(len(effect.parameters) for effect in self.effects)

    @property
    def n_effects(self) -> int:
        return len(self.effects)

    @property
    def places(self) -> list[tuple[Candidate, slice]]:
        """Every effect, and where its parameters stand among all."""
        ends = list(accumulate((len(effect.parameters) for effect in self.effects), initial=0))
        return [(effect, slice(*pair)) for effect, pair in zip(self.effects, pairwise(ends), strict=True)]

    def split(self, values: Sequence[float]) -> list[tuple[Candidate, Sequence[float]]]:
        """Every effect with its own values."""
        return [(effect, values[place]) for effect, place in self.places]

    def put(
        self, drives: Sequence[Drive], conditions: Sequence[Conditions], values: Sequence[float]
    ) -> tuple[list[Drive], Instrument]:
        """Drives and instrument with the effects at ``values``."""
        drives_with_effects, instrument = list(drives), Instrument()
        for effect, parameters in self.split(values):
            if isinstance(effect, InstrumentEffect):
                instrument = effect.apply(instrument, parameters)
            else:
                drives_with_effects = [
                    effect.apply(drive, parameters, condition)
                    for drive, condition in zip(drives_with_effects, conditions, strict=True)
                ]
        return drives_with_effects, instrument

    @property
    def by_state(self) -> bool:
        """Whether the drive differs from cycle to cycle."""
        return any(effect.needs & STATE_EFFECTS for effect in self.effects)


def first_states(drives: Sequence[Drive]) -> tuple[Drive, ...]:
    """The drives in their first state alone."""
    return tuple(drive.first_state for drive in drives)


@dataclass(frozen=True)
class PriorModes:
    """Principal curves of a population of units: the patterns of gaps that its units differ by.

    Attributes
    ----------
    gaps : per position (n_units, n_contacts) [mm], less their means.
    units : (n_units, n_components) what each unit has of each component.
    sizes : (n_components,) of the components [arcmin, root of the sum over units and nodes].
    nodes : of a position's curve.
    """

    gaps: tuple[Real, ...]
    units: Real
    sizes: Real
    nodes: float

    @classmethod
    def from_population(cls, gaps: Sequence[Real], influences: Sequence[Real]) -> "PriorModes":
        """The components of a population.

        Parameters
        ----------
        gaps : per position (n_units, n_contacts) [mm], the same units at every position.
        influences : per station d angle / d gap at the nodes of the backbone (n_nodes, n_contacts) [rad/mm].
        """
        centred_gaps = tuple(of_units - of_units.mean(axis=0) for of_units in gaps)
        curves = np.concatenate(
            [unit @ effect.T for unit, effect in zip(centred_gaps, influences, strict=True)], axis=1
        )
        # by bidiagonal QR: divide and conquer, the default, fails on some curves of fewer components than units
        units, sizes, _ = svd(ARCMIN * curves, full_matrices=False, lapack_driver="gesvd")
        return cls(centred_gaps, units, sizes, curves.shape[1] / len(gaps))

    def above(self, resolution: float) -> tuple[Real, ...]:
        """Patterns of gaps of unit variance, per position (n_modes, n_contacts) [mm]."""
        weights = self.weights(resolution)
        return tuple(weights @ of_units for of_units in self.gaps)

    def weights(self, resolution: float) -> Real:
        """What each mode has of each unit (n_modes, n_units): amounts times these are a combination of units.

        Modes of the population's curves, not of its gaps, so that fewer are left: the smallest, which together change
        the curves by less than the ``resolution`` [arcmin rms], are left out.
        """
        n = len(self.units)
        left_out_with = np.sqrt(np.cumsum(self.sizes[::-1] ** 2)[::-1] / (n * self.nodes))
        large = left_out_with > resolution
        # a unit's coefficient of mode m is its row of units times sqrt(n - 1), of variance 1
        return self.units[:, large].T * np.sqrt(1 / (n - 1)) if np.any(large) else np.zeros((0, n))
