"""Contacts that elastic bodies couple to each other, brought together: those of a disk do not feel another's.

Nearly every reducer has one block. Its loops are compiled without the axis of the blocks, which costs a sixth of the
time of one disk and saves a sixth of that of two.
"""

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Index, Real, Truth
from pipeline.model.compiled import algebraic_part


@dataclass(frozen=True)
class Blocks:
    """Contacts in an order in which each block of them is a range, and what they give way.

    Attributes
    ----------
    order : (n_contacts,) the blocks in the order of their first contacts, then the contacts between rigid bodies, which
        belong to the last block; of one block its own.
    ranges : (n_blocks, 2) first contact of a block in that order, and the first beyond.
    compliance : (n_contacts, longest block) [mm/N] between a contact, in that order, and each of its block.
    self_compliance : (n_contacts,) [mm/N] of a contact, in that order, under its own force.
    """

    order: Index
    ranges: Index
    compliance: Real
    self_compliance: Real


def coupled_blocks(compliance: Real) -> Blocks:
    """Blocks of the contacts that a ``compliance`` (n_contacts, n_contacts) [mm/N] couples.

    Those of an array that cannot be written, as of cranks at all angles, are kept until the next one.
    """
    if compliance.flags.writeable:
        return _coupled_blocks(compliance)
    kept = _KEPT.get("last")
    if kept is None or kept[0] is not compliance:
        kept = _KEPT["last"] = compliance, _coupled_blocks(compliance)
    return kept[1]


_KEPT: dict[str, tuple[Real, Blocks]] = {}


def _coupled_blocks(compliance: Real) -> Blocks:
    n, self_compliance = len(compliance), np.diag(compliance).copy()
    elastic = self_compliance > 0.0
    one_block = Blocks(np.arange(n), np.array([[0, n]]), np.ascontiguousarray(compliance), self_compliance)
    if np.all(compliance[np.argmax(elastic), elastic]):  # most reducers have one elastic body, or none
        return one_block
    layout = _layout(np.packbits(compliance != 0.0).tobytes(), n)
    if layout is None:
        return one_block
    order, ranges, places = layout
    block_values = np.append(compliance, 0.0)[places]
    return Blocks(order, ranges, block_values, self_compliance[order])


@lru_cache(maxsize=16)
def _layout(packed: bytes, n: int) -> tuple[Index, Index, Index] | None:
    """Order and ranges of the blocks of ``n`` contacts, and which number of the matrix stands where in theirs.

    ``packed`` has the bits of the matrix of coupled pairs, which hardly changes with the crank angle: it is kept.
    None of one block; what no number of the matrix fills is the one behind them.
    """
    is_coupled = np.unpackbits(np.frombuffer(packed, np.uint8), count=n * n).reshape(n, n).astype(bool)
    elastic, component = np.diag(is_coupled), _first_coupled(is_coupled)
    of_bodies = np.unique(component[elastic])
    if len(of_bodies) < 2:
        return None
    rank = np.where(elastic, component, n)
    order = np.argsort(rank, kind="stable")
    bounds = np.concatenate([np.searchsorted(rank[order], of_bodies), [n]])
    ranges = np.column_stack([bounds[:-1], bounds[1:]])
    places = np.full((n, int(np.max(np.diff(bounds)))), n * n)
    for start, end in ranges:
        rows = order[start:end]
        places[start:end, : end - start] = n * rows[:, None] + rows
    return order, ranges, places


def _first_coupled(is_coupled: Truth) -> Index:
    """The first contact that each (n,) is coupled to, by way of others too; itself if none."""
    n = len(is_coupled)
    first_contact = np.arange(n)
    while True:
        spread = np.minimum(np.where(is_coupled, first_contact, n).min(axis=1, initial=n), first_contact)
        if np.array_equal(spread, first_contact):
            return first_contact
        first_contact = spread


class Part(NamedTuple):
    """What a sample's solve has of one block; see ``Workspace``."""

    active: Index
    miss: Real
    slope: Real
    inside: Real
    logarithm: Real
    bits: Index
    slack: Real
    inverse: Real
    projection: Real


