"""Elastic bodies of equal sectors about the origin: one sector is factorised, the others are the same.

In frames that turn from sector to sector the stiffness is block-circulant: displacements and loads that go round as
exp(2 pi i k s / n) from sector s to the next keep to themselves, and any load is a sum of such harmonics. A sector's
inner freedoms see no other sector; they are eliminated once, with its cuts held, and leave to each harmonic a small
Hermitian matrix over the freedoms of one cut. Units N, mm.

Source
------
Thomas, Int. J. Numer. Methods Eng. 14 (1979) 81 (cyclic symmetry); Davis, Circulant Matrices (1979), sec. 5.6.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, csc_array, csr_array, eye_array, kron

from pipeline.arrays import Complex, Index, Real
from pipeline.errors import ModelError
from pipeline.model.elastic.supported_factors import symmetric_factors

SAME_PLACE = 1e-9  # of the body's size: how far a turned node may lie from the one that it should be


@dataclass(frozen=True)
class SectorNodes:
    """Which sector every node of a body of equal sectors belongs to.

    Attributes
    ----------
    nodes
        Number of each node of each sector (n_sectors, n_own), those that the sector before touches too (its cut) first.
    n_cut
        Number of nodes of a cut.
    sector, position
        Sector of every node of the body and its column in ``nodes`` (n_nodes,).
    """

    nodes: Index
    n_cut: int
    sector: Index
    position: Index

    @classmethod
    def from_triangles(cls, nodes: Complex, triangles: Index, n_sectors: int) -> "SectorNodes":
        """Sort the nodes of ``triangles`` (n_triangles, 6), which come sector by sector.

        Raises
        ------
        ValueError
            The sectors are not the first one turned, or one of them touches more than its two neighbours.
        """
        if n_sectors < 3 or len(triangles) % n_sectors:
            raise ValueError(f"{len(triangles)} triangles are no {n_sectors} equal sectors; must be 3 or more")
        of_sector = triangles.reshape(n_sectors, -1)
        following = np.arange(len(nodes))
        following[of_sector] = np.roll(of_sector, -1, axis=0)
        pitch = np.exp(2j * np.pi / n_sectors)
        miss = np.abs(nodes[following] - pitch * nodes).max()
        consistent = np.array_equal(following[of_sector], np.roll(of_sector, -1, axis=0))
        if not consistent or miss > SAME_PLACE * np.abs(nodes).max():
            raise ModelError(
                f"the mesh does not repeat in {n_sectors} sectors: turned nodes miss theirs by {miss:.3g} mm"
            )
        sector_nodes = np.unique(of_sector[0])
        cut = sector_nodes[np.isin(following[sector_nodes], sector_nodes)]
        inner = np.setdiff1d(sector_nodes, np.concatenate([cut, following[cut]]))
        sectors = [np.concatenate([cut, inner])]
        for _ in range(n_sectors - 1):
            sectors.append(following[sectors[-1]])
        table = np.array(sectors)
        sector, position = np.full(len(nodes), -1), np.full(len(nodes), -1)
        sector[table], position[table] = np.arange(n_sectors)[:, None], np.arange(table.shape[1])
        if np.isin(cut, following[cut]).any() or table.size != len(nodes) or (sector < 0).any():
            raise ModelError("a sector of the mesh touches more than its two neighbours: it is too coarse for them")
        return cls(table, len(cut), sector, position)


@dataclass(frozen=True)
class CyclicBody:
    """A body of equal sectors, held by the rigid motion of its reference boundary and condensed to the sectors' cuts.

    Attributes
    ----------
    sectors
        Nodes of the sectors.
    freedoms
        Numbers of the two displacements of each node in a load or displacement vector (n_nodes, 2).
    inner_solve
        Displacement of a sector's inner freedoms under loads on them, both cuts held: (n_inner, k) to (n_inner, k).
    yielding
        Reversed displacement of the inner freedoms by unit displacements of the sector's cut and of the next one's
        (2, n_inner, n_cut).
    held
        Displacement of the inner freedoms by the reactions of the reference in harmonics 0 and 1, the cuts held
        (2, n_inner) complex.
    flexibility
        Inverse of each harmonic's stiffness over the freedoms of a cut, bordered by the reaction of the reference
        (n_harmonics, n_cut + 1, n_cut + 1), Hermitian; only harmonics 0 and 1 have such a reaction.
    """

    sectors: SectorNodes
    freedoms: Index
    inner_solve: Callable[[Real], Real]
    yielding: Real
    held: Complex
    flexibility: Complex

    @classmethod
    def from_stiffness(
        cls, stiffness: csc_array, sectors: SectorNodes, freedoms: Index, reference: Real
    ) -> "CyclicBody":
        """Condense a body.

        Parameters
        ----------
        stiffness
            Of the first sector alone (n_freedoms, n_freedoms) [N/mm].
        sectors, freedoms
            As above.
        reference
            As in ``ElasticBody`` (n_freedoms, 3): translations along x and y are of harmonic 1, the rotation of 0.
        """
        n_cut, n_own = 2 * sectors.n_cut, 2 * sectors.nodes.shape[1]
        sector = _first_sector(stiffness, sectors, freedoms)
        inner, cuts = np.arange(n_cut, n_own), np.r_[0:n_cut, n_own : n_own + n_cut]
        factors = symmetric_factors(csc_array(sector[inner][:, inner]))
        coupling = sector[inner][:, cuts]
        yielding = factors.solve(coupling.toarray(order="F"))
        ends = sector[cuts][:, cuts].toarray() - coupling.T @ yielding
        reaction = np.fft.fft(_sector_components(reference, sectors, freedoms), axis=1)[:, [0, 1], [2, 0]].T
        reaction *= np.abs(ends).max() / np.abs(reaction).max()  # its unit is free: one that suits the inverse
        held_force = factors.solve(np.vstack([reaction.real, reaction.imag])[:, n_cut:].T.copy(order="F")).T
        held_force = held_force[:2] + 1j * held_force[2:]
        yielding = np.stack([yielding[:, :n_cut], yielding[:, n_cut:]])
        bordered_stiffness = _bordered_stiffness(ends, yielding, reaction, held_force, _phases(len(sectors.nodes)))
        flexibility = np.asarray(np.linalg.inv(bordered_stiffness), complex)
        return cls(sectors, freedoms, factors.solve, yielding, held_force, flexibility)

    def compliance(self, loads: csc_array) -> Real:
        """Work of each load on the displacement by each other, the reference held (n_loads, n_loads) [mm/N].

        Parameters
        ----------
        loads
            (n_freedoms, n_loads), in balance or not; the fewer sectors each lies in, the faster.
        """
        parts, sector, load = _parts(loads, self.sectors, self.freedoms)
        inner = parts[2 * self.sectors.n_cut :]
        in_sector = inner.T @ self.inner_solve(inner.toarray(order="F")) * (sector[:, None] == sector)
        sums = csr_array((np.ones(len(load)), (load, np.arange(len(load)))))
        forces = np.add.reduceat(self._on_cuts(parts, sector), np.flatnonzero(np.diff(load, prepend=-1)), axis=2)
        displacement = self.flexibility @ forces
        n_sectors = len(self.sectors.nodes)
        forces[1 : (n_sectors + 1) // 2] *= 2  # these harmonics stand for their conjugates too
        forces, displacement = forces.reshape(-1, loads.shape[1]), displacement.reshape(-1, loads.shape[1])
        of_cuts = (forces.real.T @ displacement.real + forces.imag.T @ displacement.imag) / n_sectors
        compliance: Real = of_cuts + sums @ (sums @ in_sector.T).T
        return compliance

    def turned_compliance(self, loads: csc_array, turning: Index) -> Real:
        """As ``compliance``, some loads turned back by every number of sectors (n_sectors, n_loads, n_loads) [mm/N].

        Parameters
        ----------
        turning
            Numbers of the loads that turn, each keeping its place in the frames of the sectors; the others stay.

        Notes
        -----
        A load that turns back by k sectors has its harmonic h times exp(2 pi i h k / n_sectors): what it works on the
        others is the Fourier sum of what the harmonics work. Within a sector it meets those whose parts lie k before.
        """
        n_sectors, n_loads = len(self.sectors.nodes), loads.shape[1]
        parts, sector, load = _parts(loads, self.sectors, self.freedoms)
        inner = parts[2 * self.sectors.n_cut :]
        in_sector = inner.T @ self.inner_solve(inner.toarray(order="F"))
        forces = np.add.reduceat(self._on_cuts(parts, sector), np.flatnonzero(np.diff(load, prepend=-1)), axis=2)
        work = np.conj(np.swapaxes(forces, 1, 2)) @ (self.flexibility @ forces)
        matrices = np.fft.irfft(work, n_sectors, axis=0)
        sectors_on = (sector - sector[:, None]) % n_sectors
        np.add.at(matrices, (sectors_on, load[:, None], load), in_sector)
        turns = np.isin(np.arange(n_loads), turning)
        matrices[:, turns[:, None] == turns] = matrices[0, turns[:, None] == turns]
        backward = np.ix_(np.arange(n_sectors), np.flatnonzero(turns), np.flatnonzero(~turns))
        matrices[backward] = np.swapaxes(matrices[:, ~turns][:, :, turns], 1, 2)
        return matrices

    def displacement(self, loads: Real) -> Real:
        """Displacement of ``loads`` in balance, the reference held: (n_freedoms, k) [N] to (n_freedoms, k) [mm]."""
        n_sectors, n_loads = len(self.sectors.nodes), loads.shape[1]
        parts = _sector_components(loads, self.sectors, self.freedoms).reshape(-1, n_sectors * n_loads)
        forces = self._on_cuts(parts, np.repeat(np.arange(n_sectors), n_loads))
        by_following_sectors = self.flexibility @ forces.reshape(*forces.shape[:2], n_sectors, n_loads).sum(axis=2)
        cut = np.moveaxis(np.fft.irfft(by_following_sectors[:, :-1], n_sectors, axis=0), 0, 1)
        following = np.roll(cut, -1, axis=1)
        inner = self.inner_solve(np.array(parts[len(cut) :], order="F"))
        inner -= self.yielding[0] @ cut.reshape(len(cut), -1) + self.yielding[1] @ following.reshape(len(cut), -1)
        sector_values = np.concatenate([cut, inner.reshape(-1, n_sectors, n_loads)])
        field = (sector_values[0::2] + 1j * sector_values[1::2]) * _frames(n_sectors)[:, None]
        displacement = np.empty(loads.shape)
        displacement[self.freedoms[self.sectors.nodes.T]] = np.stack([field.real, field.imag], axis=2)
        return displacement

    def _on_cuts(self, parts: Real | csc_array, sector: Index) -> Complex:
        """Harmonics of the ``parts`` (n_own, n_parts) of loads as what they leave to the freedoms of a cut.

        Returns
        -------
        (n_harmonics, n_cut + 1, n_parts) [N]; the last row is what they leave to the reaction of the reference.
        """
        n_cut, phases = 2 * self.sectors.n_cut, _phases(len(self.sectors.nodes))
        inner = parts[n_cut:]
        cut = _dense(parts[:n_cut]) - _dense(inner.T @ self.yielding[0]).T
        following = -_dense(inner.T @ self.yielding[1]).T
        forces = np.zeros((len(phases), n_cut + 1, len(sector)), complex)
        forces[:, :-1] = cut + np.conj(phases)[:, None, None] * following
        forces[:2, -1] = -_dense(inner.T @ np.conj(self.held).T).T
        return forces * (phases[:, None] ** -sector)[:, None]


def _phases(n_sectors: int) -> Complex:
    """Factor from one sector to the next (n_harmonics,) of the harmonics 0 .. n_sectors // 2."""
    phases: Complex = np.exp(2j * np.pi * np.arange(n_sectors // 2 + 1) / n_sectors)
    return phases


def _frames(n_sectors: int) -> Complex:
    """Direction of the x axis of every sector's frame (n_sectors,)."""
    frames: Complex = np.exp(2j * np.pi * np.arange(n_sectors) / n_sectors)
    return frames


def _dense(matrix: Real | csc_array) -> Real:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def _sector_components(field: Real, sectors: SectorNodes, freedoms: Index) -> Real:
    """A load or displacement (n_freedoms, k) by sectors, each in its own frame (2 n_own, n_sectors, k)."""
    nodal = (field[freedoms[:, 0]] + 1j * field[freedoms[:, 1]])[sectors.nodes.T]
    in_sector_frames = nodal * np.conj(_frames(len(sectors.nodes)))[:, None]
    return np.stack([in_sector_frames.real, in_sector_frames.imag], axis=1).reshape(-1, *in_sector_frames.shape[1:])


def _parts(loads: csc_array, sectors: SectorNodes, freedoms: Index) -> tuple[csc_array, Index, Index]:
    """The parts of ``loads`` (n_freedoms, n_loads) that lie in one sector each, in the frames of their sectors.

    Returns
    -------
    parts
        (2 n_own, n_parts), those of the first load first.
    sector, load
        Of every part (n_parts,).
    """
    n_sectors = len(sectors.nodes)
    node, axis = np.empty(freedoms.size, int), np.empty(freedoms.size, int)
    node[freedoms], axis[freedoms] = np.arange(len(freedoms))[:, None], np.arange(2)
    entries = loads.tocoo()
    freedom, load = entries.coords
    sector, row = sectors.sector[node[freedom]], 2 * sectors.position[node[freedom]]
    in_sector_frames = entries.data * 1j ** axis[freedom] * np.conj(_frames(n_sectors))[sector]
    part, column = np.unique(load * n_sectors + sector, return_inverse=True)
    values, rows = np.concatenate([in_sector_frames.real, in_sector_frames.imag]), np.concatenate([row, row + 1])
    shape = (2 * sectors.nodes.shape[1], len(part))
    return csc_array((values, (rows, np.tile(column, 2))), shape=shape), part % n_sectors, part // n_sectors


def _first_sector(stiffness: csc_array, sectors: SectorNodes, freedoms: Index) -> csc_array:
    """Stiffness of the first sector over its own freedoms and those of the next one's cut, each in its own frame."""
    numbers = freedoms[np.concatenate([sectors.nodes[0], sectors.nodes[1, : sectors.n_cut]])].ravel()
    frame = _frames(len(sectors.nodes))[1]
    turn = [[frame.real, -frame.imag], [frame.imag, frame.real]]
    turn_blocks = block_diag([eye_array(2 * sectors.nodes.shape[1]), kron(eye_array(sectors.n_cut), turn)])
    return csc_array(turn_blocks.T @ stiffness[numbers][:, numbers] @ turn_blocks)


def _bordered_stiffness(ends: Real, yielding: Real, reaction: Complex, held_force: Complex, phases: Complex) -> Complex:
    """Stiffness of every harmonic over the freedoms of a cut, bordered by the ``reaction`` of the reference.

    Parameters
    ----------
    ends
        Stiffness of a sector over both of its cuts, the inner freedoms following (2 n_cut, 2 n_cut).
    yielding, held
        As in ``CyclicBody``.
    reaction
        Harmonics 0 and 1 of the reference's reaction (2, n_own).
    phases
        Of the harmonics (n_harmonics,).
    """
    n_cut = len(ends) // 2
    near_cut, far_cut = slice(n_cut), slice(n_cut, None)
    factor = phases[:, None, None]
    stiffness = np.zeros((len(phases), n_cut + 1, n_cut + 1), complex)
    stiffness[:, near_cut, near_cut] = ends[near_cut, near_cut] + ends[far_cut, far_cut]
    stiffness[:, near_cut, near_cut] += factor * ends[near_cut, far_cut] + np.conj(factor) * ends[far_cut, near_cut]
    stiffness[2:, -1, -1] = 1
    for k, phase in enumerate(phases[:2]):
        by_cut, by_following = np.swapaxes(yielding, 1, 2) @ reaction[k, n_cut:]
        border = reaction[k, :n_cut] - by_cut - np.conj(phase) * by_following
        stiffness[k, :-1, -1], stiffness[k, -1, :-1] = border, np.conj(border)
        stiffness[k, -1, -1] = -np.vdot(reaction[k, n_cut:], held_force[k]).real
    return stiffness
