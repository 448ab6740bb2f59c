"""The places of a drive at which an element acts, and what an element must define at each of them.

A drive is a reducer with errors in its gaps and a list of elements:

* in series with the output: a ``Spring``, whose twist follows from the torque alone, or a ``Hysteresis``, whose twist
  depends on the path of the torque and which therefore has a state;
* in parallel with the output or at its contacts, as friction: ``Friction`` (elastic-slip elements, whose memory is the
  anchors of their sliders), or ``SlidingFriction`` of a drive whose contacts are not known;
* on the elastic parts: ``ElasticModulus``.

What depends on the crank angle is an element, or a gap, of the drive at each crank angle that its crank goes through.
What acts on the gaps changes the numbers of the drive that the gaps are computed from: ``Drive.with_added_errors`` and
``Drive.with_added_gap``. Study, fit, comparison of two measurements and blind units use ``Drive.elements`` by place and
name no single class, so a new effect is one file with its element and its ``EFFECT``.

Elements in series carry all of the torque on the turning end: seals, bearings and pins rub in the reducer, and flange,
coupling and lever lie beyond it. What friction leaves of the torque is carried by the reducer alone.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Real, Whole

AnyElement = TypeVar("AnyElement", bound="Element")

NODES = 8
"""Torques at which the energy of a spring is integrated."""


class Element:
    """Something beside the reducer; a frozen dataclass whose fields are numbers, arrays or such dataclasses."""

    def some(self: AnyElement, states: NDArray[Any] | slice) -> AnyElement:
        """The element in some of the states (n,) of its drive; itself where it does not depend on the state."""
        return self


class Spring(Element, ABC):
    """In series with the output, without memory."""

    @abstractmethod
    def twist(self, torque: Real) -> Real:
        """Rotation [rad] under torques [N mm] of any shape, in their sense and not decreasing.

        A torque of 0.0 is the limit from above and one of -0.0 that from below (``numpy.copysign``): an element with
        play has two values there.
        """

    def energy(self, torque: Real) -> Real:
        """Complementary energy under torques of any shape: the integral of the twist over the torque from none.

        By Gauss and Legendre, exact of a twist that is a polynomial of the torque up to degree 2 ``NODES`` - 1.
        """
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        half = 0.5 * np.asarray(torque, float)[..., None]
        return np.asarray((half * self.twist(half * (1 + nodes))) @ weights, float)


@dataclass(frozen=True)
class Path:
    """What an element with memory was put through, in order of time, from rest without torque.

    Attributes
    ----------
    torque : (n,) that the element carries [N mm]; 0.0 and -0.0 as in ``Spring.twist``.
    time : (n,) [s], not decreasing; None in a load cycle of a study.
    """

    torque: Real
    time: Real | None


class Hysteresis(Element, ABC):
    """In series with the output, with memory.

    Attributes
    ----------
    needs_time : whether it advances with time, and so has no response to a load cycle without.
    """

    needs_time: ClassVar[bool] = False

    @abstractmethod
    def start(self) -> Any:
        """State at rest without torque before the first point of a path: arrays or a tuple of them."""

    @abstractmethod
    def advance(self, state: Any, path: Path) -> tuple[Real, Any]:
        """Rotation [rad] at the points of a path (n,), and the state after the last of them.

        A path that is cut in two gives the same as the whole: nothing is remembered but the state, which is not
        changed in place. The torque is monotone, and the time in proportion to it, between two points.
        """

    def twist(self, path: Path) -> Real:
        """Rotation [rad] (n,) along a path from rest."""
        return self.advance(self.start(), path)[0]


def same(first: Any, second: Any) -> bool:
    """Whether two elements, or lists of them, have the same classes and numbers."""
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(same(a, b) for a, b in zip(first, second, strict=True))
    if is_dataclass(first):
        return type(first) is type(second) and all(
            same(getattr(first, field.name), getattr(second, field.name)) for field in fields(first)
        )
    return np.array_equal(first, second)


def merged_path(turns: Real, cells: Real, leg: Whole, time: Real) -> tuple[Path, Whole]:
    """A path through turns and the cells between them, and the points at which the cells stand (n_cells,).

    Parameters
    ----------
    turns, cells : torque [N mm] at the turns (n_turns,) and of the cells (n_cells,).
    leg : (n_cells,) each cell lies between turns[leg] and turns[leg + 1]; in order of time within a leg.
    time : (n_cells,) [s] of the cells.

    Notes
    -----
    The turns between two cells are passed at one speed of the torque. The first leg begins as fast as it goes
    between its first two cells, or at its first cell where that is not known.
    """
    n_turns = len(turns)
    order = np.argsort(np.concatenate([np.arange(n_turns) - 0.5, leg]), kind="stable")
    torque = np.concatenate([turns, cells])[order]
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    timed = np.append(place[leg[0]], place[n_turns:])
    times = np.append(_begin(cells, time, leg, turns), time)
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(torque)))])
    after = np.clip(np.searchsorted(timed, np.arange(len(order))), 1, len(timed) - 1)
    length = travelled[timed[after]] - travelled[timed[after - 1]]
    gone = np.clip(travelled - travelled[timed[after - 1]], 0.0, length)
    share = np.divide(gone, length, out=np.ones_like(gone), where=length > 0)
    instant = times[after - 1] + share * (times[after] - times[after - 1])
    instant[timed] = times
    return Path(torque, np.maximum.accumulate(instant)), timed[1:]


def _begin(torque: Real, time: Real, leg: Whole, turns: Real) -> float:
    """Time at which the first leg left its start, its torque as fast as between its first two cells [s]."""
    if len(torque) < 2 or leg[1] != leg[0] or torque[1] == torque[0]:
        return float(time[0])  # a load that was put on at once
    rate = (time[1] - time[0]) / (torque[1] - torque[0])
    return float(time[0] - max((torque[0] - turns[leg[0]]) * rate, 0.0))


@dataclass(frozen=True)
class ElasticModulus(Element):
    """Modulus of all elastic parts and contacts over that of the drawing.

    Attributes
    ----------
    factor : (n,) in each state of the drive.
    of_bearing : whether the stiffness of the input bearing has the same factor.
    """

    factor: Real
    of_bearing: bool = False

    def some(self, states: NDArray[Any] | slice) -> "ElasticModulus":
        """The factors of some of the states (n,)."""
        return ElasticModulus(self.factor[states], self.of_bearing)


@dataclass(frozen=True)
class RoundedPlay(Spring):
    """Gaps that close one after the other: twist = half sign(T) (1 - exp(-|T| / knee)).

    Attributes
    ----------
    half : of the play.
    knee : torque over which it is taken up, but for a share of 1/e; towards 0 it is a dead zone.

    Source
    ------
    Gaps whose closing torques are distributed exponentially; of a single gap the dead zone of Nordin and Gutman,
    Automatica 38 (2002) 1633.
    """

    half: float
    knee: float

    def twist(self, torque: Real) -> Real:
        """Rotation, in the unit of ``half``, under torques of any shape."""
        return np.copysign(self.half * -np.expm1(-np.abs(torque) / self.knee), torque)

    def energy(self, torque: Real) -> Real:
        """The integral of the twist over torques of any shape, in closed form."""
        size = np.abs(torque)
        return self.half * (size + self.knee * np.expm1(-size / self.knee))