class Deflections(NamedTuple):
    """Deflections of the contacts of one block, active or not."""

    elastic: Real
    depth: Real


class Friction(NamedTuple):
    """The sliders, see ``contact.friction_elements.Sliders``, and their states in one sample's solve.

    None takes its place without sliders, and is compiled away.
    """

    direction: Real  # (n_sliders, n_motions)
    stiffness: Real  # (n_sliders,)
    limit: Real
    coefficient: Real
    contact: np.ndarray
    anchor: Real  # (n_sliders,) slip of every slider without resistance [mm, rad]
    resistance: Real  # (n_sliders,) [N, N mm]; where a slider does not resist, what it did before
    stick: Real  # its slope against the slip
    grip: Real  # its slope against what presses on the slider
    trial: Real  # its resistance if it stuck
    pressing_force: Real  # what presses on it
    slip_step: Real  # changes of its slip and of what presses on it within the step
    press_step: Real
    resisting: np.ndarray  # sliders that resist
    position: np.ndarray  # (n_contacts,) of the active contacts in the list of their block
    row: Real  # (n_motions,)


class System(NamedTuple):
    """What every sample shares: arms, compliance, force laws and the bearing of one crank angle."""

    contact_jacobian: Real  # (n_motions, n_contacts)
    compliance: Real  # (n_contacts, longest block) [mm/N] between a contact and each of its block
    self_compliance: Real  # (n_contacts,) [mm/N] of a contact under its own force
    blocks: Index  # (n_blocks, 2) first contact of a block, and the first beyond
    block: np.ndarray  # (n_contacts,) to which a contact belongs
    moving: np.ndarray  # (n_blocks, n_motions) whether a motion moves any contact of a block
    linear: Real  # the laws' numbers (n_contacts,), see contact.ContactLaws
    logarithmic: Real
    power: Real
    exponent: Real
    limit: Real
    arm: Real  # (n_motions,) largest entry of contact_jacobian of a motion
    output: int  # motion on which the torque acts
    planar: bool  # whether bearings hold the disks' translations, which are the first motions
    bearings: int  # input bearings, one a disk
    stiffness: float  # a bearing's, and its exponent
    bearing_exponent: float


class Workspace(NamedTuple):
    """Room for one sample's solve. Active contacts of a block and the first of them are in the order of ``active``."""

    counts: np.ndarray  # solved steps with the same active contacts, sliders that resist
    sizes: Index  # (n_blocks, 3) active contacts of a block, coupled ones of them, those in the inverse
    active: Index  # (n_blocks, longest block), here and below without the first axis where there is one block
    motion: Real  # (n_motions,) [mm, rad]
    force: Real  # (n_contacts,) [N]
    elastic: Real  # (n_contacts,) deflection of the elastic bodies [mm]
    depth: Real  # (n_contacts,) local deflection that is left [mm]
    miss: Real  # (n_blocks, longest block) of the active contacts' deflection [mm], then the step of their forces [N]
    slope: Real  # (n_blocks, longest block) compliance of the active contacts' laws [mm/N]
    balance: Real  # (n_motions,) what is unbalanced
    step: Real  # (n_motions,)
    tangent: Real  # (n_motions, n_motions)
    schur: Real  # (n_motions, n_motions) jacobian^T H^-1 jacobian of the contacts in the inverse
    inverse: Real  # (n_blocks, longest, longest block) of H = law' + C over the first active contacts
    projection: Real  # (n_blocks, n_motions, longest block) H^-1 jacobian of them
    column: Real  # (n_contacts,)
    inside: Real  # (n_blocks, longest block) active forces, held to the laws' range, and their logarithms
    logarithm: Real
    bits: np.ndarray  # the memory of ``logarithm`` as integers
    slack: Real  # (n_blocks, longest block) of the active contacts, in the interior-point iteration [mm]
    thrust: Real  # (n_disks,) force of each input bearing
    spring: Real  # (n_disks, 8) see bearing_springs


