"""An output that turns with the disk: a coupling without play and compliance, for models that state no output."""

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import TYPE_CHECKING, Literal

from pipeline.arrays import Index
from pipeline.config.files.section import Mistake
from pipeline.config.mechanisms.mechanism import LawInputs, OutputMechanism, Panel, Words
from pipeline.model.contact.laws import ContactLaws, no_laws
from pipeline.model.geometry.contacts import Contacts, DiskPose, no_contacts

if TYPE_CHECKING:
    from pipeline.config.designs.design import Disk
    from pipeline.config.designs.sections import Cycloid


class Direct(OutputMechanism):
    """The disk's rotation is the output's, whatever its centre does: an ideal Oldham coupling, without contacts."""

    words = Words(contact="output contact", station="output contact", drawing="", loads="")
    diameter_readings = {"half_diameter": "the output has no contacts", "diameter": "the output has no contacts"}
    material_keys = ()
    interfaces = 1

    mechanism: Literal["direct"]

    @property
    def contacts(self) -> int:
        """Output contacts: none."""
        return 0

    @property
    def contact_radius_mm(self) -> float:
        """Radius of a contact's body, which no patch can be too wide for."""
        return inf

    def problems(self, cycloid: "Cycloid | None", disk: "Disk | None") -> Iterator[Mistake]:
        """Several disks, which cannot all be the output: nothing would share the torque out among them."""
        if disk and disk.count > 1:
            requirement = 'must be 1 with mechanism = "direct": the disk is the output; take another mechanism'
            yield Mistake("disk.count", disk.count, requirement)

    def motions_of(self, disk: DiskPose) -> tuple[str, ...]:
        """None of its own: the torque acts on the disk's rotation."""
        return ()

    def contacts_of(self, disk: DiskPose) -> Contacts:
        """No contacts."""
        return no_contacts()

    def laws(self, inputs: LawInputs) -> ContactLaws:
        """No laws."""
        return no_laws()

    def fact(self, cycloid: "Cycloid", number_text: Callable[[float], str]) -> str:
        """The coupling in words."""
        return "turns with the disk, without play and compliance; no mechanism is modelled"

    def panels(self, disk: DiskPose, contacts: Contacts, numbers: Index) -> Sequence[Panel]:
        """The disk alone."""
        return [Panel("The disk, which is the output", (), disk=True)]


MECHANISM = Direct
