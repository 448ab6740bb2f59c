"""Friction as elastic-slip elements in the equilibrium, so that loading and unloading part as on a bench.

A slider resists a slip u = direction . q of the rigid motions q by tau = stiffness (u - anchor), held to
+-(limit + coefficient F) with F the force of its contact, or the torque that the reducer carries to its output where
the slider has none; where it is held, the anchor follows. Sliders in parallel with different limits make a Maxwell-slip
(presliding) element, those with a coefficient friction that grows with the load.

Source: Jenkins' element and Iwan's parallel arrangement (J. Appl. Mech. 33 (1966) 893).
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Real
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.reducer import Reducer

TANGENTIAL = 0.8
"""Tangential over normal stiffness of a contact; Mindlin's 2(1 - nu)/(2 - nu) is 0.82 for nu = 0.3."""


@dataclass(frozen=True)
class Sliders:
    """Elastic-slip elements, arrays (n_sliders, ...).

    Attributes
    ----------
    direction : (n_sliders, n_motions) slip per rigid motion [mm/mm, mm/rad]; of a rotation [rad/rad].
    stiffness : [N/mm], [N mm/rad] of a rotation.
    limit : part of the largest resistance that does not depend on the load [N], [N mm].
    coefficient : of friction [-]; of a slider without contact: friction torque over torque carried [-].
    contact : contact whose force presses on it, -1 for none.
    """

    direction: Real
    stiffness: Real
    limit: Real
    coefficient: Real
    contact: np.ndarray

    def __len__(self) -> int:
        return len(self.stiffness)

    @classmethod
    def none(cls, n_motions: int = 0) -> "Sliders":
        """No friction."""
        empty = np.zeros(0)
        return cls(np.zeros((0, n_motions)), empty, empty, empty, np.zeros(0, np.int64))

    @cached_property
    def at_contacts(self) -> bool:
        """Whether any of them is pressed by a contact."""
        return bool(np.any(self.contact >= 0))

    @cached_property
    def acting(self) -> "Sliders":
        """Those that can resist at all."""
        able = (self.limit > 0) | (self.coefficient > 0)
        return self if able.all() else Sliders(*(getattr(self, f.name)[able] for f in fields(Sliders)))

    def resisted(self, torque: Real) -> Real:
        """Approximate torque [N mm] that friction resists at output torques [N mm] of any shape.

        Sliders at contacts share the load, and together resist about their coefficient times the torque.
        """
        at_contact = self.contact >= 0
        share = np.max(self.coefficient[at_contact], initial=0.0) + np.sum(self.coefficient[~at_contact])
        return np.asarray(np.sum(self.limit[~at_contact]) + share * np.abs(torque))

    def of_scaled_load(self, factor: float) -> "Sliders":
        """The sliders where the load that presses on them is written ``factor`` times as large."""
        return self if factor == 1.0 else replace(self, coefficient=self.coefficient / factor)

    def with_others(self, addition: "Sliders") -> "Sliders":
        """These and the others."""
        if not len(self):
            return addition
        return Sliders(*(np.concatenate([getattr(self, f.name), getattr(addition, f.name)]) for f in fields(Sliders)))


def output_sliders(reducer: Reducer, limit: Real, distance: Real) -> Sliders:
    """Friction torques ``limit`` (n,) [N mm] on the output, each fully raised after the ``distance`` (n,) [rad]."""
    return _on_output(reducer, limit / distance, np.asarray(limit, float), np.zeros(len(limit)))


def load_slider(reducer: Reducer, coefficient: float, rated_torque: float, distance: float) -> Sliders:
    """Friction torque on the output of ``coefficient`` times the torque carried.

    That of the ``rated_torque`` [N mm] is raised after the ``distance`` [rad].
    """
    stiffness = np.array([coefficient * rated_torque / distance])
    return _on_output(reducer, stiffness, np.zeros(1), np.array([coefficient]))


def _on_output(reducer: Reducer, stiffness: Real, limit: Real, coefficient: Real) -> Sliders:
    n = len(stiffness)
    direction = np.zeros((n, len(reducer.motions)))
    direction[:, reducer.output_motion] = 1.0
    return Sliders(direction, stiffness, limit, coefficient, np.full(n, -1))


def pin_sliders(reducer: Reducer, laws: ContactLaws, coefficient: float, rated_torque: float) -> Sliders:
    """Friction between pins and flank; rollers of the output roll and have none.

    The tangential stiffness is ``TANGENTIAL`` times the law's at the force of a pin when a quarter of the pins share
    the ``rated_torque`` [N mm].
    """
    n, motions = reducer.n_pins, reducer.motions
    direction = np.zeros((n, len(motions)))
    for disk, rows in zip(reducer.disks, np.split(np.arange(n), reducer.n_disks), strict=True):
        tangent, from_centre = 1j * disk.pins.normal, disk.pins.point - disk.eccentric
        direction[rows, motions.index(f"{disk.body}_x")] = tangent.real
        direction[rows, motions.index(f"{disk.body}_y")] = tangent.imag
        direction[rows, motions.index(f"{disk.body}_phi")] = np.real(np.conj(disk.pins.normal) * from_centre)
        if reducer.rolling:  # by 1/Z about the pitch point, Z eccentricities beyond the centre
            rolled_distance = reducer.rolling * from_centre - disk.eccentric
            direction[rows, reducer.output_motion] = np.real(np.conj(disk.pins.normal) * rolled_distance)
    force = np.full(len(laws), rated_torque / (0.25 * np.sum(np.abs(reducer.pins.arm))))
    stiffness = TANGENTIAL / laws.compliance(force)[:n]
    return Sliders(direction, stiffness, np.zeros(n), np.full(n, coefficient), np.arange(n))
