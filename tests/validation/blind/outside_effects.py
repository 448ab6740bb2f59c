"""Effects that the library lacks, known to the generator alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline.arrays import Real
from tests.validation.blind.bench import Ramp
from tests.validation.blind.true_unit import Outside, Track


@dataclass(frozen=True)
class OutsideEffect:
    """An effect outside the library.

    Attributes
    ----------
    name, physics : for people.
    shape : draws what the amplitude leaves open, shares of the unit's own scales.
    angle : (n_rows,) [arcmin] of a position under the effect of an amplitude in (0, 1] and a shape.
    """

    name: str
    physics: str
    shape: Callable[[np.random.Generator], Mapping[str, float]]
    angle: Callable[[float, Mapping[str, float], Track], Real]

    def at(self, amplitude: float, shape: Mapping[str, float]) -> Outside:
        """The effect of an amplitude in (0, 1] and a shape."""
        return partial(self.angle, amplitude, shape)


def _top(ramp: Ramp) -> float:
    return float(np.max(np.abs(ramp.turns)))


def _one_sided_play(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    torque, top = track.ramp.torque, _top(track.ramp)
    lifted = np.clip((shape["sense"] * torque - shape["seat"] * top) / (0.02 * top), 0, 1)
    return track.angle_at(torque) + shape["sense"] * amplitude * track.span * lifted


def _tooth_ripple(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    smooth_angle = track.angle_at(track.ramp.torque)
    load = np.abs(track.ramp.torque) / _top(track.ramp)
    ripple = np.sin(2 * np.pi * shape["waves"] * smooth_angle / track.span + shape["phase"])
    return smooth_angle + 0.5 * amplitude * track.span * load * ripple


def _viscous(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    ramp = track.ramp
    rate = np.sign(ramp.sense) * np.abs(ramp.rate)
    slowing = np.array([shape["slow"] if cycle % 2 else 1.0 for cycle in range(ramp.n_cycles)])
    usual = np.median(np.abs(rate))
    resisted = 0.5 * amplitude * _top(ramp) * slowing[ramp.cycle] * rate / usual
    return track.angle_at(ramp.torque - resisted)


def _stick_slip(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    ramp, top = track.ramp, _top(track.ramp)
    end, begin = shape["slip"] * top, shape["stick"] * top
    stuck = (ramp.sense > 0) & (ramp.torque > begin) & (ramp.torque < end)
    lag = np.where(stuck, (ramp.torque - begin) / (end - begin), 0.0)
    return track.angle_at(ramp.torque) - amplitude * track.span * lag


def _dead_band(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    torque, top = track.ramp.torque, _top(track.ramp)
    band_centre = shape["centre"] * top
    torque_past_band = torque - band_centre
    return track.angle_at(band_centre + torque_past_band + np.sign(torque_past_band) * 0.5 * amplitude * top)


def _loose_flange(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    ramp, top = track.ramp, _top(track.ramp)
    threshold, run = shape["threshold"] * top, shape["run"] * top
    slipped, lag = np.empty(len(ramp.torque)), 0.0
    for k, torque in enumerate(ramp.torque):
        lag = max(lag, min((torque - threshold) / run, 1.0))
        lag = min(lag, max((torque + threshold) / run, -1.0))
        slipped[k] = lag
    return track.angle_at(ramp.torque) + 0.5 * amplitude * track.span * slipped


def _drawn_law(amplitude: float, shape: Mapping[str, float], track: Track) -> Real:
    """A power of the torque times a harmonic of the crank, of the torque as it is or as a lag remembers it."""
    load = track.ramp.torque / _top(track.ramp)
    felt, memory = np.empty(len(load)), 0.0
    for k, now in enumerate(load):
        memory = min(max(memory, now - shape["memory"]), now + shape["memory"])
        felt[k] = memory
    bent = np.sign(felt) ** (shape["odd"]) * np.abs(felt) ** shape["power"]
    around = np.cos(shape["harmonic"] * track.crank + shape["phase"]) if shape["harmonic"] else 1.0
    return track.angle_at(track.ramp.torque) + 0.5 * amplitude * track.span * bent * around


def _law_shape(rng: np.random.Generator) -> Mapping[str, float]:
    """A law that nobody chose: even or odd in the torque, its power, the harmonic of the crank, and its memory."""
    return {
        "odd": float(rng.integers(0, 2)),
        "power": float(rng.uniform(0.3, 4.0)),
        "harmonic": float(rng.integers(0, 4)),
        "phase": float(rng.uniform(0, 2 * np.pi)),
        "memory": float(rng.choice([0.0, rng.uniform(0.05, 0.6)])),
    }


def _uniform(**limits: tuple[float, float]) -> Callable[[np.random.Generator], Mapping[str, float]]:
    return lambda rng: {name: float(rng.uniform(low, high)) for name, (low, high) in limits.items()}


def _play_shape(rng: np.random.Generator) -> Mapping[str, float]:
    return {"sense": float(rng.choice([-1.0, 1.0])), "seat": float(rng.uniform(0.15, 0.6))}


OUTSIDE = (
    OutsideEffect(
        "one_sided_play",
        "a coupling at the output, held closed by a spring, opens beyond a torque of one sense",
        _play_shape,
        _one_sided_play,
    ),
    OutsideEffect(
        "tooth_ripple",
        "the locked shaft is held by a gear whose error, periodic in the angle, grows with the load",
        _uniform(waves=(1.5, 6.0), phase=(0.0, 2 * np.pi)),
        _tooth_ripple,
    ),
    OutsideEffect(
        "viscous_friction",
        "churning grease resists with the speed, which differs from cycle to cycle",
        _uniform(slow=(0.2, 0.5)),
        _viscous,
    ),
    OutsideEffect(
        "stick_slip",
        "something sticks on every rise of the torque and jumps free at one torque",
        _uniform(stick=(-0.3, 0.2), slip=(0.3, 0.8)),
        _stick_slip,
    ),
    OutsideEffect(
        "torque_dead_band",
        "the torque sensor reads nothing within a band about a torque",
        _uniform(centre=(0.25, 0.6)),
        _dead_band,
    ),
    OutsideEffect(
        "loose_flange",
        "a flange slips within its bolt holes once the torque exceeds its friction, and stays there",
        _uniform(threshold=(0.3, 0.65), run=(0.1, 0.3)),
        _loose_flange,
    ),
    OutsideEffect("drawn_law", "a law drawn by seed: torque, crank and memory", _law_shape, _drawn_law),
)
