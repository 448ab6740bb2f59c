"""Least squares of a model's effects, calibrated numbers and unmeasured tolerances against the cells of a unit.

Unmeasured tolerances and calibrated numbers are held by their priors (a penalty), so that an effect must explain what
they cannot. The influence of tolerances on the curve comes from the forces of the equilibria
(``Backbone.influence``), and so do derivatives by all that changes gaps and springs; an iteration costs one prediction
more for each parameter of friction and of the instrument.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness, Rounding, Shortcut, ShortcutCount, ShortcutGrid
from pipeline.identification.bench.load_path import Instrument
from pipeline.identification.bench.simulator import Drives, Forward
from pipeline.identification.fitting.least_squares import Descent
from pipeline.identification.fitting.parameters import Fit, Prediction, Vector, shares_of_zero, values_at_shares
from pipeline.identification.fitting.problem import Model, Problem, first_states
from pipeline.model.load_history.drive import Drive

STEP: Rounding = 2e-4
"""Step of the finite differences, as a share of a parameter's bounds."""
SCALES_MOVED: Shortcut = 0.15
"""Change of a scale's logarithm up to which derivatives by the scales are kept."""
PASSES: ShortcutCount = 4
"""Passes by which a fit is refined, at most."""
FALL_OF_PASS: Shortcut = 2.0
"""Fall of the sum of squares, that of one nat, from which a further pass is tried."""
FALL_OF_LARGE_MISFIT: Shortcut = 0.02
"""The same as a share of the sum of squares beyond noise: where a fit misses much, smaller falls do not matter."""
WELL_FITTED: Shortcut = 1.1
"""Mean square of a cell, in noise, below which further starts are not refined: one start of the model without effects
is then enough, and so is a plain fit of a ripple."""
ITERATIONS: ShortcutCount = 15
"""Least-squares steps of a fit unless the caller asks for others."""
LOADS: ShortcutGrid = (0.6, 0.4, 0.2, 0.1)
"""Shares of the largest torque above which cells are fitted, one after the other."""
FIRST_ITERATIONS: ShortcutCount = 3
"""Steps of a fit from each of several starts before the best of them goes on, and before cells are added."""
KEPT_GAPS: Fineness = 16
"""Values of effects of which the gaps at each station are kept: those of an iteration."""
OPEN_SHARE = 0.3
"""Prior standard deviation of an effect's parameter, in shares of its bounds, about no effect (or the middle of the
bounds of a parameter without a zero). It decides where the data leave a valley, and is weak beside what they tell."""


