"""What a drive without a design may have: friction, spring, soft material, and effects that go with the crank's angle.

A term is declared here by its numbers; ``generic_drive`` makes elements of them. Sizes of a fit's steps and
bounds are shares of the loop's own largest torque and range of the angle, so that they hold for a drive of any size.
"""

from collections.abc import Mapping
from dataclasses import dataclass

TORQUE, ANGLE, COMPLIANCE, SHARE, SECONDS = "N m", "arcmin", "arcmin/(N m)", "1", "s"


@dataclass(frozen=True)
class Number:
    """A number of a drive.

    Attributes
    ----------
    unit : of its value; its scale follows from it.
    meaning : in words.
    start, low, high : of a fit, in scales: largest torque [N m], range of the angle [arcmin], or their quotient.
    """

    unit: str
    meaning: str
    start: float
    low: float
    high: float

    def scale(self, torque: float, angle: float) -> float:
        """What the others are shares of, by largest torque [N m] and range of the angle [arcmin]."""
        return {TORQUE: torque, ANGLE: angle, COMPLIANCE: angle / torque, SHARE: 1.0, SECONDS: 1.0}[self.unit]


BASIC: Mapping[str, Number] = {
    "play_arcmin": Number(ANGLE, "play: angle between the two senses without torque", 0.3, 0.0, 2.0),
    "knee_Nm": Number(TORQUE, "torque over which the play is taken up, but for a share of 1/e", 0.06, 0.002, 2.0),
    "compliance_arcmin_per_Nm": Number(COMPLIANCE, "compliance beyond the play", 0.4, 0.0, 5.0),
    "friction_Nm": Number(TORQUE, "constant friction, referred to the output", 0.05, 0.0, 0.6),
    "load_friction": Number(SHARE, "friction in proportion to the torque", 0.2, 0.0, 0.8),
}
"""Of every drive: its springs and its friction."""
SOFT: Mapping[str, Mapping[str, Number]] = {
    "asymmetry": {
        "asymmetry": Number(SHARE, "twist in the positive sense over the mean of both senses, less 1", 0.02, -0.5, 0.5)
    },
    "friction_spread": {
        "friction_spread": Number(SHARE, "spread of the thresholds at which friction lets go", 0.5, 0.0, 2.0)
    },
    "first_loading": {
        "first_loading": Number(
            SHARE, "growth of the compliance by the largest torque so far of a side", 0.3, -2.0, 3.0
        )
    },
}
"""Of soft materials and parts that differ on their two sides; the last two have a memory."""
CREEP: Mapping[str, Number] = {
    "creep_arcmin_per_Nm": Number(COMPLIANCE, "delayed compliance", 0.02, 0.0, 2.0),
    "creep_s": Number(SECONDS, "time in which 63 % of the delayed twist is reached", 20.0, 0.5, 3600.0),
}
"""Of a soft material whose loops have other rates or pauses: else it is none but friction in stages."""
BENCH: Mapping[str, Number] = {"torque_zero_Nm": Number(TORQUE, "reading of the torque without load", 0.0, -0.2, 0.2)}
"""Of the bench."""


@dataclass(frozen=True)
class CrankEffect:
    """Something that repeats as the crank turns.

    Attributes
    ----------
    title : for people.
    physics, source : what it is, and where it is described.
    signature : how it shows in measured loops.
    acts_on : "angle" (an error of the transmission: the torque sees its slope), "reading" (the encoder alone), "play"
        or "compliance".
    order : of the crank; ``per_disk`` of the disk against the crank.
    twins : effects that loops over few positions hardly tell from it.
    told_apart_by : the measurement that does.
    """

    title: str
    physics: str
    source: str
    signature: str
    acts_on: str
    order: int
    twins: tuple[str, ...]
    told_apart_by: str
    per_disk: bool = False

    def numbers(self, name: str) -> dict[str, Number]:
        """Its two amplitudes, of cosine and sine."""
        unit, start, high = (ANGLE, 0.002, 0.5) if self.acts_on in ("angle", "reading") else (SHARE, 0.01, 0.9)
        ending = "_arcmin" if unit == ANGLE else ""
        return {
            f"{name}_{part}{ending}": Number(unit, f"{self.title}: {part} over the crank angle", start, -high, high)
            for part in ("cos", "sin")
        }


