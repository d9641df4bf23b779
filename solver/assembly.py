"""Owns the finite-element matrices of the plate: stiffness, mass and aerodynamics, on the dofs the edges leave free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.sparse as sp

from solver.bfs import bending_shape, gauss, inplane_shape
from solver.design import Design
from solver.laminate import Laminate
from solver.mesh import Bools, Floats, Ints, Mesh

STIFFNESS_POINTS = 4  # a side: exact for products of two cubics (degree 6)


@dataclass(frozen=True)
class Pattern:
    """Where element matrices land in a global sparse matrix over free dofs; computed once for a mesh."""

    size: int
    """Number of free dofs."""
    indptr: Ints
    """(size + 1,) row pointers of the CSR matrix."""
    indices: Ints
    """(nonzeros,) column indices."""
    slot: Ints
    """(elements·k·k,) position of every element-matrix entry among the nonzeros; one past the end where held."""

    @staticmethod
    def of(dofs: Ints, free: Bools) -> Pattern:
        """The pattern of elements with the given (elements, k) dofs."""
        size = int(free.sum())
        number = np.where(free, np.cumsum(free) - 1, -1)[dofs]
        row, column = np.broadcast_arrays(number[:, :, None], number[:, None, :])
        held = (row < 0) | (column < 0)
        keys, slot = np.unique(np.where(held, size * size, row * size + column), return_inverse=True)
        keys = keys[keys < size * size]
        indptr = np.searchsorted(keys, np.arange(size + 1) * size)
        return Pattern(size, indptr, keys % size, slot.ravel())

    def matrix(self, blocks: Floats) -> sp.csr_array:
        """Sum (elements, k, k) element matrices into a (size, size) matrix."""
        data = np.bincount(self.slot, weights=blocks.ravel(), minlength=len(self.indices) + 1)[: len(self.indices)]
        return sp.csr_array((data, self.indices, self.indptr), shape=(self.size, self.size))


@dataclass(frozen=True)
class Space:
    """What a mesh alone determines: sparsity patterns and the element integrals that laminates then weigh."""

    mesh: Mesh
    """The mesh."""

    @cached_property
    def bending(self) -> Pattern:
        """Pattern of the bending dofs."""
        return Pattern.of(self.mesh.bending_dofs, self.mesh.free_bending)

    @cached_property
    def inplane(self) -> Pattern:
        """Pattern of the in-plane dofs."""
        return Pattern.of(self.mesh.inplane_dofs, self.mesh.free_inplane)

    @cached_property
    def weights(self) -> Floats:
        """(points,) Gauss weights times the element's area [m²]."""
        _, weight = gauss(STIFFNESS_POINTS)
        return np.kron(weight, weight) * self.mesh.hx * self.mesh.hy

    def shape(self, dx: int, dy: int) -> Floats:
        """(points, 16) bending functions or a derivative of theirs at the Gauss points of an element."""
        s, _ = gauss(STIFFNESS_POINTS)
        return bending_shape(self.mesh, s, s, dx, dy)

    @cached_property
    def mass_integral(self) -> Floats:
        """(16, 16) ∫ N Nᵀ dA of an element [m²]."""
        return self.shape(0, 0).T @ (self.weights[:, None] * self.shape(0, 0))

    @cached_property
    def curvature_integrals(self) -> Floats:
        """(3, 3, 16, 16) ∫ κ_a κ_bᵀ dA of an element, with κ = -(w,xx, w,yy, 2 w,xy) as in the seed's (2.2)."""
        curvature = -np.stack([self.shape(2, 0), self.shape(0, 2), 2 * self.shape(1, 1)])
        return np.einsum("g,agi,bgj->abij", self.weights, curvature, curvature)

    @cached_property
    def moment_integral(self) -> Floats:
        """(16,) ∫ (κ_x + κ_y) dA of an element [-]: the work of a unit moment in both directions on each dof."""
        return -self.weights @ (self.shape(2, 0) + self.shape(0, 2))

    @cached_property
    def membrane_integrals(self) -> Floats:
        """(3, 3, 8, 8) ∫ ε_a ε_bᵀ dA of an element, with ε = (u,x, v,y, u,y + v,x)."""
        s, weight = gauss(2)
        strain = np.zeros((3, len(s) ** 2, 8))
        strain[0, :, :4] = strain[2, :, 4:] = inplane_shape(self.mesh, s, s, 1, 0)
        strain[1, :, 4:] = strain[2, :, :4] = inplane_shape(self.mesh, s, s, 0, 1)
        return np.einsum("g,agi,bgj->abij", np.kron(weight, weight) * self.mesh.hx * self.mesh.hy, strain, strain)

    @cached_property
    def bare_mass(self) -> sp.csr_array:
        """∫ N Nᵀ dA over the whole panel [m²], on which aerodynamic damping acts."""
        return self._uniform(self.mass_integral)

    @cached_property
    def slope_x(self) -> sp.csr_array:
        """∫ N N,xᵀ dA over the whole panel [m]: the work of a pressure that follows w,x."""
        return self._uniform(self.shape(0, 0).T @ (self.weights[:, None] * self.shape(1, 0)))

    @cached_property
    def slope_y(self) -> sp.csr_array:
        """∫ N N,yᵀ dA over the whole panel [m]."""
        return self._uniform(self.shape(0, 0).T @ (self.weights[:, None] * self.shape(0, 1)))

    @cached_property
    def mirror(self) -> tuple[sp.csr_array, sp.csr_array]:
        """Orthonormal bases (free dofs, …) of the motions symmetric and antisymmetric about y = b/2."""
        mesh = self.mesh
        number = np.where(mesh.free_bending, np.cumsum(mesh.free_bending) - 1, -1)
        own = number.reshape(mesh.nx + 1, mesh.ny + 1, 4)
        partner = own[:, ::-1]
        turned = np.array([1.0, 1.0, -1.0, -1.0])  # w and w,x keep their sign in the mirror, w,y and w,xy do not
        sign = np.broadcast_to(turned, own.shape)
        first = (own >= 0) & (own <= partner)
        bases = []
        for parity in (1.0, -1.0):
            # a dof on the mirror line is its own partner, and belongs to one of the two
            kept = first & ((own < partner) | (sign == parity))
            a, b, s = own[kept], partner[kept], parity * sign[kept]
            column = np.arange(len(a))
            lone = a == b
            entries = np.concatenate([np.where(lone, 1.0, np.sqrt(0.5)), np.where(lone, 0.0, s * np.sqrt(0.5))])
            coordinates = (np.concatenate([a, b]), np.concatenate([column, column]))
            bases.append(sp.csr_array((entries, coordinates), shape=(self.bending.size, len(a))))
        return bases[0], bases[1]

    def _uniform(self, block: Floats) -> sp.csr_array:
        return self.bending.matrix(np.broadcast_to(block, (self.mesh.elements, *block.shape)))

    def expand(self, free: Floats) -> Floats:
        """Values on the free bending dofs, (free, …), padded with zeros to all 4·nodes of them."""
        full = np.zeros((len(self.mesh.free_bending), *free.shape[1:]))
        full[self.mesh.free_bending] = free
        return full


