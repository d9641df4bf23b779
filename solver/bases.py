"""Owns the modal bases: lowest modes of the patched panel, the family (m,1), and aeroelastic modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import blas

from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.banded import Cholesky, definite_solver
from solver.bfs import gauss, hermite
from solver.lanczos import lowest_pairs
from solver.mesh import Floats, Ints, Mesh
from solver.sector import Sector

if TYPE_CHECKING:
    import scipy.sparse.linalg as spla

Complexes = NDArray[np.complexfloating]

DENSE_FROM = 0.25  # the share of all modes from which a dense eigensolver beats Lanczos
SPARE = 2  # modes of either parity sought beyond those that a bare panel would have among the lowest
CLUSTER = 1e-3  # modes closer than this in frequency, relatively, count as one subspace
NEW = 1e-3  # the least part of an aeroelastic mode outside the ones before it that makes it one more of the basis


def lowest_modes(plate: PlateMatrices, count: int) -> tuple[Floats, Floats, Ints]:
    """The `count` modes of lowest frequency.

    On a panel symmetric about y = b/2 the symmetric and the antisymmetric ones are sought apart: less work, and modes
    of equal frequency do not mix across the symmetry.

    Returns:
        Shapes (free dofs, count) with ΦᵀMΦ = I, ω (count,) [rad/s] and parity (count,) as in `ModalModel`.
    """
    if not plate.mirrored:
        shapes, omega = _eigenmodes(plate, plate.space.sector(0), count)
        return shapes, omega, np.zeros(count, dtype=int)
    sectors = (plate.space.sector(1), plate.space.sector(-1))
    wanted = [min(share, sector.bending.size) for share, sector in zip(_shares(plate, count), sectors, strict=True)]
    parts = [_eigenmodes(plate, sector, most) for sector, most in zip(sectors, wanted, strict=True)]
    while True:
        parity = np.repeat([1, -1], wanted)
        omega = np.concatenate([part[1] for part in parts])
        order = np.argsort(omega)[:count]
        short = [
            k
            for k, sector in enumerate(sectors)
            if np.count_nonzero(parity[order] == sector.parity) == wanted[k] < sector.bending.size
        ]
        if not short:
            return np.hstack([part[0] for part in parts])[:, order], omega[order], parity[order]
        for k in short:  # all that was found of it is among the lowest: the next one may be too
            wanted[k] = min(2 * wanted[k], sectors[k].bending.size)
            parts[k] = _eigenmodes(plate, sectors[k], wanted[k])


def _shares(plate: PlateMatrices, count: int) -> tuple[int, int]:
    """How many symmetric and antisymmetric modes the `count` lowest are likely to be, with a little to spare.

    As on a bare panel that is simply supported: (m, n) in the order of (m/a)² + (n/b)².
    """
    number = np.arange(1, count + 1)
    squares = np.add.outer((number / plate.space.mesh.length) ** 2, (number / plate.space.mesh.width) ** 2)
    across = np.argsort(squares, axis=None)[:count] % count  # n - 1
    even = int(np.count_nonzero(across % 2 == 0))
    return even + SPARE, count - even + SPARE


def _eigenmodes(plate: PlateMatrices, sector: Sector, count: int) -> tuple[Floats, Floats]:
    """Lowest eigenvectors φ (free dofs, count) of K φ = ω² M φ in a sector, with φᵀMφ = 1, and ω (count,)."""
    basis, pattern = sector.bending.basis, sector.bending_pattern
    stiffness, mass = plate.bending_blocks(sector.elements)
    if count >= DENSE_FROM * pattern.size:
        if plate.coupling is None:
            dense = pattern.matrix(stiffness).toarray()
        else:
            dense = basis.T @ plate.condensed_stiffness() @ basis
        values, vectors = scipy.linalg.eigh(dense, pattern.matrix(mass).toarray(), subset_by_index=[0, count - 1])
    else:
        bands = pattern.bands(mass)
        inverse = Cholesky.of(pattern.bands(stiffness)).solve if plate.coupling is None else _compliance(plate, basis)
        values, vectors = lowest_pairs(inverse, lambda x: blas.dsbmv(pattern.width, 1.0, bands, x), pattern.size, count)
    return basis @ vectors, np.sqrt(values)


def _compliance(plate: PlateMatrices, basis: sp.csr_array) -> Callable[[Floats], Floats]:
    """The function from forces to displacements (size,) in the space of a basis (N, size), u of B ≠ 0 condensed out."""
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    stiffness, _ = plate.linear(loaded=False)
    whole, free = spla.splu(stiffness.tocsc()), basis.shape[0]

    def displacement(force: Floats) -> Floats:
        padded = np.zeros(stiffness.shape[0])
        padded[:free] = basis @ force
        return basis.T @ whole.solve(padded)[:free]

    return displacement


def family_modes(plate: PlateMatrices, count: int) -> tuple[Floats, Floats, Ints]:
    """The modes (m, 1), m = 1..count, of the panel with its patches on: its modes most like `family_shapes`.

    Modes of nearly one frequency, as (3,1) and (1,3) of a square, mix freely, and a solver's choice among them means
    nothing: from such a cluster the part is taken that the family's shape has in it.

    Returns:
        As `lowest_modes`.
    """
    import scipy.optimize  # here, because it is slow to import

    size = plate.stiffness.shape[0]
    wanted = family_shapes(plate.space.mesh, count)
    wanted /= np.sqrt(np.einsum("im,im->m", wanted, plate.mass @ wanted))
    available = min(4 * count + 8, size)
    while True:
        shapes, omega, _ = lowest_modes(plate, available)
        share = shapes.T @ (plate.mass @ wanted)  # (available, count)
        if available == size or np.all((share**2).sum(axis=0) > 0.9):
            break
        available = min(2 * available, size)
    rows, columns = scipy.optimize.linear_sum_assignment(share**2, maximize=True)
    mixture = np.zeros_like(share)
    for row, column in zip(rows, columns, strict=True):
        cluster = np.abs(omega - omega[row]) <= CLUSTER * omega[row]
        mixture[cluster, column] = share[cluster, column]
    trial = shapes @ mixture
    # the trial shapes are modes or mixtures of such, so that their frequencies give the stiffness without it
    stiffness = mixture.T @ (omega[:, None] ** 2 * mixture)
    values, vectors = scipy.linalg.eigh(stiffness, trial.T @ (plate.mass @ trial))
    return trial @ vectors, np.sqrt(values), np.full(count, int(plate.mirrored))


def family_shapes(mesh: Mesh, count: int) -> Floats:
    """(free dofs, count) shapes (m, 1), m = 1..count: beam modes along x times the first beam mode across.

    On a simply supported panel these are sin(mπx/a) sin(πy/b) as the mesh has them: the seed's four modes, which it
    numbers (1,1) to (1,4).
    """
    along = _beam_modes(mesh.nx, mesh.hx, mesh.edges[:2], count)
    across = _beam_modes(mesh.ny, mesh.hy, mesh.edges[2:], 1)[..., 0]
    full = np.einsum("ipm,jq->ijqpm", along, across)
    return full.reshape(-1, count)[mesh.free_bending]


def _beam_modes(elements: int, size: float, edges: str, count: int) -> Floats:
    """(elements + 1, 2, count) nodal values and slopes of the lowest modes of a uniform beam."""
    s, weight = gauss(4)
    dofs = 2 * np.arange(elements)[:, None] + np.arange(4)
    stiffness, mass = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for matrix, derivative in ((stiffness, 2), (mass, 0)):
        f = hermite(s, size, derivative)
        np.add.at(matrix, (dofs[:, :, None], dofs[:, None, :]), f.T @ (weight[:, None] * f))
    free = np.ones((elements + 1, 2), dtype=bool)
    for end, letter in ((0, edges[0]), (-1, edges[1])):
        free[end, 0] = letter == "f"
        free[end, 1] = letter != "c"
    free = free.ravel()
    _, vectors = scipy.linalg.eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)])
    shapes = np.zeros((len(free), count))
    shapes[free] = vectors[:, :count]
    shapes = shapes.reshape(elements + 1, 2, count)
    if edges == "ff":  # of the rigid motions an eigensolver gives any mixture: shifted first, then turned
        rigid = np.zeros((elements + 1, 2, 2))
        rigid[:, 0, 0] = 1.0
        rigid[:, 0, 1], rigid[:, 1, 1] = size * (np.arange(elements + 1) - elements / 2), 1.0
        shapes[..., :2] = rigid[..., :count]
    return shapes


def aeroelastic_modes(plate: PlateMatrices, stream: Stream, count: int) -> tuple[Floats, Floats, Ints]:
    """A basis of right and left eigenvectors of the undamped panel in its stream at the stream's own λ.

    (K + K_N + λ A) φ = σ M φ is solved with the matrix and with its transpose; complex pairs, as flutter has them, come
    first with their real and imaginary parts, then the others from the lowest |σ|. Galerkin's method in a space that
    holds both right and left eigenvectors has their eigenvalues exactly, and an error in others that is of second
    order. Within the space the modes are those of the structure: all else stays as in any other basis. After Guo and
    Mei, "Using aeroelastic modes for nonlinear panel flutter at arbitrary supersonic yawed angle", AIAA J. 41, 2003.

    Returns:
        As `lowest_modes`.
    """
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    slope = stream.slope_unit * (stream.cosine * plate.space.slope_x + stream.sine * plate.space.slope_y)
    stiffness, _ = plate.linear(loaded=True)
    stiffness = sp.csr_array(stiffness + stream.dynamic_pressure * plate.widened(sp.csr_array(slope)))
    factors = [spla.splu(matrix.tocsc()) for matrix in (stiffness, stiffness.T)]
    keeps = plate.mirrored and stream.sine == 0
    sectors = [plate.space.sector(parity) for parity in ((1, -1) if keeps else (0,))]
    found: list[tuple[tuple[bool, float], Floats, int]] = []
    for sector in sectors:
        basis, parity = sector.bending.basis, sector.parity
        pairs = min(count, basis.shape[1])
        for factor in factors:  # the right eigenvectors, then the left
            values, vectors = _nearest(factor, basis, plate.mass, pairs)
            parts = [
                ((value.imag == 0, abs(value)), part, parity)
                for value, vector in zip(values, vectors.T, strict=True)
                if value.imag >= 0
                for part in ((vector.real, vector.imag) if value.imag > 0 else (vector.real,))
            ]
            found += parts
    # of equal |σ| the right one first, then the left: Python's sort keeps the order
    found.sort(key=lambda part: part[0])
    kept, parities = _independent(found, plate.mass, count)
    shapes, omega, parity = [], [], []
    for which in sorted(set(parities)):
        own = kept[:, parities == which]
        stiff = _rayleigh(plate, own)
        values, vectors = scipy.linalg.eigh(stiff, own.T @ (plate.mass @ own))
        shapes.append(own @ vectors)
        omega.append(np.sqrt(values))
        parity.append(np.full(len(values), which))
    order = np.argsort(np.concatenate(omega))
    return np.hstack(shapes)[:, order], np.concatenate(omega)[order], np.concatenate(parity)[order]


def _nearest(factor: spla.SuperLU, basis: sp.csr_array, mass: sp.csr_array, count: int) -> tuple[Complexes, Complexes]:
    """The `count` eigenvalues σ of smallest modulus and eigenvectors (N, count) in the space of a basis (N, size)."""
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    free, size = basis.shape
    whole = factor.shape[0]

    def inverse(x: Floats) -> Floats:
        padded = np.zeros(whole)
        padded[:free] = mass @ (basis @ x)
        return basis.T @ factor.solve(padded)[:free]

    operator = spla.LinearOperator((size, size), matvec=inverse, dtype=np.float64)
    if count >= size - 1:  # too many for Arnoldi
        small = np.linalg.eig(np.column_stack([inverse(unit) for unit in np.eye(size)]))
        order = np.argsort(-np.abs(small.eigenvalues))[:count]
        values, vectors = small.eigenvalues[order].astype(np.complex128), small.eigenvectors[:, order]
        return 1 / values, np.asarray(basis @ vectors, dtype=np.complex128)
    start = np.random.default_rng(0).standard_normal(size)
    values, vectors = spla.eigs(operator, count, v0=start)
    return (1 / values).astype(complex), np.asarray(basis @ np.asarray(vectors)).astype(complex)


def _independent(
    found: list[tuple[tuple[bool, float], Floats, int]], mass: sp.csr_array, count: int
) -> tuple[Floats, Ints]:
    """The first `count` vectors that are not combinations of those before, M-orthonormal, and their parities."""
    kept: list[Floats] = []
    parities: list[int] = []
    for _, vector, parity in found:
        rest = vector / np.sqrt(vector @ (mass @ vector))
        for _ in range(2):  # twice is enough (Kahan and Parlett)
            for other in kept:
                rest = rest - other * (other @ (mass @ rest))
        size = float(np.sqrt(rest @ (mass @ rest)))
        if size > NEW:
            kept.append(rest / size)
            parities.append(parity)
        if len(kept) == count:
            break
    return np.column_stack(kept), np.array(parities)


def _rayleigh(plate: PlateMatrices, shapes: Floats) -> Floats:
    """(n, n) Φᵀ K Φ with in-plane displacements condensed out, before preload and heat."""
    stiffness = shapes.T @ (plate.stiffness @ shapes)
    if plate.coupling is None:
        return stiffness
    force = plate.coupling @ shapes
    return stiffness - force.T @ definite_solver(plate.membrane)(force)
