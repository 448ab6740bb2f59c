"""Effects of the bench, not of the reducer: what the instrument adds to what it reads."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.constant_kinds import Fineness
from pipeline.identification.bench.load_path import Instrument, Ripple
from pipeline.model.effects import Parameter
from pipeline.model.effects.effect import CRANKS, LOOPS, RATE, TIME, TORQUES, EffectDescription
from pipeline.model.units import ARCMIN, NMM_PER_NM

FEWEST_WAVES = 4
"""Waves of a ripple over the measured range of the angle: with fewer it is no staircase."""

MOST_WAVES: Fineness = 60
"""The same at most: finer ones are far from any motor's, and the search over them is long."""


@dataclass(frozen=True)
class InstrumentEffect(EffectDescription):
    """An effect of the bench.

    ``bounds`` is a function of the rated torque [N m], of the range of the angle measured at one position [arcmin],
    of the time that it took [h], and of the fewest and most waves that may be over this range. ``common_offset`` says
    that the effect is seen only where all positions share one zero of the angle, ``own_phases`` that each position has
    its own phase, ``is_of_angle`` that its ripple is one of the angle read, not of the torque.
    """

    bounds: Callable[[float, float, float, tuple[float, float]], tuple[tuple[float, float], ...]]
    apply: Callable[[Instrument, Sequence[float]], Instrument]
    needs: frozenset[str] = frozenset()
    common_offset: bool = False
    limit_case: str = ""
    starts: str = "secants"
    own_phases: bool = False
    is_of_angle: bool = False

    def of_positions(self, count: int) -> "InstrumentEffect":
        """The effect with the phase of each further position, less that at the first, as a parameter of its own.

        Its bounds are two turns apart, so that a fit may pass the end of one, and no zero is among them, which is a
        phase like any other.
        """
        if not self.own_phases or count < 2:
            return self
        numbers = range(2, count + 1)
        phases = [Parameter(f"phase_{k}_rad", "rad", f"phase at position {k}", of_position=True) for k in numbers]
        bounds = self.bounds
        return replace(
            self,
            parameters=(*self.parameters, *phases),
            bounds=lambda *of_unit: (*bounds(*of_unit), *((np.pi, 5 * np.pi),) * len(phases)),
        )


def _waves_per_turn(waves: float, span: float) -> float:
    """Waves per turn of the output that are so many over a range of the angle [arcmin]."""
    return float(2 * np.pi * waves * ARCMIN / span)


def _ripple(instrument: Instrument, values: Sequence[float]) -> Instrument:
    cosine, sine, waves, *phases = values
    ripple = Ripple(NMM_PER_NM * float(np.hypot(cosine, sine)), waves, float(np.arctan2(cosine, sine)))
    return replace(instrument, ripple=ripple, ripple_phases=tuple(phases))


def _interpolation(instrument: Instrument, values: Sequence[float]) -> Instrument:
    cosine, sine, waves, *phases = values
    error = Ripple(float(np.hypot(cosine, sine)), waves, float(np.arctan2(cosine, sine)))
    return replace(instrument, interpolation=error, interpolation_phases=tuple(phases))


