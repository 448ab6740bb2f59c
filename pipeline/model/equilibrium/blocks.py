"""Contacts that elastic bodies couple to each other, brought together: those of a disk do not feel another's.

Nearly every reducer has one block. Its loops are compiled without the axis of the blocks, which costs a sixth of the
time of one disk and saves a sixth of that of two.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Index, Real
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
    """Blocks of the contacts that a ``compliance`` (n_contacts, n_contacts) [mm/N] couples."""
    n, self_compliance = len(compliance), np.diag(compliance).copy()
    elastic = self_compliance > 0.0
    one_block = Blocks(np.arange(n), np.array([[0, n]]), np.ascontiguousarray(compliance), self_compliance)
    if np.all(compliance[np.argmax(elastic), elastic]):  # most reducers have one elastic body, or none
        return one_block
    component = _first_coupled(compliance != 0.0)
    of_bodies = np.unique(component[elastic])
    if len(of_bodies) < 2:
        return one_block
    rank = np.where(elastic, component, n)
    order = np.argsort(rank, kind="stable")
    bounds = np.concatenate([np.searchsorted(rank[order], of_bodies), [n]])
    ranges = np.column_stack([bounds[:-1], bounds[1:]])
    block_values = np.zeros((n, int(np.max(np.diff(bounds)))))
    for start, end in ranges:
        rows = order[start:end]
        block_values[start:end, : end - start] = compliance[np.ix_(rows, rows)]
    return Blocks(order, ranges, block_values, self_compliance[order])


def _first_coupled(is_coupled: np.ndarray) -> Index:
    """The first contact that each is coupled to (n_contacts, n_contacts), by way of others too; itself if none."""
    first_contact = np.arange(len(is_coupled))
    while True:
        spread = np.minimum(
            np.where(is_coupled, first_contact, len(first_contact)).min(axis=1, initial=len(first_contact)),
            first_contact,
        )
        if np.array_equal(spread, first_contact):
            return first_contact
        first_contact = spread


class Part(NamedTuple):
    """What a sample's solve has of one block; see ``residual.Workspace``."""

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


@algebraic_part
def count(active):
    """Number of blocks, of which ``active`` (n_blocks, longest block), or without the first axis of one, has lists."""
    if active.ndim == 1:
        return 1
    return active.shape[0]


@algebraic_part
def part_of(active, work, b):
    """The room for block b; ``active`` as ``count``."""
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
def deflections_of(active, work, block):
    """Deflections of the contacts of a block, from its first one to the first beyond."""
    if active.ndim == 1:
        return Deflections(work.elastic, work.depth)
    return Deflections(work.elastic[block[0] : block[1]], work.depth[block[0] : block[1]])


@algebraic_part
def first_of(active, block):
    """The first contact of a block."""
    if active.ndim == 1:
        return 0
    return block[0]


@algebraic_part
def moves(active, moving, d):
    """Whether motion d moves any contact of a block, of which ``moving`` (n_motions,) says so."""
    if active.ndim == 1:
        return True
    return moving[d]
