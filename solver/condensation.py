"""Owns the condensation of the in-plane field: the law of large deflection of a plate in given modes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from solver.assembly import STIFFNESS_POINTS, PlateMatrices, Space
from solver.banded import compliance_products
from solver.bfs import bending_shape, gauss, membrane_strain
from solver.mesh import Floats, Ints, Mesh
from solver.sector import Sector
from solver.vonkarman import LargeDeflection, index_pairs

# A side. 7 points would be exact (degree 12). 4 are within 1e-5 of that for the modes (m,1) that carry flutter, and
# within 0.3 % for the highest of 24, which a limit cycle does not notice (tests/test_vonkarman.py measures both).
CUBIC_POINTS = STIFFNESS_POINTS
CACHED = 2**18  # strains worked on at a time: 2 MB


def condensed_energy(
    plate: PlateMatrices, modes: Floats, points: int = CUBIC_POINTS, parity: Ints | None = None
) -> LargeDeflection:
    """Membrane energy of large deflection with the in-plane field condensed out.

    With w = Σ q_r φ_r the von Kármán strain is ε = B u + Σ c_p e_p and the curvature κ = Σ q_r κ_r. In-plane inertia is
    neglected, so that u minimises the energy ½ ∫ εᵀ A ε + 2 εᵀ B κ, which leaves G = EᵀAE - gᵀ K_m⁻¹ g and
    H = EᵀBκ - gᵀ K_m⁻¹ K_mb Φ with g = ∫ Bᵀ A e. This is the seed's (2.21) written as an energy.

    Args:
        plate: the plate of the design.
        modes: (free dofs, n) bending shapes.
        points: Gauss points a side of an element.
        parity: (n,) 1 of those symmetric about y = b/2, -1 of antisymmetric ones, where the plate is mirrored. Pairs
            of like modes then share no energy with pairs of unlike ones, and half the plate tells that of either.
    """
    n = modes.shape[1]
    r, s = index_pairs(n)
    quartic, cubic = np.zeros((len(r), len(r))), np.zeros((0 if plate.coupling is None else len(r), n))
    if parity is None:
        quartic, mixed = _energy(plate, _every_pair(plate.space, n), modes, points)
        return LargeDeflection(quartic, cubic if plate.coupling is None else mixed)
    number = np.zeros((n, n), dtype=int)  # of each pair, whichever of its modes comes first
    number[r, s] = number[s, r] = np.arange(len(r))
    for group in _pairs_by_parity(plate.space, parity):
        pairs = number[group.pairs]
        quartic[np.ix_(pairs, pairs)], mixed = _energy(plate, group, modes, points)
        if plate.coupling is not None:
            cubic[np.ix_(pairs, group.alike)] = mixed
    return LargeDeflection(quartic, cubic)


@dataclass(frozen=True)
class _Group:
    """Pairs of modes that pull at the plate in one sector of its motions."""

    sector: Sector
    """The sector, or one that holds it."""
    order: Ints
    """(n,) an order of the modes."""
    first: Ints
    """(n,) place in that order of the first mode that each pairs with."""
    end: Ints
    """(n,) one past the place of the last."""
    alike: Ints
    """(k,) the modes that move in the sector themselves."""

    @property
    def pairs(self) -> tuple[Ints, Ints]:
        """The modes of the p pairs, each (p,)."""
        partners = [self.order[first:end] for first, end in zip(self.first, self.end, strict=True)]
        return np.repeat(self.order, self.end - self.first), np.concatenate(partners)


def _every_pair(space: Space, n: int) -> _Group:
    """All pairs of n modes, in the order of `index_pairs`."""
    modes = np.arange(n)
    return _Group(space.sector(0), modes, modes, np.full(n, n), modes)


def _pairs_by_parity(space: Space, parity: Ints) -> Iterator[_Group]:
    """The pairs of modes of like parity, and those of unlike."""
    # where a pin breaks the symmetry of motions in the plane, it takes the whole plate
    like, unlike = (part if part.inplane else space.sector(0) for part in (space.sector(1), space.sector(-1)))
    n, order, even = len(parity), np.argsort(-parity, kind="stable"), int(np.count_nonzero(parity == 1))
    place = np.arange(n)
    end = np.where(place < even, even, n)
    yield _Group(like, order, place, end, order[:even])
    if 0 < even < n:
        yield _Group(unlike, order, end, np.full(n, n), order[even:])


def _energy(plate: PlateMatrices, group: _Group, modes: Floats, points: int) -> tuple[Floats, Floats]:
    """What a group's p pairs have of G (p, p) between them and of H (p, k) with the modes alike; k = 0 where B = 0.

    Summed over a few elements at a time, whose strains stay in the processor's cache. With A = L Lᵀ of an element, all
    are products of Lᵀ ε √weight.
    """
    from solver.strains import pair_strains  # here, because numba is slow to import

    sector, space, of = group.sector, plate.space, group.sector.elements
    table, dofs = _table(space.mesh, points), space.mesh.bending_dofs[of]
    root = np.linalg.cholesky(plate.laminate.extension[of])
    weight = np.sqrt(np.outer(sector.counts, table.weights))
    number, factor = sector.inplane_places
    displaced = _at_points(root.transpose(0, 2, 1), weight, table.strain) * factor[:, None]
    displaced = np.ascontiguousarray(displaced.transpose(0, 2, 1))  # (m, 8, rows)
    alike, stressed = modes[:, :0], np.zeros((len(of), displaced.shape[2], 16))
    if plate.coupling is not None:
        alike = modes[:, group.alike]
        stressed = _at_points(np.linalg.solve(root, plate.laminate.coupling[of]), weight, table.curvature)
    shapes, bent = space.expand(modes[:, group.order]).T, space.expand(alike).T  # (n, dofs), (k, dofs)

    size, rows = int(np.sum(group.end - group.first)), displaced.shape[2]
    energy, mixed = np.zeros((size, size)), np.zeros((size, len(bent)))
    forces = np.zeros((size, sector.inplane_pattern.size))
    few = max(1, CACHED // (size * rows))
    room = np.empty((size, few * rows))
    for start in range(0, len(of), few):
        at = slice(start, min(start + few, len(of)))
        slope_x, slope_y = (shapes[:, dofs[at]] @ slope.T for slope in table.slopes)  # (n, few, points²)
        section = (root[at], weight[at], displaced[at], number[at])
        pair_strains(slope_x, slope_y, *section, group.first, group.end, room, forces)
        strain = room[:, : (at.stop - start) * rows]
        energy += strain @ strain.T
        if len(bent):
            mixed += strain @ (stressed[at] @ bent[:, dofs[at]].transpose(1, 2, 0)).reshape(-1, len(bent))
    pull = np.zeros((forces.shape[1], 0))
    if plate.coupling is not None and sector.inplane is not None:
        pull = sector.inplane.basis.T @ (plate.coupling @ alike)
    relief = compliance_products(sector.inplane_pattern, plate.membrane_blocks(of), forces.T, pull)
    energy -= relief[:, :size]
    return (energy + energy.T) / 2, mixed - relief[:, size:]


def _at_points(matrix: Floats, weight: Floats, table: Floats) -> Floats:
    """(m, 3·g, k) weight (m, g) · matrix (m, 3, 3) · table (3, g, k): an element's functions at its Gauss points."""
    whole = (matrix @ table.reshape(3, -1)).reshape(len(matrix), *table.shape) * weight[:, None, :, None]
    return whole.reshape(len(matrix), -1, table.shape[2])


@dataclass(frozen=True)
class _Table:
    """Shape functions at the Gauss points of an element, points² of them."""

    weights: Floats
    """(points²,) Gauss weights times the element's area [m²]."""
    slopes: tuple[Floats, Floats]
    """w,x and w,y, each (points², 16)."""
    curvature: Floats
    """(3, points², 16) -(w,xx, w,yy, 2 w,xy)."""
    strain: Floats
    """(3, points², 8) (u,x, v,y, u,y + v,x)."""


@lru_cache(maxsize=8)
def _table(mesh: Mesh, points: int) -> _Table:
    s, weight = gauss(points)
    xx, yy, xy = (bending_shape(mesh, s, s, *order) for order in ((2, 0), (0, 2), (1, 1)))
    return _Table(
        weights=np.kron(weight, weight) * mesh.hx * mesh.hy,
        slopes=(bending_shape(mesh, s, s, 1, 0), bending_shape(mesh, s, s, 0, 1)),
        curvature=-np.stack([xx, yy, 2 * xy]),
        strain=membrane_strain(mesh, s),
    )