EFFECTS = (
    InstrumentEffect(
        name="torque_zero",
        title="zero offset of the torque sensor",
        physics="the sensor reads a torque where there is none",
        source="definition",
        parameters=(Parameter("torque_Nm", "N m", "reading at no torque"),),
        changes="torque read",
        signature="the loop is off centre along the torque",
        confused_with=("flank_wear",),
        told_apart_by="the torque sensor unloaded and unmounted",
        bounds=lambda rated_torque, span, hours, waves: ((-0.3 * rated_torque, 0.3 * rated_torque),),
        apply=lambda instrument, values: replace(instrument, torque_zero=values[0]),
        needs=frozenset({TORQUES}),
    ),
    InstrumentEffect(
        name="torque_gain",
        title="gain error of the torque sensor",
        physics="the sensor reads too much or too little in proportion",
        source="definition",
        parameters=(Parameter("gain", "1", "relative error of the torque read"),),
        changes="torque read",
        signature="all of the curve is stretched along the torque, friction too",
        confused_with=("output_torsion", "seat_compliance"),
        told_apart_by="the torque sensor under a known weight",
        bounds=lambda rated_torque, span, hours, waves: ((-0.3, 0.5),),
        apply=lambda instrument, values: replace(instrument, torque_gain=values[0]),
        needs=frozenset({TORQUES}),
    ),
    InstrumentEffect(
        name="torque_creep",
        title="creep of the torque sensor",
        physics="under constant torque the reading of the sensor still changes: a share of it comes with a delay",
        source="creep of load cells, OIML R 60 (2017); first-order delay, as the standard linear solid has",
        parameters=(
            Parameter("share", "1", "part of the torque that is read with the delay"),
            Parameter("time_s", "s", "time in which 63 % of it is reached", record=TIME),
        ),
        changes="torque read",
        signature="loops open with slow loading, most where the curve is steep",
        confused_with=("creep",),
        told_apart_by="the torque sensor under a known weight, read for as long as a loop takes",
        bounds=lambda rated_torque, span, hours, waves: ((-0.3, 0.3), (0.05, 1e4)),
        apply=lambda instrument, values: replace(instrument, torque_creep=(values[0], values[1])),
        needs=frozenset({TIME, RATE, LOOPS, TORQUES}),
    ),
    InstrumentEffect(
        name="angle_drift",
        title="drift of the angle",
        physics="the zero of the angle moves with time",
        source="definition",
        parameters=(Parameter("drift_arcmin_per_h", "arcmin/h", "drift"),),
        changes="angle read",
        signature="cycles are shifted from one another by equal steps, loops do not close",
        confused_with=("creep", "run_in"),
        told_apart_by="the angle over an hour without load",
        bounds=lambda rated_torque, span, hours, waves: ((-2 * span / hours, 2 * span / hours),),
        apply=lambda instrument, values: replace(instrument, drift=values[0]),
        needs=frozenset({TIME}),
    ),
    InstrumentEffect(
        name="encoder_eccentricity",
        title="eccentricity of the encoder",
        physics="the encoder's disk turns about a point off its centre: its reading errs once a turn",
        source="Ramaswamy, Precision Eng. 3 (1981); first harmonic of the reading",
        parameters=(
            Parameter("cosine_arcmin", "arcmin", "amplitude at crank angle zero"),
            Parameter("sine_arcmin", "arcmin", "amplitude a quarter turn of the encoder on, counterclockwise"),
        ),
        changes="angle read, with the encoder's own angle",
        signature="offsets of the positions, and twist, vary once a turn of the encoder",
        confused_with=("ovality_2", "ovality_3"),
        told_apart_by="an encoder with two heads half a turn apart",
        bounds=lambda rated_torque, span, hours, waves: ((-2 * span, 2 * span),) * 2,
        apply=lambda instrument, values: replace(instrument, encoder=(values[0], values[1])),
        needs=frozenset({CRANKS}),
        common_offset=True,
    ),
    InstrumentEffect(
        name="motor_cogging",
        title="cogging of the motor",
        physics="the motor's torque varies with its angle: a ripple locked to the angle; from position to position the "
        "output turns by many waves, which are not known to a part of one, so that each position has its own phase",
        source="Hanselman, Brushless Permanent Magnet Motor Design (2003), ch. 5",
        parameters=(
            Parameter("cosine_Nm", "N m", "amplitude of the cosine, at the output"),
            Parameter("sine_Nm", "N m", "amplitude of the sine, at the output"),
            Parameter("waves_per_turn", "1", "waves per turn of the output"),
        ),
        changes="torque in the reducer: that read less the ripple at the angle measured",
        signature="a staircase of constant step in the angle, most where the curve is steep",
        confused_with=("encoder_interpolation",),
        told_apart_by="the torque of the motor alone, turned slowly by hand; the waves per turn are a multiple of the "
        "number of its poles or slots",
        starts="periods",
        own_phases=True,
        bounds=lambda rated_torque, span, hours, waves: (
            (-0.15 * rated_torque, 0.15 * rated_torque),
            (-0.15 * rated_torque, 0.15 * rated_torque),
            (_waves_per_turn(waves[0], span), _waves_per_turn(min(waves[1], MOST_WAVES), span)),
        ),
        apply=_ripple,
        needs=frozenset({CRANKS, LOOPS}),
    ),
    InstrumentEffect(
        name="encoder_interpolation",
        title="interpolation error of the encoder",
        physics="the signals of an encoder are no pure sines, so that the reading errs by a wave within each of their "
        "periods; from position to position the output turns by many periods, so that each position has its own phase",
        source="Heydemann, Appl. Opt. 20 (1981) 3382",
        parameters=(
            Parameter("cosine_arcmin", "arcmin", "amplitude of the cosine"),
            Parameter("sine_arcmin", "arcmin", "amplitude of the sine"),
            Parameter("waves_per_turn", "1", "waves per turn of the output"),
        ),
        changes="angle read, by a wave of the angle measured",
        signature="a wave of constant step in the angle, as large at every torque",
        confused_with=("motor_cogging",),
        told_apart_by="the same loop with another encoder; the waves per turn are a multiple of its lines",
        starts="periods",
        own_phases=True,
        is_of_angle=True,
        bounds=lambda rated_torque, span, hours, waves: (
            (-0.05 * span, 0.05 * span),  # a fifth of the longest period that is looked for
            (-0.05 * span, 0.05 * span),
            (_waves_per_turn(waves[0], span), _waves_per_turn(min(waves[1], MOST_WAVES), span)),
        ),
        apply=_interpolation,
        needs=frozenset({CRANKS, LOOPS}),
    ),
)


def instrument_effects() -> Mapping[str, InstrumentEffect]:
    """All effects of the bench by name."""
    return {effect.name: effect for effect in EFFECTS}
