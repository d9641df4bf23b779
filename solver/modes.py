"""Owns the reduction: modal bases of the patched panel and everything structural written in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices, Space
from solver.bases import aeroelastic_modes, family_modes, lowest_modes
from solver.bfs import hermite
from solver.condensation import condensed_energy
from solver.design import Design, Reduction
from solver.errors import DesignError
from solver.mesh import Bools, Floats, Ints
from solver.vonkarman import LargeDeflection


@dataclass(frozen=True)
class ModalModel:
    """The structure in n mass-normalised modes of the panel with its patches on."""

    plate: PlateMatrices
    """The plate that was reduced."""
    shapes: Floats
    """(free dofs, n) mode shapes, ΦᵀMΦ = I [1/√kg]."""
    omega: Floats
    """(n,) natural frequencies in vacuo, before preload and heat [rad/s]."""
    parity: Ints
    """(n,) 1 for modes symmetric about y = b/2, -1 for antisymmetric ones, all 0 on a panel that is not symmetric."""
    numbers: Ints | None = None
    """(n,) places of these modes in the design's basis; None where all of it is here, in order."""

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
        match design.reduction.basis:
            case "family":
                shapes, omega, parity = family_modes(plate, _count(design.reduction, plate.space.mesh.nx * 2 - 1))
            case "aeroelastic":
                most = plate.stiffness.shape[0] // 2  # a richer basis of pairs than this is the whole space
                shapes, omega, parity = aeroelastic_modes(plate, Stream.of(design), _count(design.reduction, most))
            case "patched":
                shapes, omega, parity = lowest_modes(plate, _count(design.reduction, plate.stiffness.shape[0]))
        return ModalModel(plate, _signed(plate.space, shapes), omega, parity)

    @cached_property
    def band(self) -> tuple[float, float]:
        """Frequency of the first mode and the highest of all, before or under preload and heat: the larger [rad/s]."""
        if self.plate.geometric is None:
            return float(self.omega[0]), float(self.omega[-1])
        loaded = np.linalg.eigvalsh(np.diag(self.omega**2) + self.geometric)
        low, high = np.sqrt(np.maximum(loaded[[0, -1]], 0.0))
        return max(float(self.omega[0]), float(low)), max(float(self.omega[-1]), float(high))

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
    def membrane(self) -> LargeDeflection:
        """The law of large deflection in these modes."""
        return condensed_energy(self.plate, self.shapes, parity=self.parity if self.parity.all() else None)

    @cached_property
    def geometric(self) -> Floats:
        """(n, n) Φᵀ K_N Φ, stiffness of the stresses before deflection [1/s²]; zero where there are none."""
        if self.plate.geometric is None:
            return np.zeros((self.size, self.size))
        return self.shapes.T @ (self.plate.geometric @ self.shapes) * self._same_parity

    @cached_property
    def load(self) -> Floats:
        """(n,) static modal force Φᵀ f, of heat in an unsymmetric lay-up [N/√kg]."""
        return np.where(self.parity == -1, 0.0, self.shapes.T @ self.plate.load)

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
        numbers = np.arange(self.size) if self.numbers is None else self.numbers
        return ModalModel(self.plate, self.shapes[:, which], self.omega[which], self.parity[which], numbers[which])

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
        return np.abs(self.coarse).max(axis=0)

    @cached_property
    def coarse(self) -> Floats:
        """(points, n) mode shapes where the largest |w| is looked for, 2 by 4 points an element [1/√kg]."""
        return self.sampled(2, 4).reshape(-1, self.size)

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