@lru_cache(maxsize=4)
def space_of(mesh: Mesh) -> Space:
    """The space of a mesh; kept, because toggling a patch changes nothing in it."""
    return Space(mesh)


@dataclass(frozen=True)
class PlateMatrices:
    """The plate of a design, discretised: structure with its patches on; the flow is added by the plant."""

    space: Space
    """The mesh and its element integrals."""
    stiffness: sp.csr_array
    """(N, N) bending stiffness K [N/m and its moments] over the free dofs."""
    mass: sp.csr_array
    """(N, N) mass M [kg and its moments]."""
    membrane: sp.csr_array
    """(Nm, Nm) in-plane stiffness K_m [N/m]."""
    extension: Floats
    """(elements, 3, 3) A of every element [N/m]."""
    mirrored: bool
    """Whether patches and edges are symmetric about y = b/2."""

    @staticmethod
    def of(design: Design) -> PlateMatrices:
        """Assemble the plate of a design (the seed's 2.12, linear part)."""
        space = space_of(Mesh.of(design.panel, design.mesh))
        laminate = Laminate.of(design)
        return PlateMatrices(
            space=space,
            stiffness=space.bending.matrix(np.einsum("eab,abij->eij", laminate.bending, space.curvature_integrals)),
            mass=space.bending.matrix(laminate.mass[:, None, None] * space.mass_integral),
            membrane=space.inplane.matrix(np.einsum("eab,abij->eij", laminate.extension, space.membrane_integrals)),
            extension=laminate.extension,
            mirrored=design.panel.edges[2] == design.panel.edges[3]
            and space.mesh.mirror_image(design.patches.elements) == design.patches.elements,
        )