class Fitter:
    """Fits of one problem; ``fit`` may be called for any model and any cells."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.positions = range(len(problem.stations))
        self._known_gaps: dict[tuple[object, ...], tuple[Drive, Real]] = {}

    def start(self, model: Model, shares: Real | None = None) -> Vector:
        """No scale, no tolerance, parameters at ``shares``; scales are held to their plausible ranges."""
        start_shares = np.full(model.n_parameters, 0.5) if shares is None else np.asarray(shares, float)
        reach = self.problem.scale_range
        return Vector(np.zeros(reach.shape[1]), start_shares, np.zeros(self.problem.n_modes), reach)

    def bounds(self, model: Model) -> list[tuple[float, float]]:
        """Bounds of all parameters of a model."""
        return [pair for effect in model.effects for pair in self.problem.bounds(effect)]

    def drives(
        self, model: Model, unknowns: Vector, positions: Sequence[int] | None = None
    ) -> tuple[Mapping[int, Drives], Instrument]:
        """Drives of all stations by position, of some or all positions, and instrument at the unknowns."""
        problem, scales = self.problem, tuple(np.exp(unknowns.scales))
        numbers = self.positions if positions is None else positions
        stations = [station for position in numbers for station in problem.stations[position]]
        declared_drives = [problem.drives(scales, station) for station in stations]
        shifted_drives = [
            drive.with_added_gap(unknowns.modes @ problem.modes[station]) if problem.n_modes else drive
            for station, drive in zip(
                stations, declared_drives if model.by_state else first_states(declared_drives), strict=True
            )
        ]
        conditions = [problem.conditions[station] for station in stations]
        values = values_at_shares(self.bounds(model), unknowns.shares).tolist()
        put, instrument = model.put(shifted_drives, conditions, values)
        key = *(effect.name for effect in model.effects), model.by_state, *values
        by_station = {k: self._with_known_gap(drive, (k, *key)) for k, drive in zip(stations, put, strict=True)}
        return {number: tuple(by_station[k] for k in problem.stations[number]) for number in numbers}, instrument

    def _with_known_gap(self, drive: Drive, key: tuple[object, ...]) -> Drive:
        """A drive with the gap of its errors; effects at the same values leave the same gaps at all force laws."""
        if drive.known_gap is not None:
            return drive
        key = (*key, id(drive.reducer), drive.profile)
        if key not in self._known_gaps:
            if len(self._known_gaps) > KEPT_GAPS * len(self.problem.conditions):
                self._known_gaps.clear()
            self._known_gaps[key] = drive, drive.gap_of_errors  # the drive keeps its reducer, and so the key's place
            return drive
        return replace(drive, known_gap=self._known_gaps[key][1])

    def predict(
        self, model: Model, unknowns: Vector, positions: Sequence[int] | None = None, modes: bool = False
    ) -> Prediction:
        """Prediction at the unknowns; the influence of the modes where it is asked for."""
        problem, data = self.problem, self.problem.data
        forward = self.forward(model)
        drives, instrument = self.drives(model, unknowns, positions)
        angle, slope, carried_torque, response, balances = np.full((5, len(data)), np.nan)
        influence = np.zeros((len(data), problem.n_modes))
        sound = is_in_range = True
        for position in self.positions if positions is None else positions:
            of_position = data.position == position
            reading = forward.read(drives[position], position, instrument)
            angle[of_position], carried_torque[of_position] = reading.angle, reading.carried_torque
            slope[of_position], response[of_position] = reading.slope, reading.response
            balances[of_position] = reading.balances
            sound = sound and reading.sound and bool(np.all(np.isfinite(reading.angle)))
            is_in_range = is_in_range and reading.is_in_range
            if modes and problem.n_modes:
                modes_of_stations = [problem.modes[station] for station in problem.stations[position]]
                of_curve = forward.influence(drives[position], position, reading.carried_torque, modes_of_stations)
                influence[of_position] = answered(of_curve, reading.response)
        return Prediction(angle, influence, carried_torque, slope, response, balances, sound, is_in_range=is_in_range)

    def mean_of_draws(
        self, model: Model, unknowns: Vector, prediction: Prediction, draws: Real, positions: Sequence[int]
    ) -> tuple[Real, Real]:
        """Means over draws of the modes of the change of the angle (n_cells,), and of its influence (n_cells, n_modes).

        ``draws`` (n_draws, n_modes) are added to the modes at which the prediction was made. See
        ``Forward.mean_of_draws``.
        """
        problem, (drives, _) = self.problem, self.drives(model, unknowns, positions)
        change, influence = np.zeros(len(problem.data)), np.zeros((len(problem.data), problem.n_modes))
        for position in positions:
            of_position = problem.data.position == position
            modes = [problem.modes[station] for station in problem.stations[position]]
            gaps = [draws @ of_station for of_station in modes]
            of_curve = self.forward(model).mean_of_draws(
                drives[position], position, prediction.carried_torque[of_position], gaps, modes
            )
            response = prediction.response[of_position]
            change[of_position], influence[of_position] = (answered(values, response) for values in of_curve)
        return change, influence

    def forward(self, model: Model) -> Forward:
        """What predicts a model: with every cycle in its own state where an effect asks for that."""
        return self.problem.forward_by_state if model.by_state else self.problem.forward

    def _change(
        self,
        model: Model,
        base: tuple[Mapping[int, Drives], Instrument],
        moved_unknowns: Vector,
        prediction: Prediction,
        positions: Sequence[int],
    ) -> Real:
        """Change of the angle (n_cells,) [arcmin] from drives and instrument, where it is known, to ``moved_unknowns``.

        To first order from the forces there, and from the slope of the curve where a ripple changes; predicted anew
        where friction or anything else of the instrument changes.
        """
        drives, instrument = base
        moved_drives, moved_instrument = self.drives(model, moved_unknowns, positions)
        change, forward = np.full(len(prediction.angle), np.nan), self.forward(model)
        for position in positions:
            of_position = self.problem.data.position == position
            response = prediction.response[of_position]
            slope = prediction.slope[of_position] / response
            by_ripple = forward.change_by_ripple(position, instrument, moved_instrument, slope)
            by_drive = None
            if by_ripple is not None:
                by_drive = forward.change(
                    drives[position], moved_drives[position], position, prediction.carried_torque[of_position]
                )
            if by_ripple is None or by_drive is None:
                return self.predict(model, moved_unknowns, positions).angle - prediction.angle
            change[of_position] = answered(by_drive + by_ripple, response)
        return change

    def centred_values(self, values: Real, weight: Real) -> Real:
        """Values (n, ...) less their weighted mean over the cells that share an offset."""
        centred_values = values - 0.0
        for group in self.problem.data.spans:
            has_weight = weight[group] > 0
            if np.any(has_weight):
                group_weight = weight[group][has_weight]
                centred_values[group] -= group_weight @ values[group][has_weight] / group_weight.sum()
        return centred_values

    def offsets(self, angle: Real, is_fitted: Truth, sigma: Real) -> Real:
        """Offset of every cell (n_cells,) [arcmin]: over the cells fitted of its group, or its own where none is."""
        return self.problem.data.offsets(angle, is_fitted, sigma)

    def fit(
        self, model: Model, is_fitted: Truth, start: Vector, iterations: int = ITERATIONS, base_fit: Fit | None = None
    ) -> Fit:
        """Least squares over the cells ``is_fitted`` (n_cells,) by Levenberg and Marquardt, from ``start``.

        Derivatives by the scales are taken over from ``base_fit`` and from step to step while scales hardly move.
        """
        descent = Descent(self, model, is_fitted, start, base_fit)
        descent.run(iterations)
        return self._fit_of(descent)

    def fit_averaged(self, model: Model, is_fitted: Truth, start: Vector) -> Fit:
        """As ``fit``, after steps by derivatives that are averaged about the unknowns (``Descent.run_averaged``)."""
        descent = Descent(self, model, is_fitted, start, None)
        descent.run_averaged()
        descent.run(ITERATIONS)
        return self._fit_of(descent)

    def fit_by_load(self, model: Model, is_fitted: Truth, start: Vector) -> Fit:
        """As ``fit``, to the cells of large torques first, then to those of smaller ones, too.

        Where the torque is large, many contacts share it, and the misfit is smooth in the unknowns. Close to the play
        one contact or two carry it; which of them is a kink, at which a descent from far away ends. A few steps lead
        to where the next cells are added: a fit that has settled without them is no better a start.
        """
        torque = np.abs(self.problem.data.torque)
        for share in LOADS:
            is_loaded = is_fitted & (torque > share * np.max(torque[is_fitted], initial=0.0))
            start = self.fit(model, is_loaded, start, FIRST_ITERATIONS).unknowns if np.any(is_loaded) else start
        return self.fit(model, is_fitted, start)

    def refine(self, fit: Fit, is_fitted: Truth, start: Vector) -> Fit:
        """The best of a fit and of passes, the first of them from ``start``.

        A pass fits by averaged derivatives, then the cells of large torques first. Where one of
        these ends at a kink, the other often leads on.
        """
        best = fit
        for _ in range(PASSES):
            cost_before = best.cost
            for fit_further in (self.fit_averaged, self.fit_by_load):
                further = fit_further(fit.model, is_fitted, start)
                best = further if further.sound and further.cost < best.cost - FALL_OF_PASS else best
                start = best.unknowns
            beyond_noise = best.cost - np.count_nonzero(is_fitted)
            if cost_before - best.cost <= max(FALL_OF_PASS, FALL_OF_LARGE_MISFIT * beyond_noise):
                break
        return best

    def fit_from_best(
        self,
        model: Model,
        is_fitted: Truth,
        starts: Sequence[Vector],
        base_fit: Fit | None = None,
        rival_cost: float = np.inf,
    ) -> Fit:
        """As ``fit``, from the start of several from which the first steps lead farthest.

        It ends where it will not come down to ``rival_cost``, in the noise, though all its steps fell as the last.
        """
        descents = [Descent(self, model, is_fitted, start, base_fit) for start in starts]
        for descent in descents:
            descent.run(FIRST_ITERATIONS, rival_cost, ITERATIONS - FIRST_ITERATIONS)
        best_descent = min(descents, key=lambda descent: descent.in_noise if descent.prediction.sound else np.inf)
        best_descent.run(ITERATIONS - FIRST_ITERATIONS, rival_cost)
        return self._fit_of(best_descent)

    def _fit_of(self, descent: Descent) -> Fit:
        """The fit at the end of a descent, predicted at all positions; of no cost where an equilibrium is missing."""
        model, unknowns, prediction = descent.model, descent.unknowns, descent.prediction
        if len(descent.positions) < len(self.positions):
            prediction = self.predict(model, unknowns)
        angle, is_found = prediction.angle, bool(np.isfinite(descent.cost))
        if not is_found:
            angle = np.full(len(angle), np.nan)
        return Fit(
            model=model,
            unknowns=unknowns,
            values=values_at_shares(self.bounds(model), unknowns.shares),
            predicted_angle=angle + self.offsets(angle, descent.is_fitted, descent.sigma),
            cost=descent.in_noise if is_found else np.inf,
            jacobian=descent.jacobian,
            sigma=descent.sigma,
            balances=prediction.balances,
            sound=is_found and prediction.sound and prediction.is_in_range,
        )

    def fit_at(self, fit: Fit, flat: Real, is_fitted: Truth) -> Fit:
        """A fit's model at other unknowns (n_unknowns,), held to their bounds, with its derivatives there."""
        moved_fit, prediction = self.predicted_fit(fit, flat, is_fitted, modes=True)
        weight = np.where(is_fitted, 1 / fit.sigma**2, 0.0)
        jacobian, _ = self.jacobian(fit.model, moved_fit.unknowns, prediction, self.positions, weight, None)
        return replace(moved_fit, jacobian=jacobian, sound=moved_fit.sound and bool(np.all(np.isfinite(jacobian))))

    def predicted_fit(self, fit: Fit, flat: Real, is_fitted: Truth, modes: bool = False) -> tuple[Fit, Prediction]:
        """A fit's model at other unknowns (n_unknowns,), with the derivatives of the fit, and its prediction there."""
        unknowns = fit.unknowns.like(flat)
        prediction = self.predict(fit.model, unknowns, modes=modes)
        angle = prediction.angle + self.offsets(prediction.angle, is_fitted, fit.sigma)
        misfit = ((self.problem.data.angle - angle) / self.problem.data.sigma)[is_fitted]
        deviation = self.penalty(unknowns) * (unknowns.flat - self.centre(fit.model, unknowns))
        moved_fit = replace(
            fit,
            unknowns=unknowns,
            values=values_at_shares(self.bounds(fit.model), unknowns.shares),
            predicted_angle=angle,
            cost=float(misfit @ misfit + deviation @ deviation),
            balances=prediction.balances,
            sound=prediction.sound and prediction.is_in_range,
        )
        return moved_fit, prediction

    def penalty(self, vector: Vector) -> Real:
        """Inverse prior standard deviation of every unknown."""
        spread = np.full(len(vector.shares), OPEN_SHARE)
        return np.concatenate([1 / self.problem.scale_spread, 1 / spread, np.ones(len(vector.modes))])

    def centre(self, model: Model, vector: Vector) -> Real:
        """Mean of the prior of every unknown (n_unknowns,)."""
        zero = shares_of_zero(self.bounds(model), np.full(len(vector.shares), 0.5))
        return np.concatenate([np.zeros(len(vector.scales)), zero, np.zeros(len(vector.modes))])

    def jacobian(
        self,
        model: Model,
        unknowns: Vector,
        prediction: Prediction,
        positions: Sequence[int],
        weight: Real,
        known_derivatives: tuple[Real, Real] | None,
    ) -> tuple[Real, tuple[Real, Real]]:
        """d angle / d unknowns (n_cells, n_unknowns), offsets removed; and for which scales its first columns are."""
        first_share = len(unknowns.scales)
        usable = (
            known_derivatives
            if known_derivatives is not None
            and np.max(np.abs(known_derivatives[0] - unknowns.scales), initial=0.0) < SCALES_MOVED
            else None
        )
        columns = [] if usable is None else [usable[1][:, k] for k in range(first_share)]
        base = self.drives(model, unknowns, positions)
        for k in range(len(columns), first_share + len(unknowns.shares)):
            flat = unknowns.flat
            step = -STEP if k >= first_share and flat[k] > 0.5 else STEP
            flat[k] += step
            columns.append(self._change(model, base, unknowns.like(flat), prediction, positions) / step)
        raw = np.column_stack([*columns, prediction.influence]) if columns else prediction.influence
        jacobian = self.centred_values(np.nan_to_num(raw), weight)
        return jacobian, (unknowns.scales if usable is None else usable[0], jacobian)


def answered(change: Real, response: Real) -> Real:
    """Change (n_cells, ...) of the angle of a position where its curve changes so, with the response of a ripple.

    A change that is alike everywhere is one of the zero of the angle, which is measured, and no ripple answers it.
    """
    if np.all(response == 1):
        return change
    common = np.median(change, axis=0)
    return np.asarray(common + ((change - common).T * response).T)
