"""Owns the finite-element matrices of the plate: stiffness, mass and aerodynamics, on the dofs the edges leave free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.sparse as sp

from solver.banded import definite_solver
from solver.bfs import bending_shape, gauss, membrane_strain
from solver.design import Design, Load
from solver.laminate import Laminate, flexural_rigidity
from solver.mesh import Floats, Ints, Mesh
from solver.pattern import Pattern, scatter
from solver.sector import Parity, Sector

STIFFNESS_POINTS = 4  # a side: exact for products of two cubics (degree 6)


@dataclass(frozen=True)
class Space:
    """What a mesh alone determines: sparsity patterns and the element integrals that laminates then weigh."""

    mesh: Mesh
    """The mesh."""

    @cached_property
    def bending(self) -> Pattern:
        """Pattern of the bending dofs."""
        return Pattern.of(self.mesh.bending_dofs, self.mesh.bending_unknowns)

    @cached_property
    def inplane(self) -> Pattern:
        """Pattern of the in-plane dofs."""
        return Pattern.of(self.mesh.inplane_dofs, self.mesh.inplane_unknowns)

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
    def curvature(self) -> Floats:
        """(3, points, 16) κ = -(w,xx, w,yy, 2 w,xy) as in the seed's (2.2), at the Gauss points."""
        return -np.stack([self.shape(2, 0), self.shape(0, 2), 2 * self.shape(1, 1)])

    @cached_property
    def curvature_integrals(self) -> Floats:
        """(3, 3, 16, 16) ∫ κ_a κ_bᵀ dA of an element."""
        return np.einsum("g,agi,bgj->abij", self.weights, self.curvature, self.curvature)

    @cached_property
    def moment_integral(self) -> Floats:
        """(3, 16) ∫ κ dA of an element [-]: the work of unit moments (x, y, xy) on each dof."""
        return self.weights @ self.curvature

    @cached_property
    def strain(self) -> Floats:
        """(3, points, 8) ε = (u,x, v,y, u,y + v,x) at the Gauss points."""
        s, _ = gauss(STIFFNESS_POINTS)
        return membrane_strain(self.mesh, s)

    @cached_property
    def membrane_integrals(self) -> Floats:
        """(3, 3, 8, 8) ∫ ε_a ε_bᵀ dA of an element."""
        return np.einsum("g,agi,bgj->abij", self.weights, self.strain, self.strain)

    @cached_property
    def coupling_integrals(self) -> Floats:
        """(3, 3, 8, 16) ∫ ε_a κ_bᵀ dA of an element."""
        return np.einsum("g,agi,bgj->abij", self.weights, self.strain, self.curvature)

    @cached_property
    def slope_products(self) -> Floats:
        """(3, points, 16, 16) weighted w,x w,xᵀ, w,y w,yᵀ and w,x w,yᵀ + w,y w,xᵀ at the Gauss points."""
        x, y = self.shape(1, 0), self.shape(0, 1)
        xx, yy, xy = (np.einsum("g,gi,gj->gij", self.weights, p, q) for p, q in ((x, x), (y, y), (x, y)))
        return np.stack([xx, yy, xy + xy.transpose(0, 2, 1)])

    @cached_property
    def gauss_points(self) -> tuple[Floats, Floats]:
        """x/a and y/b of the Gauss points, each (elements, points)."""
        mesh, (s, _) = self.mesh, gauss(STIFFNESS_POINTS)
        i, j = np.divmod(np.arange(mesh.elements), mesh.ny)
        along, across = np.repeat(s, len(s)), np.tile(s, len(s))
        return (i[:, None] + along) / mesh.nx, (j[:, None] + across) / mesh.ny

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

    def sector(self, parity: Parity) -> Sector:
        """The motions of one parity about y = b/2, on a mesh whose edges at y = 0 and y = b are alike; or, 0, all."""
        return self._sectors[parity]

    @cached_property
    def _sectors(self) -> dict[Parity, Sector]:
        return {0: Sector(self.mesh, 0), 1: Sector(self.mesh, 1), -1: Sector(self.mesh, -1)}

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
    """The plate of a design, discretised: structure with its patches on; the flow is added by the plant.

    Deflections w and in-plane displacements u about the flat state have the quadratic energy
    ½ wᵀ(K + K_N)w + uᵀ K_mb w + ½ uᵀ K_m u - wᵀ f, on which large deflection then builds.
    """

    space: Space
    """The mesh and its element integrals."""
    laminate: Laminate
    """Section properties of every element."""
    stiffness: sp.csr_array
    """(N, N) bending stiffness K [N/m and its moments] over the free dofs."""
    mass: sp.csr_array
    """(N, N) mass M [kg and its moments]."""
    membrane: sp.csr_array
    """(Nm, Nm) in-plane stiffness K_m [N/m]."""
    coupling: sp.csr_array | None
    """(Nm, N) K_mb that ties u to w where a lay-up is unsymmetric; None where B = 0."""
    prestress: Floats | None
    """(elements, points, 3) stress resultants N before deflection at the Gauss points [N/m]; None if there are none."""
    geometric: sp.csr_array | None
    """(N, N) geometric stiffness K_N of those [N/m and its moments]."""
    load: Floats
    """(N,) static force f on w, of heat in an unsymmetric lay-up [N and its moments]."""
    mirrored: bool
    """Whether patches, lay-up, edges and loads are symmetric about y = b/2."""

    @staticmethod
    def of(design: Design) -> PlateMatrices:
        """Assemble the plate of a design (the seed's 2.12, without the flow).

        Raises:
            DesignError: the in-plane stiffness cannot be solved for the thermal stresses.
        """
        space = space_of(Mesh.of(design.panel, design.mesh))
        laminate = Laminate.of(design)
        membrane = space.inplane.matrix(weighed(laminate.extension, space.membrane_integrals))
        coupling = None if laminate.symmetric else _coupling(space, laminate)
        prestress, load = _prestress(design, space, laminate, membrane)
        products = space.slope_products
        return PlateMatrices(
            space=space,
            laminate=laminate,
            stiffness=space.bending.matrix(weighed(laminate.bending, space.curvature_integrals)),
            mass=space.bending.matrix(laminate.mass[:, None, None] * space.mass_integral),
            membrane=membrane,
            coupling=coupling,
            prestress=prestress,
            geometric=None
            if prestress is None
            else space.bending.matrix(np.einsum("ega,agij->eij", prestress, products, optimize=True)),
            load=load,
            mirrored=design.panel.edges[2] == design.panel.edges[3]
            and design.panel.held[2] == design.panel.held[3]
            and laminate.mirrored
            and space.mesh.mirror_image(design.patches.elements) == design.patches.elements,
        )

    def linear(self, loaded: bool) -> tuple[sp.csr_array, sp.csr_array]:
        """Stiffness and mass of the flat plate, over (w, u) where a lay-up couples the two and over w alone elsewhere.

        Args:
            loaded: whether the stiffness takes in the stresses before deflection.
        """
        stiffness = self.stiffness if self.geometric is None or not loaded else self.stiffness + self.geometric
        if self.coupling is None:
            return sp.csr_array(stiffness), self.mass
        whole = sp.block_array([[stiffness, self.coupling.T], [self.coupling, self.membrane]], format="csr")
        return sp.csr_array(whole), self.widened(self.mass)

    def bending_blocks(self, elements: Ints) -> tuple[Floats, Floats]:
        """Matrices of elements, each (len(elements), 16, 16), whose sums are K and M."""
        stiffness = weighed(self.laminate.bending[elements], self.space.curvature_integrals)
        return stiffness, self.laminate.mass[elements, None, None] * self.space.mass_integral

    def membrane_blocks(self, elements: Ints) -> Floats:
        """(len(elements), 8, 8) matrices of elements whose sum is K_m."""
        return weighed(self.laminate.extension[elements], self.space.membrane_integrals)

    def condensed_stiffness(self) -> Floats:
        """(N, N) stiffness of w before preload and heat, in-plane displacements condensed out: dense."""
        if self.coupling is None:
            return self.stiffness.toarray()
        coupling = self.coupling.toarray()
        return self.stiffness.toarray() - coupling.T @ definite_solver(self.membrane)(coupling)

    def widened(self, matrix: sp.csr_array) -> sp.csr_array:
        """A matrix over w, (N, N), as one over what `linear` is over: nothing but w has mass or feels the flow."""
        if self.coupling is None:
            return matrix
        none = sp.csr_array((self.membrane.shape[0], self.membrane.shape[0]))
        return sp.csr_array(sp.block_diag([matrix, none], format="csr"))