_ROOM = threading.local()
"""The last ``kept_workspace`` of each thread."""


def kept_workspace(system: System) -> Workspace:
    """A workspace that this thread's next system takes too if it is as large: what is in it lasts until then."""
    size = (*system.contact_jacobian.shape, system.compliance.shape[1], len(system.blocks), system.bearings)
    if getattr(_ROOM, "size", None) != size:
        _ROOM.size, _ROOM.room = size, workspace(system)
    room: Workspace = _ROOM.room
    return room


def workspace(system: System) -> Workspace:
    """Arrays for solves of a system."""
    (n_motions, n_contacts), longest = system.contact_jacobian.shape, system.compliance.shape[1]
    motions, contacts = (n_motions,), (n_contacts,)
    blocks = (len(system.blocks),) if len(system.blocks) > 1 else ()
    lists = (*blocks, longest)
    logarithm = np.zeros(lists)
    return Workspace(
        counts=np.zeros(2, np.int64),
        sizes=np.zeros((len(system.blocks), 3), np.int64),
        active=np.zeros(lists, np.int64),
        motion=np.zeros(motions),
        force=np.zeros(contacts),
        elastic=np.zeros(contacts),
        depth=np.zeros(contacts),
        miss=np.zeros(lists),
        slope=np.zeros(lists),
        balance=np.zeros(motions),
        step=np.zeros(motions),
        tangent=np.zeros(motions * 2),
        schur=np.zeros(motions * 2),
        inverse=np.zeros((*lists, longest)),
        projection=np.zeros((*blocks, n_motions, longest)),
        column=np.zeros(contacts),
        inside=np.zeros(lists),
        logarithm=logarithm,
        bits=logarithm.view(np.int64),
        slack=np.zeros(lists),
        thrust=np.zeros(system.bearings),
        spring=np.zeros((system.bearings, 8)),
    )


def with_axis_of_blocks(work: Workspace) -> Workspace:
    """The same room with the axis of the blocks, of one block too: what is seldom run is compiled once for all."""
    if work.active.ndim == 2:
        return work
    return work._replace(**{name: getattr(work, name)[np.newaxis] for name in Part._fields})


@algebraic_part
def count(active: Index) -> int:
    """Number of blocks, of which ``active`` (n_blocks, longest block), or without the first axis of one, has lists."""
    if active.ndim == 1:
        return 1
    n_blocks: int = active.shape[0]
    return n_blocks


@algebraic_part
def part_of(active: Index, work: Workspace, b: int) -> Part:
    """The room for block b; ``active`` (n_blocks, longest block) as ``count``."""
    if active.ndim == 1:
        return Part(
            active=work.active,
            miss=work.miss,
            slope=work.slope,
            inside=work.inside,
            logarithm=work.logarithm,
            bits=work.bits,
            slack=work.slack,
            inverse=work.inverse,
            projection=work.projection,
        )
    return Part(
        active=work.active[b],
        miss=work.miss[b],
        slope=work.slope[b],
        inside=work.inside[b],
        logarithm=work.logarithm[b],
        bits=work.bits[b],
        slack=work.slack[b],
        inverse=work.inverse[b],
        projection=work.projection[b],
    )


@algebraic_part
def deflections_of(active: Index, work: Workspace, block: Index) -> Deflections:
    """Deflections (n,) of the contacts of a block, from its first one to the first beyond."""
    if active.ndim == 1:
        return Deflections(work.elastic, work.depth)
    return Deflections(work.elastic[block[0] : block[1]], work.depth[block[0] : block[1]])


@algebraic_part
def first_of(active: Index, block: Index) -> int:
    """The first contact of a ``block`` (2,), which holds it and the first beyond."""
    if active.ndim == 1:
        return 0
    first: int = block[0]
    return first


@algebraic_part
def moves(active: Index, moving: Truth, d: int) -> bool:
    """Whether motion d moves any contact of a block, of which ``moving`` (n_motions,) says so."""
    if active.ndim == 1:
        return True
    is_moving: bool = moving[d]
    return is_moving