ONCE_PER_TURN = ("pin_circle_runout", "flank_runout", "compliance_once", "play_once", "encoder_once")
CRANK_EFFECTS: Mapping[str, CrankEffect] = {
    "pin_circle_runout": CrankEffect(
        title="run-out of the pin circle, or of the eccentric",
        physics=(
            "the pin circle's centre lies off the housing's axis by d: the disk, pushed along the line of the crank, "
            "turns by d / (e Z) once per turn of the crank"
        ),
        source=(
            "kinematics of the pitch point, Z e from the disk's centre; Litvin and Fuentes, Gear Geometry (2004), "
            "ch. 13"
        ),
        signature=(
            "the zero of loops at locked outputs follows one wave over the crank angle, and within a loop the torque "
            "is off by the slope of that wave times the ratio"
        ),
        acts_on="angle",
        order=1,
        twins=ONCE_PER_TURN,
        told_apart_by=(
            "positions a quarter of an output turn apart (flank); an unloaded turn of the crank, which has no "
            "compliance"
        ),
    ),
    "flank_runout": CrankEffect(
        title="run-out of the flank, or of the disk's bore",
        physics="the lobes' centre lies off the bore: as before, in a frame that turns with the disk, so of order N/Z",
        source=(
            "kinematics of the pitch point, Z e from the disk's centre; Litvin and Fuentes, Gear Geometry (2004), "
            "ch. 13"
        ),
        signature=(
            "as the run-out of the pin circle, but that its phase moves by a quarter as the output turns by a quarter"
        ),
        acts_on="angle",
        order=1,
        twins=ONCE_PER_TURN,
        told_apart_by="positions a quarter of an output turn apart",
        per_disk=True,
    ),
    "encoder_once": CrankEffect(
        title="eccentric encoder at the motor",
        physics="the disc of the encoder lies off its axis: the reading is off once per turn, and no torque is",
        source="geometry of an eccentric disc, error 2 d / D",
        signature="one wave over the crank angle, with no change of the torque",
        acts_on="reading",
        order=1,
        twins=ONCE_PER_TURN,
        told_apart_by="a second encoder, or reading its eccentricity at an uncoupled motor",
    ),
    "compliance_once": CrankEffect(
        title="compliance that varies once per turn of the crank",
        physics="the load goes through other teeth, or a disk off its middle, as the crank turns",
        source="load sharing over the crank angle; Blagojevic et al., J. Mech. Des. 133 (2011)",
        signature="loops at some positions are steeper at high torque than at others half a turn of the crank away",
        acts_on="compliance",
        order=1,
        twins=ONCE_PER_TURN,
        told_apart_by="an unloaded turn of the crank: no error there",
    ),
    "play_once": CrankEffect(
        title="play that varies once per turn of the crank",
        physics="gaps of an eccentric pin circle or bore open on one side of the crank and close on the other",
        source="rigid play over the crank angle: geometry of the gaps along the line of action",
        signature="the width at zero torque follows one wave over the positions",
        acts_on="play",
        order=1,
        twins=ONCE_PER_TURN,
        told_apart_by="loops of a tenth of the torque at positions over a whole turn of the crank",
    ),
    "pin_circle_ovality": CrankEffect(
        title="oval pin circle, or misaligned coupling",
        physics="a pin circle of two lobes moves the disk twice per turn; a cardan joint before the crank does too",
        source="as the run-out, of second order",
        signature="two waves over a turn of the crank",
        acts_on="angle",
        order=2,
        twins=("pin_circle_runout",),
        told_apart_by="an unloaded turn of the crank, its orders",
    ),
}
"""Effects of the crank angle by name."""


TERMS: Mapping[str, Mapping[str, Number]] = {
    **SOFT,
    "creep": CREEP,
    "torque_zero": BENCH,
    **{name: effect.numbers(name) for name, effect in CRANK_EFFECTS.items()},
}
"""Numbers of each term that a drive may have beside the basic ones."""


def title(term: str) -> str:
    """A term in words."""
    return CRANK_EFFECTS[term].title if term in CRANK_EFFECTS else next(iter(TERMS[term].values())).meaning