def weighed(stiffness: Floats, integrals: Floats) -> Floats:
    """(elements, k, l) element matrices from stiffnesses (elements, 3, 3) and what they weigh, (3, 3, k, l)."""
    count, size = len(stiffness), integrals.shape[2:]
    return (stiffness.reshape(count, -1) @ integrals.reshape(9, -1)).reshape(count, *size)


def _coupling(space: Space, laminate: Laminate) -> sp.csr_array:
    """(Nm, N) ∫ εᵀ B κ dA, the stiffness between in-plane and bending unknowns of an unsymmetric lay-up."""
    blocks = weighed(laminate.coupling, space.coupling_integrals)
    mesh = space.mesh
    rows = np.broadcast_to(mesh.inplane_unknowns[mesh.inplane_dofs][:, :, None], blocks.shape)
    columns = np.broadcast_to(mesh.bending_unknowns[mesh.bending_dofs][:, None, :], blocks.shape)
    kept = (rows >= 0) & (columns >= 0)
    shape = (space.inplane.size, space.bending.size)
    return sp.csr_array(sp.coo_array((blocks[kept], (rows[kept], columns[kept])), shape=shape))


def _prestress(
    design: Design, space: Space, laminate: Laminate, membrane: sp.csr_array
) -> tuple[Floats | None, Floats]:
    """Stress resultants before deflection (elements, points, 3) [N/m] and the static force (N,) that comes with them.

    Heat strains the panel in its plane as far as edges and neighbours let it: K_m u = ∫ Bᵀ N_T dA, N = A B u - N_T. In
    an unsymmetric lay-up that also bends it: f = ∫ κᵀ (M_T - B ε) dA. Preload is uniform, and along the mid-plane.
    """
    load, mesh, panel = design.load, space.mesh, design.panel
    none = np.zeros(space.bending.size)
    if load == Load():
        return None, none
    unit = np.pi**2 * flexural_rigidity(panel) / panel.length**2
    stress = np.zeros((mesh.elements, len(space.weights), 3))
    stress[..., :2] = -unit * np.array([load.preload_x, load.preload_y])
    if not load.temperature and not load.temperature_centre:
        return stress, none
    x, y = space.gauss_points
    rise = load.temperature + load.temperature_centre * 16 * x * (1 - x) * y * (1 - y)
    held = np.einsum("ea,eg->ega", laminate.thermal_force, rise)
    pull = np.einsum("g,ega,agi->ei", space.weights, held, space.strain, optimize=True)
    u = np.zeros(space.inplane.size + 1)
    number = mesh.inplane_unknowns[mesh.inplane_dofs]  # held dofs, -1, take the place at the end, which stays zero
    u[:-1] = definite_solver(membrane)(scatter(number, pull, space.inplane.size))
    strain = np.einsum("agi,ei->ega", space.strain, u[number])
    stress += np.einsum("eab,egb->ega", laminate.extension, strain) - held
    if not laminate.warps:
        return stress, none
    moment = np.einsum("ea,eg->ega", laminate.thermal_moment, rise)
    moment -= np.einsum("eba,egb->ega", laminate.coupling, strain)
    bend = np.einsum("g,ega,agi->ei", space.weights, moment, space.curvature, optimize=True)
    return stress, scatter(mesh.bending_unknowns[mesh.bending_dofs], bend, space.bending.size)
