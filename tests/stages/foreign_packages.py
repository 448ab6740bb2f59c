"""Modules that strangers might write: one effect, metric, law, distribution, ... of their own."""

RUBBER = """
from pipeline.model.effects import Effect, Parameter
from pipeline.model.effects.compliance import LinearSpring
EFFECT = Effect(
    name="{name}", title="rubber coupling", physics="twists in proportion to the torque", source="Hooke",
    parameters=(Parameter("twist", "1", "rotation per torque [1e-9 rad/(N mm)]"),),
    changes="torsion", signature="softer", confused_with=("output_torsion",), told_apart_by="the coupling alone",
    bounds=lambda drive: ((0.0, 100.0),),
    apply=lambda drive, values, conditions: drive.with_elements(LinearSpring(1e-9 * values[0])),
)
"""

WINDUP = """
from pipeline.model.metrics import Metric
METRIC = Metric(
    name="windup_arcmin", title="Windup at full torque", unit="arcmin", decimals=2, rank=90,
    definition="Difference in angle between +{{rigidity_high:g}} and -{{rigidity_high:g}} N m.",
    value=lambda loop, definitions: loop.high_plus - loop.high_minus,
)
"""
LINEAR = """
import numpy as np
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.contact.line_laws import ContactLaw
def linear(contact, compliance):
    zero = np.zeros_like(contact.radius)
    return ContactLaws(zero + compliance, zero, zero, zero + 1, zero + np.inf, contact.pressure_factor)
LAW = ContactLaw(
    name="hooke", title="linear springs", source="Hooke, 1678",
    on_mesh=lambda contact, radius, patch: linear(contact, 2e-5),
    on_solid=lambda contact, radius: linear(contact, 2e-5),
    between_flats=lambda sides, radius, depth: linear(sides[0], 3e-5),
)
"""
ARCSINE = """
from typing import Literal
import numpy as np
from pipeline.config.distributions import Spread
class Arcsine(Spread):
    distribution: Literal["arcsine"]
    def deviation(self, probability):
        lower, upper = self.limits_um
        return self.middle_um - (upper - lower) / 2 * np.cos(np.pi * probability)
    def details(self, plain):
        yield f"a vibration of amplitude {plain((self.upper_um - self.lower_um) / 2)} µm"
        yield from super().details(plain)
"""
FOUR_LOBED = """
from pipeline.config.dimensions.pins import ovality
DIMENSION = ovality(4, "four-lobed", rank=110, draw_columns=(12, 13))
"""
DOGS = """
from typing import Literal
import numpy as np
from pipeline.config.mechanisms.mechanism import Circles, Panel
from pipeline.config.mechanisms.mechanism import OutputMechanism, Words
from pipeline.config.files.section import Clearance, Millimetres, Mistake
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.contacts import OUTPUT, Contacts
class Dogs(OutputMechanism):
    words = Words(contact="dog", station="dog", drawing="Dogs are round.", loads="half of the dogs carry each sense.")
    diameter_readings = {"half_diameter": "half of the diameter error of a dog"}
    material_keys = ()
    interfaces = 1
    mechanism: Literal["dogs"]
    radius_mm: Millimetres
    clearance_um: Clearance
    @property
    def contacts(self):
        return 4
    @property
    def contact_radius_mm(self):
        return 1.5
    def problems(self, cycloid, disk):
        if disk and self.radius_mm <= disk.bore_radius_mm:
            yield Mistake("output.radius_mm", self.radius_mm, f"must be > {disk.bore_radius_mm:g} mm, the bore")
    def motions_of(self, disk):
        return ("output_phi",)
    def contacts_of(self, disk):
        zero, number, side = np.zeros(4, int), np.arange(4), np.array([1, 1, -1, -1])
        arm = np.exp(1j * (disk.rotation + np.pi * number))
        return Contacts(
            kind=np.full(4, OUTPUT), body_a=np.full(4, disk.body), body_b=np.full(4, "output"),
            interface=zero, face=zero, end=zero, station=number, hole=zero - 1,
            label=np.array([f"dog {k}" for k in number]), gap=np.full(4, 1e-3 * self.clearance_um),
            two_sided=np.zeros(4, bool), per_eccentricity=np.zeros(4), curvature=np.zeros(4),
            point=disk.eccentric + self.radius_mm * arm, normal=1j * side * arm, arm=1.0 * side * self.radius_mm,
        )
    def laws(self, inputs):
        zero = np.zeros(4)
        return ContactLaws(zero + 1e-5, zero, zero, zero + 1, zero + np.inf, zero + 1)
    def fact(self, cycloid, plain):
        return f"four dogs {plain(self.radius_mm)} mm off the axis"
    def panels(self, disk, contacts, numbers):
        return [Panel("Dogs", (Circles(contacts.point, 1.5, "output", tuple(map(str, numbers))),), disk=True)]
MECHANISM = Dogs
"""
IDLE = """
from pipeline.config.dimensions import Dimension
DIMENSION = Dimension(name="colour", title="colour", sign="dark", meaning="of the disk", rank=120, draw_columns=(12,))
"""
PLAY = """
from matplotlib.figure import Figure
from pipeline.report.frames import Drawing
from pipeline.report.sections import Section
KINEMATIC = "clearance/kinematic"
def drawn(kinematic):
    figure = Figure()
    figure.subplots().plot(kinematic["crank_deg"], kinematic["backlash_arcmin"], "o")
    return figure
def drawings(frames):
    yield Drawing("rigid_play", "Play of rigid bodies", "Of every sample.", lambda: drawn(frames.tables[KINEMATIC]))
SECTION = Section(
    name="play", title="Play <rigid>", rank=75, tables=(KINEMATIC,), drawings=drawings,
    template='''{% from "macros.html" import figure with context %}
<p>{{ rows|counted("row") }}, at most {{ "%.6f"|format(most) }} arcmin.</p>
{{ figure("rigid_play") }}
''',
    values=lambda page: {
        "rows": len(page.frames.tables[KINEMATIC]), "most": page.frames.tables[KINEMATIC]["backlash_arcmin"].max(),
    },
    applies=lambda frames: not frames.is_listed,
)
"""
