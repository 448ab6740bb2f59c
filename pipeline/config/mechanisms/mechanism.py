"""What an output mechanism declares, and the library of all."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np

from pipeline.arrays import Complex, Index, Real
from pipeline.config.files.section import Mistake, Section
from pipeline.model.contact.laws import ContactLaws, Material, no_laws
from pipeline.model.geometry.contacts import Contacts, DiskPose, no_contacts
from pipeline.model.geometry.reducer import Bearing
from pipeline.registry import OUTPUT_MECHANISMS

if TYPE_CHECKING:
    from pipeline.config.designs.design import Disk
    from pipeline.config.designs.sections import Cycloid
    from pipeline.model.contact.line_laws import ContactLaw


Part = Literal["disk", "output", "between"]
"""Whose outline a circle is, or whose text: of the disk, of the output, or of a body between them."""


@dataclass(frozen=True)
class Circles:
    """Circles of one radius about the centres (n,) complex, and a text within each."""

    centre: Complex
    radius: float
    part: Part
    texts: tuple[str, ...] = ()
    text_size: float = 7.0


@dataclass(frozen=True)
class Points:
    """Points (n,) complex that are marked."""

    point: Complex


@dataclass(frozen=True)
class RowLabel:
    """A text at the end of a row that runs in a direction: it is written along the row, away from it."""

    point: complex
    direction: complex
    text: str
    part: Part


@dataclass(frozen=True)
class Panel:
    """One drawing of a part of the mechanism.

    Attributes
    ----------
    shapes : from the back to the front.
    reach : half of its width, None to show the whole disk.
    disk : whether the disk stands behind the shapes.
    """

    title: str
    shapes: tuple[Circles | Points | RowLabel, ...]
    reach: float | None = None
    disk: bool = False


@dataclass(frozen=True)
class Words:
    """What the report calls things.

    Attributes
    ----------
    contact : one output contact.
    station : axis of the contacts of one row in a figure.
    drawing, loads : captions of the drawing and of the figure of the contact forces, after what all have in common.
    without_pressure : which of its contacts have no Hertz pressure, said among the limits of the model.
    bearing : what carries a disk on its eccentric.
    rows : what a contact of each interface is called, where that differs.
    """

    contact: str
    station: str
    drawing: str
    loads: str
    without_pressure: str = ""
    bearing: str = "input bearing"
    rows: tuple[str, ...] = ()


@dataclass(frozen=True)
class Holes:
    """Equal round holes of a disk.

    Attributes
    ----------
    centres : (n_holes,) complex [mm], in the disk's frame.
    radius : [mm]
    """

    centres: Complex
    radius: float


@dataclass(frozen=True)
class LawInputs:
    """What the laws of the output contacts depend on besides the mechanism.

    Attributes
    ----------
    law : the study's choice.
    materials : by their names in the design.
    disk : material of the disk.
    thickness : of the disk [mm].
    eccentricity : [mm]
    bearing : the design's.
    patch_half_width : of a contact's pressure on the meshed disk [mm].
    """

    law: ContactLaw
    materials: Mapping[str, Material]
    disk: Material
    thickness: float
    eccentricity: float
    bearing: Bearing
    patch_half_width: float


class OutputMechanism(Section):
    """Settings of an output mechanism, and what it makes of them.

    A subclass has a field ``mechanism: Literal["<name>"]``, by which the design chooses it. ``contacts_of`` and
    ``motions_of`` are asked for each disk, by its pose.

    Attributes
    ----------
    name : as the design has it.
    words : of the report.
    diameter_readings : what the study may take a diameter's error for (``clearance.ROLLER_READINGS``), in words.
    material_keys : settings that name materials.
    interfaces : pairs of bodies in contact between a disk and the output.
    one_disk_because : why it takes no second disk; empty where it takes several.
    toleranced_diameters : whether its contacts have rollers or pins whose diameters have tolerances.
    carries_disks : whether it holds the disks' centres, in place of an input bearing.
    """

    name: ClassVar[str]
    words: ClassVar[Words]
    diameter_readings: ClassVar[Mapping[str, str]]
    material_keys: ClassVar[tuple[str, ...]]
    interfaces: ClassVar[int]
    one_disk_because: ClassVar[str] = ""
    toleranced_diameters: ClassVar[bool] = True
    carries_disks: ClassVar[bool] = False

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if "mechanism" in cls.model_fields:
            (cls.name,) = get_args(cls.model_fields["mechanism"].annotation)

    @property
    def material_names(self) -> Mapping[str, str]:
        """Materials that it is made of, by the settings that name them."""
        return {key: getattr(self, key) for key in self.material_keys}

    @property
    @abstractmethod
    def contacts(self) -> int:
        """Number of output contacts of a disk, and of those behind all disks."""

    @property
    @abstractmethod
    def contact_radius_mm(self) -> float:
        """Radius of the smaller body of a contact."""

    def patch_half_width_mm(self, share: float) -> float:
        """Half width of a contact's patch on the disk where a study states none: a share of the radius."""
        return share * self.contact_radius_mm

    @abstractmethod
    def problems(self, cycloid: Cycloid | None, disk: Disk | None) -> Iterator[Mistake]:
        """What cannot be built, of itself and with the valid ones of the other sections."""

    @abstractmethod
    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """Names of the free rigid motions of the bodies after the disk, the output's rotation among them."""

    @abstractmethod
    def contacts_of(self, disk: DiskPose) -> Contacts:
        """The contacts between a disk and the output, nominal."""

    def contacts_behind(self, disk: DiskPose) -> Contacts:
        """Contacts behind all disks, once for them all; ``disk`` is the first one."""
        return no_contacts()

    def couplings_of(self, disk: DiskPose, contacts: Contacts) -> Mapping[str, Real]:
        """What further motions close (n_contacts,) of some ``contacts`` of the output, by their names."""
        return {}

    def displacements(self, disks: Sequence[DiskPose], contacts: Contacts) -> Mapping[str, Complex]:
        """Displaced elements (n_contacts, n_elements) by dimension, see ``Reducer.displacements``.

        In the order of the dimensions that have one (``Dimension.displaces``).
        """
        return {}

    def bearing_rows(self, contacts: Contacts) -> Index:
        """Numbers of the ``contacts`` that a clearance of the design's bearing opens, where they carry the disks."""
        return np.empty(0, int)

    @abstractmethod
    def laws(self, inputs: LawInputs) -> ContactLaws:
        """Laws of the contacts in the order of ``contacts_of``."""

    def laws_behind(self) -> ContactLaws:
        """Laws of the contacts in the order of ``contacts_behind``."""
        return no_laws()

    def compliance(self, contacts: Contacts, disk: Index, materials: Mapping[str, Material]) -> Real | None:
        """What bodies behind the disks give way (n, n) [mm/N] between output contacts (n,) of these disks (n,).

        None where they are rigid.
        """
        return None

    def crank_turns(self, cycloid: Cycloid) -> float:
        """Turns of the crank, against the housing, per turn of the input."""
        return 1.0

    def crank_torque_ratio(self, cycloid: Cycloid) -> float:
        """Torque on the output per torque that the eccentrics take from the cranks, in the sense of `torque_ratio`."""
        return cycloid.torque_ratio

    @property
    def has_loose_supports(self) -> bool:
        """Whether cranks move in support bearings of the carrier."""
        return False

    def output_turns(self, cycloid: Cycloid) -> int:
        """Turns of the output after which input, crank, disks and output all stand as before."""
        return 1

    @property
    def seat_radius_mm(self) -> float:
        """Radius of the seat in which a contact's body turns that rolls on the disk."""
        return self.contact_radius_mm

    @property
    def pins_in_holes(self) -> int:
        """Pins of the flange that reach into holes of the disks, one for each output contact; 0 without any."""
        return 0

    @property
    def holes_in_disk(self) -> int:
        """Holes of a disk that have errors of their own; an output contact in one names it (``Contacts.hole``)."""
        return self.pins_in_holes

    def hole_radius(self, eccentricity: float) -> float:
        """Radius of the holes about these pins [mm]; asked where there are some.

        Raises
        ------
        TypeError
            If it has no pins in holes.
        """
        raise TypeError(f"{self.name} has no pins in holes")

    @property
    def has_bushes(self) -> bool:
        """Whether the bodies of the contacts are bushes, which roll on the disk in any case."""
        return False

    def contact_length_mm(self, thickness_mm: float) -> float:
        """Length of an output contact with a disk of a thickness."""
        return thickness_mm

    def holes(self, cycloid: Cycloid) -> Holes | None:
        """Holes that it cuts into a disk; a contact in one names it (``Contacts.hole``)."""
        return None

    @abstractmethod
    def fact(self, cycloid: Cycloid, number_text: Callable[[float], str]) -> str:
        """The mechanism in one line of the report; ``number_text`` writes a number."""

    @abstractmethod
    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """Drawings of the ``contacts`` of one disk, which have these ``numbers`` (n,) in the tables."""


@cache
def library() -> Mapping[str, type[OutputMechanism]]:
    """All mechanisms by name: the files beside this one and what packages register."""
    return OUTPUT_MECHANISMS.declarations()
