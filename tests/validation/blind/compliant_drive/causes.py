"""What is put into a drive: effects of the library of the model, by their descriptions alone, and drawn laws."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Real, Whole
from tests.validation.blind.compliant_drive.statics import UM, Curve, Disk, carried, delayed, rayleigh_twist

ARCMIN = np.pi / 180 / 60
"""Radians of an arc minute."""
NMM = 1e3
"""N mm of a N m."""
BEYOND = 1.02
"""Reach of a curve over the largest torque."""
PIECES = 24
"""Parts of a cycle in which wear stands still."""
FIRST_ROW = np.zeros(1, int)


@dataclass(frozen=True)
class Course:
    """What one position is put through: rows in time.

    Attributes
    ----------
    torque, time : (n_rows,) as read without noise [N m], from the start of the measurement [s].
    cycle : (n_rows,)
    warmer : (n_cycles,) temperature over that of the drawing [K].
    """

    torque: Real
    time: Real
    cycle: Whole
    warmer: Real

    @cached_property
    def travelled(self) -> Real:
        """Way of the torque to every row (n_rows,), over the usual one of a cycle."""
        way = np.cumsum(np.abs(np.gradient(self.torque)))
        return np.asarray(way * (self.cycle.max() + 1) / way[-1])

    def states(self, wears: bool) -> list[Whole]:
        """Rows of each cycle, or of each part of one where the drive wears."""
        part = np.floor(PIECES * self.travelled).astype(int) if wears else np.zeros(len(self.cycle), int)
        numbers = self.cycle * (part.max() + 1) + part
        return [np.flatnonzero(numbers == number) for number in np.unique(numbers)]

    @property
    def top(self) -> float:
        """Largest torque [N m]."""
        return float(np.max(np.abs(self.torque)))


@dataclass(frozen=True)
class Cause:
    """One effect of the library, largest sizes in shares of a drive's own scales.

    Attributes
    ----------
    sizes : of a drive and a course, a size that is clearly seen, for each value of the effect.
    drive : disk with the effect, by its values, the cycles travelled and the temperature.
    read : angle [arcmin] of a position by its values; None where the disk alone is changed.
    """

    sizes: Callable[[Disk, Course, np.random.Generator], Sequence[float]]
    drive: Callable[[Disk, Sequence[float], float, float], Disk] | None = None
    read: "Callable[[Position, Sequence[float]], Real] | None" = None
    needs: str = ""


@dataclass
class Position:
    """A drive at one crank angle on its course, with its elastic curves by cycle."""

    disk: Disk
    course: Course

    def __post_init__(self) -> None:
        self._curves: dict[tuple[object, ...], Curve] = {}

    def curve(self, name: str = "", values: Sequence[float] = (), rows: Whole = FIRST_ROW) -> Curve:
        """The elastic curve of the disk with an effect, in the state of some rows; kept."""
        cause = LIBRARY.get(name)
        condition = float(np.mean(self.course.travelled[rows])), float(self.course.warmer[self.course.cycle[rows[0]]])
        key = (name, *values, *(condition if cause and cause.needs in ("cycle", "temperature") else ()))
        if key not in self._curves:
            disk = self.disk
            if cause and cause.drive:
                disk = cause.drive(disk, values, *condition)
            self._curves[key] = disk.curve(1.4 * NMM * self.course.top)
        return self._curves[key]

    def angle(self, name: str = "", values: Sequence[float] = ()) -> Real:
        """Angle (n_rows,) [arcmin] without noise, with one effect of the library or none."""
        cause = LIBRARY.get(name)
        if cause and cause.read:
            return cause.read(self, values)
        if cause and cause.needs in ("cycle", "temperature"):
            angle = np.empty(len(self.course.torque))
            for rows in self.course.states(cause.needs == "cycle"):
                angle[rows] = self.curve(name, values, rows).at(NMM * self.course.torque[rows]) / ARCMIN
            return angle
        return np.asarray(self.curve(name, values).at(NMM * self.course.torque) / ARCMIN)

    def at(self, torque: Real) -> Real:
        """Angle [arcmin] of the drive without an effect at torques [N m] that it carries."""
        return np.asarray(self.curve().at(NMM * torque) / ARCMIN)

    @property
    def span(self) -> float:
        """Range of the angle [arcmin]."""
        return float(np.ptp(self.at(np.array([-self.course.top, self.course.top]))))


def _moved(disk: Disk, outwards: Real | float) -> Disk:
    return replace(disk, pins=disk.pins * (1 + outwards / np.abs(disk.pins)))


def _grown(disk: Disk, by: Real | float) -> Disk:
    return replace(disk, growth=disk.growth + by)


def _oval(order: int) -> Cause:
    def drive(disk: Disk, values: Sequence[float], travelled: float, warmer: float) -> Disk:
        around = order * np.angle(disk.pins)
        return _moved(disk, UM * (values[0] * np.cos(around) + values[1] * np.sin(around)))

    def sizes(disk: Disk, course: Course, rng: np.random.Generator) -> Sequence[float]:
        phase = rng.uniform(0, 2 * np.pi)
        return 20 * np.cos(phase), 20 * np.sin(phase)

    return Cause(sizes, drive, needs="crank")


def _worn(disk: Disk, values: Sequence[float], travelled: float, warmer: float) -> Disk:
    at = np.angle(disk.pins) - disk.turned
    pressed = np.sin((len(disk.pins) - 1) * at) * values[0] < 0
    return _grown(disk, np.where(pressed, -UM * abs(values[0]), 0.0))


def _seats(disk: Disk, values: Sequence[float], travelled: float, warmer: float) -> Disk:
    return replace(disk, compliance=disk.compliance + values[0] * np.eye(len(disk.pins)))


def _size(size: float, signed: bool = False) -> Callable[[Disk, Course, np.random.Generator], Sequence[float]]:
    return lambda disk, course, rng: (size * (float(rng.choice([-1.0, 1.0])) if signed else 1.0),)


def _of_torque(share: float, signed: bool = False) -> Callable[[Disk, Course, np.random.Generator], Sequence[float]]:
    return lambda disk, course, rng: (share * course.top * (float(rng.choice([-1.0, 1.0])) if signed else 1.0),)


def _twisting(power: float) -> Callable[[Disk, Course, np.random.Generator], Sequence[float]]:
    """Twist per torque [arcmin/(N m)^power] of 6 arcmin at the largest torque."""
    return lambda disk, course, rng: (6.0 / course.top**power,)


def _crept(position: Position, values: Sequence[float]) -> Real:
    course = position.course
    return position.at(course.torque) + values[0] * delayed(course.torque, course.time, values[1])


LIBRARY: Mapping[str, Cause] = {
    "bearing_clearance": Cause(
        _size(40.0), lambda disk, v, k, w: replace(disk, bearing=(disk.bearing[0], disk.bearing[1] + v[0]))
    ),
    "coulomb": Cause(_of_torque(0.2), read=lambda p, v: p.at(carried(p.course.torque, v[0], 0.0))),
    "load_friction": Cause(_size(0.25), read=lambda p, v: p.at(carried(p.course.torque, 0.0, v[0]))),
    "output_torsion": Cause(_twisting(1), read=lambda p, v: p.angle() + v[0] * p.course.torque),
    "rayleigh": Cause(_twisting(2), read=lambda p, v: p.angle() + rayleigh_twist(p.course.torque, v[0])),
    "creep": Cause(
        lambda disk, course, rng: (6.0 / course.top, float(np.ptp(course.time) * rng.uniform(0.02, 0.1))),
        read=_crept,
        needs="rate",
    ),
    "eccentricity_error": Cause(
        _size(30.0, signed=True), lambda disk, v, k, w: replace(disk, throw=disk.throw + UM * v[0])
    ),
    "flank_wear": Cause(_size(30.0, signed=True), _worn),
    "ovality_2": _oval(2),
    "ovality_3": _oval(3),
    "pin_circle_error": Cause(_size(20.0), lambda disk, v, k, w: _moved(disk, UM * v[0])),
    "pin_radius_error": Cause(_size(-20.0), lambda disk, v, k, w: _grown(disk, UM * v[0])),
    "preload": Cause(_size(15.0), lambda disk, v, k, w: _grown(disk, UM * v[0])),
    "seat_compliance": Cause(_size(0.03), _seats),
    "run_in": Cause(
        lambda disk, course, rng: (30.0, float(rng.uniform(0.5, 1.5))),
        lambda disk, v, k, w: _grown(disk, -UM * v[0] * (1 - float(np.exp(-k / v[1])))),
        needs="cycle",
    ),
    "thermal_growth": Cause(
        _size(60.0, signed=True), lambda disk, v, k, w: _moved(disk, 1e-6 * v[0] * w * disk.radius), needs="temperature"
    ),
    "torque_zero": Cause(_of_torque(0.15, signed=True), read=lambda p, v: p.at(p.course.torque - v[0])),
    "angle_drift": Cause(
        _size(20.0, signed=True), read=lambda p, v: p.angle() + v[0] * p.course.time / 3600, needs="zero"
    ),
}
"""By name in the library of the model."""
FIXED_VALUES = {"creep": 1, "run_in": 1}
"""Number of the value that is drawn and not scaled with the size."""


@dataclass(frozen=True)
class DrawnLaw:
    """A law outside of the library: a shape in the torque, a harmonic of the crank, and a memory.

    Attributes
    ----------
    acts : "twist", which adds to the angle, or "resistance", which takes of the torque.
    shape : "power", "step", "bump" or "wave", about ``place`` and of ``width`` in shares of the largest torque.
    even : whether it is alike in both senses of the torque.
    harmonic, phase : of the crank.
    memory : "none", "play", "lag", "branch" (unlike while the torque rises and falls) or "cycle".
    amount : of the memory, in shares of the torque, of the record or of the effect.
    """

    acts: str
    shape: str
    place: float
    width: float
    even: bool
    harmonic: int
    phase: float
    memory: str
    amount: float

    @property
    def dissipates(self) -> bool:
        """Whether its loops have an area: then it must not change its sign around the crank."""
        return self.memory in ("play", "lag", "branch")

    def of(self, load: Real) -> Real:
        """The law (n,) at loads (n,) in shares of the largest torque."""
        size, sense = np.abs(load), 1.0 if self.even else np.sign(load)
        if self.shape == "power":
            return np.asarray(sense * size ** (0.25 if self.width < 0.1 else 2.0 + 6 * self.place))
        if self.shape == "step":
            return np.asarray(sense * 0.5 * (1 + np.tanh((size - self.place) / self.width)))
        if self.shape == "bump":
            return np.asarray(sense * np.exp(-(((size - self.place) / self.width) ** 2)))
        return np.asarray(sense * np.sin(2 * np.pi * size / (4 * self.width) + self.phase))

    def angle(self, position: Position, amplitude: float) -> Real:
        """Angle (n_rows,) [arcmin] of a position with the law, its amplitude in shares of the angle or torque."""
        course = position.course
        load = course.torque / course.top
        felt = load
        if self.memory == "play":
            felt = carried(load, self.amount, 0.0)
        elif self.memory == "lag":
            felt = delayed(load, course.time, self.amount * (course.time[-1] - course.time[0]) / 10)
        wave = np.cos(self.harmonic * position.disk.crank + self.phase) if self.harmonic else 1.0
        value = self.of(felt) * (1 + 0.8 * wave if self.harmonic and self.dissipates else wave)
        if self.memory == "branch":
            value = value * np.where(np.gradient(load) > 0, 1.0, -self.amount)
        elif self.memory == "cycle":
            value = value * np.where(course.cycle % 2, 1.0, self.amount)
        if self.acts == "twist":
            return position.angle() + amplitude * position.span * value
        return position.at(course.torque - amplitude * course.top * np.clip(value, -1, 1))


def work_taken(course: Course, angle: Real) -> float:
    """Least share of the work over a loop's box that it takes: below zero a drive would give back more."""
    shares = []
    for cycle in np.unique(course.cycle):
        rows = np.flatnonzero(course.cycle == cycle)
        torque, turned = np.append(course.torque[rows], course.torque[rows[0]]), np.append(angle[rows], angle[rows[0]])
        work = float(np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(turned)))
        shares.append(work / float(np.ptp(torque) * np.ptp(turned)))
    return min(shares)


def drawn_law(rng: np.random.Generator) -> DrawnLaw:
    """A law that nobody chose."""
    return DrawnLaw(
        acts=str(rng.choice(["twist", "resistance"])),
        shape=str(rng.choice(["power", "step", "bump", "wave"])),
        place=float(rng.uniform(0.2, 0.8)),
        width=float(rng.uniform(0.05, 0.3)),
        even=bool(rng.random() < 0.5),
        harmonic=int(rng.integers(0, 4)) if rng.random() < 0.5 else 0,
        phase=float(rng.uniform(0, 2 * np.pi)),
        memory=str(rng.choice(["none", "play", "lag", "branch", "cycle"])),
        amount=float(rng.uniform(0.1, 0.6)),
    )
