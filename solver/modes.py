"""Owns the reduction: modal bases of the patched panel and everything structural written in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from solver.assembly import PlateMatrices, Space
from solver.banded import upper_bands
from solver.bfs import gauss, hermite
from solver.design import Design, Reduction
from solver.errors import DesignError
from solver.mesh import Bools, Floats, Ints, Mesh
from solver.vonkarman import condensed_energy, index_pairs

DENSE_FROM = 0.25  # the share of all modes from which a dense eigensolver beats Lanczos
CLUSTER = 1e-3  # modes closer than this in frequency, relatively, count as one subspace


@dataclass(frozen=True)
class ModalModel:
    """The structure in n mass-normalised modes of the panel with its patches on."""

    plate: PlateMatrices
    """The plate that was reduced."""
    shapes: Floats
    """(free dofs, n) mode shapes, ΦᵀMΦ = I [1/√kg]."""
    omega: Floats
    """(n,) natural frequencies in vacuo [rad/s]."""
    parity: Ints
    """(n,) 1 for modes symmetric about y = b/2, -1 for antisymmetric ones, all 0 on a panel that is not symmetric."""

    @staticmethod
    def of(design: Design, plate: PlateMatrices | None = None) -> ModalModel:
        """Reduce the plate of a design (the seed's 2.17-2.18).

        Raises:
            DesignError: more modes are asked for than the mesh has, or the stiffnesses cannot be solved together.
        """
        try:
            return ModalModel._reduced(design, plate or PlateMatrices.of(design))
        except np.linalg.LinAlgError:
            raise DesignError(
                "the stiffness of panel and patches cannot be solved: they differ too much; check the young and "
                "thickness of both"
            ) from None

    @staticmethod
    def _reduced(design: Design, plate: PlateMatrices) -> ModalModel:
        if design.reduction.basis == "family":
            shapes, omega, parity = family_modes(plate, _count(design.reduction, plate.space.mesh.nx * 2 - 1))
        else:
            shapes, omega, parity = lowest_modes(plate, _count(design.reduction, plate.stiffness.shape[0]))
        return ModalModel(plate, _signed(plate.space, shapes), omega, parity)

    @property
    def size(self) -> int:
        """Number of modes n."""
        return len(self.omega)

    @cached_property
    def slope_x(self) -> Floats:
        """(n, n) ∫ φ_r φ_s,x dA [m/kg]."""
        return self.shapes.T @ (self.plate.space.slope_x @ self.shapes) * self._same_parity

    @cached_property
    def slope_y(self) -> Floats:
        """(n, n) ∫ φ_r φ_s,y dA [m/kg]."""
        opposite = (self.parity[:, None] != self.parity) | (self.parity == 0)
        return self.shapes.T @ (self.plate.space.slope_y @ self.shapes) * opposite

    @cached_property
    def bare_mass(self) -> Floats:
        """(n, n) ∫ φ_r φ_s dA [m²/kg]."""
        return self.shapes.T @ (self.plate.space.bare_mass @ self.shapes) * self._same_parity

    @cached_property
    def cubic(self) -> Floats:
        """(pairs, pairs) matrix G of the condensed cubic law; see `vonkarman.condensed_energy`."""
        r, s = index_pairs(self.size)
        pair = self.parity[r] * self.parity[s]
        return condensed_energy(self.plate, self.shapes) * (pair[:, None] == pair)

    @cached_property
    def _same_parity(self) -> Bools:
        """(n, n) where unyawed flow and mass can couple modes; elsewhere rounding is made an exact zero.

        A symmetric motion of a symmetric panel then stays exactly so, as in the exact solution, though an
        antisymmetric mode may be unstable.
        """
        return self.parity[:, None] == self.parity

    def symmetric(self) -> ModalModel:
        """The modes symmetric about y = b/2 alone, on a symmetric panel; otherwise the model itself."""
        even = self.parity == 1
        return self._kept(even) if even.any() else self

    def first(self, count: int) -> ModalModel:
        """The `count` modes of lowest frequency alone, or all if there are fewer."""
        return self._kept(np.arange(self.size) < count)

    def _kept(self, which: Bools) -> ModalModel:
        return ModalModel(self.plate, self.shapes[:, which], self.omega[which], self.parity[which])

    def sampled(self, per_x: int, per_y: int) -> Floats:
        """(nx·per_x + 1, ny·per_y + 1, n) mode shapes on a grid of per_x by per_y cells an element [1/√kg]."""
        mesh = self.plate.space.mesh
        along = _interpolation(mesh.nx, mesh.hx, per_x)
        across = _interpolation(mesh.ny, mesh.hy, per_y)
        return np.einsum("xip,ijpqn,yjq->xyn", along, self._nodal, across, optimize=True)

    def at(self, x: float, y: float) -> Floats:
        """(n,) mode shapes at the point (x, y) [m] on the panel [1/√kg]."""
        mesh = self.plate.space.mesh
        i = min(int(x / mesh.hx), mesh.nx - 1)
        j = min(int(y / mesh.hy), mesh.ny - 1)
        fx = hermite(np.array([x / mesh.hx - i]), mesh.hx, 0).reshape(2, 2)
        fy = hermite(np.array([y / mesh.hy - j]), mesh.hy, 0).reshape(2, 2)
        return np.einsum("ap,abpqn,bq->n", fx, self._nodal[i : i + 2, j : j + 2], fy)

    @cached_property
    def peak(self) -> Floats:
        """(n,) largest |φ_r| on the panel [1/√kg]: q_r times this is the share of mode r in the deflection [m]."""
        return np.abs(self.sampled(2, 4)).max(axis=(0, 1))

    @cached_property
    def _nodal(self) -> Floats:
        """(nx + 1, ny + 1, 2, 2, n) nodal values by node and by derivative in x and in y."""
        mesh = self.plate.space.mesh
        full = self.plate.space.expand(self.shapes).reshape(mesh.nx + 1, mesh.ny + 1, 2, 2, -1)
        return full.transpose(0, 1, 3, 2, 4)  # stored w, w,x, w,y, w,xy: the x derivative runs fastest

    def project(self, other: ModalModel, amplitudes: Floats) -> Floats:
        """Amplitudes in this basis nearest, in this panel's kinetic energy, to a motion described in another's.

        Args:
            other: a model on the same mesh, as before a patch was toggled.
            amplitudes: (…, other.size) modal amplitudes, or their rates.

        Returns:
            (…, size) Φᵀ M Φ_other q.
        """
        return amplitudes @ ((self.plate.mass @ other.shapes).T @ self.shapes)


def lowest_modes(plate: PlateMatrices, count: int) -> tuple[Floats, Floats, Ints]:
    """The `count` modes of lowest frequency.

    On a panel symmetric about y = b/2 the symmetric and the antisymmetric ones are sought apart: less work, and modes
    of equal frequency do not mix across the symmetry.

    Returns:
        Shapes (free dofs, count) with ΦᵀMΦ = I, ω (count,) [rad/s] and parity (count,) as in `ModalModel`.
    """
    if not plate.mirrored:
        shapes, omega = _eigenmodes(plate.stiffness, plate.mass, count)
        return shapes, omega, np.zeros(count, dtype=int)
    parts = []
    for basis, parity in zip(plate.space.mirror, (1, -1), strict=True):
        stiffness, mass = (sp.csr_array(basis.T @ matrix @ basis) for matrix in (plate.stiffness, plate.mass))
        shapes, omega = _eigenmodes(stiffness, mass, min(count, stiffness.shape[0]))
        parts.append((basis @ shapes, omega, np.full(len(omega), parity)))
    shapes, omega, parity = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
    order = np.argsort(omega)[:count]
    return shapes[:, order], omega[order], parity[order]


def _eigenmodes(stiffness: sp.csr_array, mass: sp.csr_array, count: int) -> tuple[Floats, Floats]:
    """Lowest eigenvectors (N, count) of K φ = ω² M φ with φᵀMφ = 1, and ω (count,)."""
    size = stiffness.shape[0]
    if count >= DENSE_FROM * size:
        values, vectors = scipy.linalg.eigh(stiffness.toarray(), mass.toarray(), subset_by_index=[0, count - 1])
        return vectors, np.sqrt(values)
    factor = scipy.linalg.cholesky_banded(upper_bands(stiffness))
    inverse = spla.LinearOperator(
        (size, size), matvec=lambda b: scipy.linalg.cho_solve_banded((factor, False), b), dtype=np.float64
    )
    # a fixed start makes runs repeatable; a random one is blind to no symmetry
    start = np.random.default_rng(0).standard_normal(size)
    values, vectors = spla.eigsh(stiffness, count, mass, sigma=0.0, OPinv=inverse, v0=start)
    order = np.argsort(values)
    return vectors[:, order], np.sqrt(values[order])


def family_modes(plate: PlateMatrices, count: int) -> tuple[Floats, Floats, Ints]:
    """The modes (m, 1), m = 1..count, of the panel with its patches on: its modes most like `family_shapes`.

    Modes of nearly one frequency, as (3,1) and (1,3) of a square, mix freely, and a solver's choice among them means
    nothing: from such a cluster the part is taken that the family's shape has in it.

    Returns:
        As `lowest_modes`.
    """
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
    trial = np.empty_like(wanted)
    for row, column in zip(rows, columns, strict=True):
        cluster = np.abs(omega - omega[row]) <= CLUSTER * omega[row]
        trial[:, column] = shapes[:, cluster] @ share[cluster, column]
    values, vectors = scipy.linalg.eigh(trial.T @ (plate.stiffness @ trial), trial.T @ (plate.mass @ trial))
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
        free[end, 0] = False
        free[end, 1] = letter != "c"
    free = free.ravel()
    _, vectors = scipy.linalg.eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)])
    shapes = np.zeros((len(free), count))
    shapes[free] = vectors[:, :count]
    return shapes.reshape(elements + 1, 2, count)


def _signed(space: Space, shapes: Floats) -> Floats:
    """Turn each mode so that it is positive under a weight that fades downstream and across.

    The weight has no symmetry, so that no mode's sign is left to rounding; the first lobe at the leading edge counts.
    """
    mesh = space.mesh
    x = np.linspace(0, 1, mesh.nx + 1)[:, None]
    y = np.linspace(0, 1, mesh.ny + 1)[None, :]
    w = space.expand(shapes)[::4]
    return shapes * np.where(np.exp(-1.3 * x - 0.7 * y).ravel() @ w < 0, -1.0, 1.0)


def _interpolation(elements: int, size: float, cells: int) -> Floats:
    """(elements·cells + 1, elements + 1, 2) Hermite interpolation from nodal values and slopes to a finer grid."""
    matrix = np.zeros((elements * cells + 1, elements + 1, 2))
    values = hermite(np.arange(cells + 1) / cells, size, 0).reshape(cells + 1, 2, 2)
    for e in range(elements):
        matrix[e * cells : (e + 1) * cells + 1, e : e + 2] = values
    return matrix


def _count(reduction: Reduction, available: int) -> int:
    if reduction.modes == "all":
        return available
    if reduction.modes > available:
        raise DesignError(f"reduction.modes = {reduction.modes}: this mesh has {available} modes; ask for fewer")
    return reduction.modes
