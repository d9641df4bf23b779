"""Owns the full-order model: the finite-element equations of large deflection in all dofs, with no modal reduction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from solver.aerodynamics import Stream
from solver.assembly import Pattern, PlateMatrices, scatter
from solver.banded import WIDEST, definite_solver
from solver.design import Design
from solver.laminate import moment_per_volt
from solver.mesh import Floats, Ints
from solver.piezo import channels

BENDING, INPLANE = 16, 8  # dofs of an element


@dataclass(frozen=True)
class FullModel:
    """M ẅ + C ẇ + λ S w + f(w, u) = F V + p over all free dofs, and 0 = g(w, u): in-plane inertia is neglected.

    f and g are the gradient of the von Kármán energy, at the Gauss points of the reduced model's cubic law, so that
    the two differ by the modal basis alone. Displacements u are measured from where preload and heat put the flat
    panel. The unknowns x hold w and u of a node side by side, which keeps the tangent's bands narrow.
    """

    design: Design
    """The design that this is the model of."""
    plate: PlateMatrices
    """Its matrices."""
    damping: sp.csr_array
    """(N, N) C, of the flow [N·s/m and its moments]."""
    flow: sp.csr_array
    """(N, N) λ S, stiffness of the flow [N/m and its moments]; not symmetric."""
    drive: Floats
    """(N, channels) F, force a volt [N/V and its moments]."""

    @staticmethod
    def of(design: Design, plate: PlateMatrices | None = None) -> FullModel:
        """The full-order model of a design; its plate may be passed on where it is there already.

        Raises:
            DesignError: the in-plane stiffness cannot be solved for the thermal stresses.
        """
        plate = plate or PlateMatrices.of(design)
        stream, space = Stream.of(design), plate.space
        pressure = stream.dynamic_pressure
        slope = stream.cosine * space.slope_x + stream.sine * space.slope_y
        volt = np.zeros((space.mesh.elements, BENDING, len(channels(design))))
        for k, group in enumerate(channels(design)):
            volt[list(group), :, k] = moment_per_volt(design) @ space.moment_integral
        number = space.mesh.bending_unknowns[space.mesh.bending_dofs]
        return FullModel(
            design=design,
            plate=plate,
            damping=sp.csr_array(stream.rate(pressure) * space.bare_mass),
            flow=sp.csr_array(pressure * stream.slope_unit * slope),
            drive=scatter(number, volt, space.bending.size),
        )

    @property
    def bending_size(self) -> int:
        """Number N of free bending dofs."""
        return self.plate.space.bending.size

    @property
    def size(self) -> int:
        """Number of unknowns x, bending and in-plane."""
        return self.bending_size + self.plate.space.inplane.size

    @cached_property
    def _order(self) -> tuple[Ints, Ints]:
        """Place in x of each free bending dof and of each in-plane unknown: by node, along the mesh's longer side."""
        mesh = self.plate.space.mesh
        rank = np.arange(mesh.nodes).reshape(mesh.nx + 1, mesh.ny + 1)
        if mesh.ny > mesh.nx:
            rank = np.arange(mesh.nodes).reshape(mesh.ny + 1, mesh.nx + 1).T
        inplane = np.full(self.plate.space.inplane.size, mesh.nodes)  # a shared number goes to the last of its nodes
        kept = mesh.inplane_unknowns >= 0
        inplane[mesh.inplane_unknowns[kept]] = np.repeat(rank.ravel(), 2)[kept]
        bending = np.repeat(rank.ravel(), 4)[mesh.free_bending]
        place = np.empty(self.size, dtype=int)
        place[np.argsort(np.concatenate([bending, inplane]), kind="stable")] = np.arange(self.size)
        return place[: self.bending_size], place[self.bending_size :]

    @property
    def bending(self) -> Ints:
        """(N,) place of each free bending dof in x."""
        return self._order[0]

    @property
    def inplane(self) -> Ints:
        """(Nm,) place of each in-plane unknown in x."""
        return self._order[1]

    @cached_property
    def number(self) -> Ints:
        """(elements, 24) place in x of each element's bending, then in-plane dofs; -1 where held."""
        mesh = self.plate.space.mesh
        parts = (
            (mesh.bending_unknowns[mesh.bending_dofs], self.bending),
            (mesh.inplane_unknowns[mesh.inplane_dofs], self.inplane),
        )
        return np.hstack([np.where(unknown < 0, -1, place[unknown]) for unknown, place in parts])

    @cached_property
    def pattern(self) -> Pattern:
        """Where the (24, 24) matrices of the elements land in a matrix over x."""
        places = np.arange(self.size + 1)
        places[-1] = -1  # what `number` has as -1 is the last of these
        return Pattern.of(self.number, places)

    @cached_property
    def scale(self) -> Floats:
        """(size,) factor that turns each unknown into a deflection [m].

        A slope times the element's size is one; u goes with w²/a, so that u a/h goes with w where w goes with h.
        """
        mesh, panel = self.plate.space.mesh, self.design.panel
        scale = np.full(self.size, panel.length / panel.thickness)
        nodal = np.array([1.0, mesh.hx, mesh.hy, mesh.hx * mesh.hy])
        scale[self.bending] = np.tile(nodal, mesh.nodes)[mesh.free_bending]
        return scale

    @cached_property
    def _tables(self) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
        """What the compiled loops over elements share: A, B (none where zero), N,x, N,y, B_m, κ and weights."""
        space, laminate = self.plate.space, self.plate.laminate
        return (
            laminate.extension,
            np.zeros((0, 3, 3)) if self.plate.coupling is None else laminate.coupling,
            space.shape(1, 0),
            space.shape(0, 1),
            space.strain,
            space.curvature,
            space.weights,
        )

    @cached_property
    def _linear(self) -> sp.csr_array:
        """(N, N) stiffness of w alone: bending, and the stresses before deflection."""
        geometric = self.plate.geometric
        return self.plate.stiffness if geometric is None else sp.csr_array(self.plate.stiffness + geometric)

    def unknowns(self, w: Floats, u: Floats) -> Floats:
        """(size,) x of deflections w (N,) and in-plane displacements u (Nm,)."""
        x = np.empty(self.size)
        x[self.bending], x[self.inplane] = w, u
        return x

    def condensed(self, w: Floats) -> Floats:
        """(Nm,) in-plane displacements u that are in equilibrium with w (N,): K_m u = -g(w, 0), as g is linear in u."""
        pull = self.internal_force(self.unknowns(w, np.zeros(len(self.inplane))))[self.inplane]
        return -definite_solver(self.plate.membrane)(pull)

    def internal_force(self, x: Floats) -> Floats:
        """(size,) gradient (f, g) of `energy` at x (size,), flow left out [N and its moments]."""
        return self._internal(x)[0]

    def _internal(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Internal force (size,), and dofs (elements, 24) and membrane stresses (elements, points, 3) it came from."""
        from solver.element_forces import gather, membrane_forces, scatter_add  # here, because numba is slow to import

        local, forces = np.empty(self.number.shape), np.empty(self.number.shape)
        stresses = np.empty((len(local), len(self.plate.space.weights), 3))
        gather(x, self.number, local)
        membrane_forces(local, *self._tables, forces, stresses)
        total = np.zeros(self.size)
        scatter_add(forces, self.number, total)
        total[self.bending] += self._linear @ x[self.bending] - self.plate.load
        return total, local, stresses

    def tangent(self, x: Floats, extra: Floats | None = None) -> sp.csr_array:
        """(size, size) derivative of `internal_force` at x; `extra` blocks (elements, 16, 16) of w are added to it."""
        from solver.element_forces import membrane_tangents  # here, because numba is slow to import

        _, local, stresses = self._internal(x)
        blocks = np.zeros((len(local), BENDING + INPLANE, BENDING + INPLANE))
        blocks[:, :BENDING, :BENDING] = self._linear_blocks if extra is None else self._linear_blocks + extra
        membrane_tangents(local, stresses, *self._tables, blocks)
        return self.pattern.matrix(blocks)

    @cached_property
    def _linear_blocks(self) -> Floats:
        """(elements, 16, 16) matrices of elements whose sum is `_linear`."""
        plate, space = self.plate, self.plate.space
        blocks = np.einsum("eab,abij->eij", plate.laminate.bending, space.curvature_integrals)
        if plate.prestress is not None:
            blocks += np.einsum("ega,agij->eij", plate.prestress, space.slope_products, optimize=True)
        return blocks

    def inertial_blocks(self, mass: float, damping: float) -> Floats:
        """(elements, 16, 16) matrices of elements whose sum is mass·M + damping·C + λ S."""
        space, stream = self.plate.space, Stream.of(self.design)
        pressure = stream.dynamic_pressure
        slope_x = space.shape(0, 0).T @ (space.weights[:, None] * space.shape(1, 0))
        slope_y = space.shape(0, 0).T @ (space.weights[:, None] * space.shape(0, 1))
        flow = pressure * stream.slope_unit * (stream.cosine * slope_x + stream.sine * slope_y)
        still = damping * stream.rate(pressure) * space.mass_integral + flow
        return mass * self.plate.laminate.mass[:, None, None] * space.mass_integral + still

    def energy(self, x: Floats) -> float:
        """Strain energy at x less the work of the static load [J]: ½ wᵀ(K + K_N)w - wᵀp + ∫ ½ εᵀ A ε + εᵀ B κ dA."""
        space, laminate, w = self.plate.space, self.plate.laminate, x[self.bending]
        local = np.append(x, 0.0)[self.number]
        bent, flat = local[:, :BENDING], local[:, BENDING:]
        slope = np.einsum("dgi,ei->deg", np.stack([space.shape(1, 0), space.shape(0, 1)]), bent)
        strain = np.einsum("agi,ei->aeg", space.strain, flat)
        strain += np.stack([slope[0] ** 2, slope[1] ** 2, 2 * slope[0] * slope[1]]) / 2
        stress = np.einsum("eab,beg->aeg", laminate.extension, strain) / 2
        stress += np.einsum("eab,bgi,ei->aeg", laminate.coupling, space.curvature, bent, optimize=True)
        stretching = np.einsum("aeg,aeg,g->", strain, stress, space.weights)
        return float(w @ (self._linear @ w) / 2 - w @ self.plate.load + stretching)


def lu_solver(matrix: sp.csr_array) -> Callable[[Floats], Floats]:
    """Factorise a matrix (n, n), banded where its bands are narrow; gives the function b (n, …) -> its solution.

    Raises:
        ArithmeticError: the matrix is singular.
    """
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    entries = matrix.tocoo()
    row, column = entries.coords
    lower, upper, size = int(np.max(row - column)), int(np.max(column - row)), matrix.shape[0]
    if lower > WIDEST * size > 400:
        factor = spla.splu(matrix.tocsc())
        return lambda b: factor.solve(np.ascontiguousarray(b))
    bands = np.zeros((2 * lower + upper + 1, size), order="F")
    bands[lower + upper + row - column, column] = entries.data
    triangles, pivots, info = scipy.linalg.lapack.dgbtrf(bands, lower, upper, overwrite_ab=True)
    if info:
        raise ArithmeticError("singular tangent: the motion diverged, or changes too fast; use more steps")
    return lambda b: scipy.linalg.lapack.dgbtrs(triangles, lower, upper, b, pivots)[0]
