"""Owns the rebuild chain written plainly, from a Design to its gain: what the solver's is timed and checked against.

Loops over elements and Gauss points, a sparse matrix from lists of entries, scipy's solvers: as a textbook has it. Of
`solver` it takes the Design, its numbering and its wiring, and no arithmetic.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from solver import Design, DesignError
from solver.design import Load
from solver.piezo import channels

Floats = NDArray[np.floating]

POINTS = 4  # Gauss points a side of an element, as many as the solver's cubic law takes
CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


@dataclass(frozen=True)
class Chain:
    """What a rebuild comes to."""

    shapes: Floats
    """(4·nodes, n) mode shapes as w, w,x, w,y and w,xy of every node, zero where held, ΦᵀMΦ = I [1/√kg]."""
    omega: Floats
    """(n,) natural frequencies [rad/s]."""
    stiffness: Floats
    """(n, n) modal stiffness in the stream [1/s²]."""
    damping: Floats
    """(n, n) modal damping by the stream [1/s]."""
    force: Floats
    """(n, channels) modal force a volt [N/(V·√kg)]."""
    quartic: Floats
    """(pairs, pairs) G over pairs r <= s, as in `solver.vonkarman.LargeDeflection` [J per (kg·m²)²]."""
    gain: Floats
    """(channels, 2n) gain of the regulator [V per unit of q, V·s per unit of q̇]."""


def plain_chain(design: Design, symmetric: bool = False) -> Chain:
    """The chain for an isotropic panel, simply supported and immovable at all edges, in a stream along x.

    Args:
        design: with a number of modes, at least one patch, and lqr by energy.
        symmetric: keep those modes alone that are symmetric about y = b/2, on a symmetric layout.

    Raises:
        DesignError: the design is none of these.
        numpy.linalg.LinAlgError: no regulator exists.
    """
    panel, control, modes = design.panel, design.control, design.reduction.modes
    common = (panel.edges, panel.inplane, panel.plies, design.load, design.patches.material, design.reduction.basis)
    if common != ("ssss", "iiii", (), Load(), "", "patched") or modes == "all" or not design.patches.elements:
        raise DesignError("the plain chain is for a simply supported panel of one material, patched and without loads")
    if (control.kind, control.weighting) != ("lqr", "energy") or design.flow.yaw_deg or design.flow.mach is not None:
        raise DesignError("the plain chain is for lqr by energy, in a stream along x given by its dynamic pressure")
    grid = _Grid.of(design)
    stiffness, mass, membrane, bare_mass, slope = _assembled(design, grid)

    free = grid.free_bending
    start = np.random.default_rng(0).standard_normal(len(free))
    squares, vectors = spla.eigsh(stiffness, modes, mass, sigma=0.0, v0=start)
    order = np.argsort(squares)
    omega, vectors = np.sqrt(squares[order]), vectors[:, order]
    if symmetric:
        image = grid.mirrored(vectors)
        even = np.einsum("ir,ir->r", vectors, mass @ image) > 0  # 1 of a symmetric mode, -1 of an antisymmetric one
        omega, vectors = omega[even], vectors[:, even]
    shapes = np.zeros((4 * grid.nodes, len(omega)))
    shapes[free] = vectors

    rigidity = panel.young * panel.thickness**3 / (12 * (1 - panel.poisson**2))
    reference = math.sqrt(rigidity / (panel.density * panel.thickness * panel.length**4))
    pressure = design.flow.dynamic_pressure
    rate = math.sqrt(pressure * design.flow.damping) * rigidity / (reference * panel.length**4)
    modal_stiffness = np.diag(omega**2) + pressure * rigidity / panel.length**3 * (vectors.T @ slope @ vectors)
    modal_damping = rate * (vectors.T @ bare_mass @ vectors)

    force = _forces(design, grid, shapes)
    n = len(omega)
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-modal_stiffness, -modal_damping]])
    inputs = np.vstack([np.zeros_like(force), force])
    weight = control.state_weight * np.diag(np.concatenate([omega**2, np.ones(n)]))
    effort = control.effort_weight * np.eye(force.shape[1])
    cost = scipy.linalg.solve_continuous_are(system, inputs, weight, effort)
    gain = np.linalg.solve(effort, inputs.T @ cost)
    return Chain(shapes, omega, modal_stiffness, modal_damping, force, _quartic(design, grid, shapes, membrane), gain)


@dataclass(frozen=True)
class _Grid:
    """Nodes, dofs and Gauss points of the mesh."""

    nx: int
    ny: int
    points: list[_Point]
    """Of any element."""
    free_bending: list[int]
    free_inplane: list[int]

    @staticmethod
    def of(design: Design) -> _Grid:
        nx, ny = design.mesh.nx, design.mesh.ny
        held_bending, held_inplane = set(), set()
        for i, j in itertools.product(range(nx + 1), range(ny + 1)):
            node = i * (ny + 1) + j
            if i in (0, nx):  # w = 0 along the edge, and so w,y
                held_bending |= {4 * node, 4 * node + 2}
            if j in (0, ny):  # w and w,x
                held_bending |= {4 * node, 4 * node + 1}
            if i in (0, nx) or j in (0, ny):
                held_inplane |= {2 * node, 2 * node + 1}
        nodes = (nx + 1) * (ny + 1)
        return _Grid(
            nx,
            ny,
            _points(design.panel.length / nx, design.panel.width / ny),
            [dof for dof in range(4 * nodes) if dof not in held_bending],
            [dof for dof in range(2 * nodes) if dof not in held_inplane],
        )

    @property
    def nodes(self) -> int:
        return (self.nx + 1) * (self.ny + 1)

    def element_nodes(self, element: int) -> list[int]:
        """Its four nodes in the order of `CORNERS`."""
        i, j = divmod(element, self.ny)
        return [(i + p) * (self.ny + 1) + j + q for p, q in CORNERS]

    def bending_dofs(self, element: int) -> list[int]:
        """Its 16 bending dofs, four a node."""
        return [4 * node + k for node in self.element_nodes(element) for k in range(4)]

    def inplane_dofs(self, element: int) -> list[int]:
        """Its 8 in-plane dofs, u and v a node."""
        return [2 * node + k for node in self.element_nodes(element) for k in range(2)]

    def mirrored(self, vectors: Floats) -> Floats:
        """The motions (free dofs, n) that a mirror at y = b/2 shows: w,y and w,xy change their sign."""
        full = np.zeros((4 * self.nodes, vectors.shape[1]))
        full[self.free_bending] = vectors
        image = full.reshape(self.nx + 1, self.ny + 1, 4, -1)[:, ::-1] * np.array([1, 1, -1, -1])[:, None]
        return image.reshape(full.shape)[self.free_bending]


@dataclass(frozen=True)
class _Point:
    """A Gauss point of an element, and the shape functions there."""

    weight: float
    """Its share of the element's area [m²]."""
    w: Floats
    """(16,) bending functions."""
    w_x: Floats
    """(16,) their derivative by x."""
    w_y: Floats
    """(16,) their derivative by y."""
    curvature: Floats
    """(3, 16) κ = -(w,xx, w,yy, 2 w,xy)."""
    strain: Floats
    """(3, 8) ε = (u,x, v,y, u,y + v,x) of the in-plane dofs."""


def _points(hx: float, hy: float) -> list[_Point]:
    """The Gauss points of an element; all elements are alike."""
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    points = []
    for (x, along), (y, across) in itertools.product(zip(places, weights, strict=True), repeat=2):
        s, t = (x + 1) / 2, (y + 1) / 2
        curvature = [_bending(s, t, hx, hy, 2, 0), _bending(s, t, hx, hy, 0, 2), 2 * _bending(s, t, hx, hy, 1, 1)]
        strain = np.zeros((3, 8))
        for k, (p, q) in enumerate(CORNERS):
            by_x = (1 if p else -1) / hx * (t if q else 1 - t)
            by_y = (1 if q else -1) / hy * (s if p else 1 - s)
            strain[:, 2 * k] = by_x, 0, by_y
            strain[:, 2 * k + 1] = 0, by_y, by_x
        points.append(
            _Point(
                weight=along * across / 4 * hx * hy,
                w=_bending(s, t, hx, hy, 0, 0),
                w_x=_bending(s, t, hx, hy, 1, 0),
                w_y=_bending(s, t, hx, hy, 0, 1),
                curvature=-np.array(curvature),
                strain=strain,
            )
        )
    return points


def _hermite(s: float, size: float, derivative: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Cubics of (value, slope) at the left end, then at the right, or a derivative of theirs by x = s·size."""
    match derivative:
        case 0:
            left, right = (1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3), (3 * s**2 - 2 * s**3, s**3 - s**2)
        case 1:
            left, right = (6 * s**2 - 6 * s, 1 - 4 * s + 3 * s**2), (6 * s - 6 * s**2, 3 * s**2 - 2 * s)
        case _:
            left, right = (12 * s - 6, 6 * s - 4), (6 - 12 * s, 6 * s - 2)
    scale = size**derivative
    return (left[0] / scale, left[1] * size / scale), (right[0] / scale, right[1] * size / scale)


def _bending(s: float, t: float, hx: float, hy: float, dx: int, dy: int) -> Floats:
    """(16,) derivative of the Bogner-Fox-Schmit functions of w, w,x, w,y and w,xy at each corner."""
    along, across = _hermite(s, hx, dx), _hermite(t, hy, dy)
    return np.array([along[p][a] * across[q][b] for p, q in CORNERS for b in (0, 1) for a in (0, 1)])


def _section(design: Design, element: int) -> tuple[float, Floats, Floats]:
    """Mass a unit area, A and D of an element: the skin, and a layer of thickness h_p on either side where patched."""
    panel, patches = design.panel, design.patches
    skin, half = _plane_stress(panel.young, panel.poisson), panel.thickness / 2
    mass, extension, bending = panel.density * panel.thickness, skin * panel.thickness, skin * 2 * half**3 / 3
    if element in patches.elements:
        layer, outer = _plane_stress(patches.young, patches.poisson), half + patches.thickness
        mass += 2 * patches.density * patches.thickness
        extension = extension + layer * 2 * patches.thickness
        bending = bending + layer * 2 * (outer**3 - half**3) / 3
    return mass, extension, bending


def _plane_stress(young: float, poisson: float) -> Floats:
    """(3, 3) stiffness of an isotropic layer in plane stress [Pa]."""
    return young / (1 - poisson**2) * np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])


def _assembled(design: Design, grid: _Grid) -> tuple[sp.csc_array, ...]:
    """K, M and K_m of the panel with its patches, then ∫ N Nᵀ dA and ∫ N N,xᵀ dA."""
    bending_dofs, inplane_dofs = [], []
    stiffness, mass, membrane, bare_mass, slope = [], [], [], [], []
    for element in range(grid.nx * grid.ny):
        areal_mass, extension, bending = _section(design, element)
        k, m, a, k_m = np.zeros((16, 16)), np.zeros((16, 16)), np.zeros((16, 16)), np.zeros((8, 8))
        for point in grid.points:
            k += point.weight * point.curvature.T @ bending @ point.curvature
            m += point.weight * np.outer(point.w, point.w)
            a += point.weight * np.outer(point.w, point.w_x)
            k_m += point.weight * point.strain.T @ extension @ point.strain
        bending_dofs.append(grid.bending_dofs(element))
        inplane_dofs.append(grid.inplane_dofs(element))
        stiffness.append(k)
        mass.append(areal_mass * m)
        membrane.append(k_m)
        bare_mass.append(m)
        slope.append(a)
    return (
        _summed(bending_dofs, stiffness, grid.free_bending),
        _summed(bending_dofs, mass, grid.free_bending),
        _summed(inplane_dofs, membrane, grid.free_inplane),
        _summed(bending_dofs, bare_mass, grid.free_bending),
        _summed(bending_dofs, slope, grid.free_bending),
    )


def _summed(dofs: list[list[int]], blocks: list[Floats], free: list[int]) -> sp.csc_array:
    """The sum of element matrices with the given dofs, on the dofs that are free."""
    rows = np.concatenate([np.repeat(own, len(own)) for own in dofs])
    columns = np.concatenate([np.tile(own, len(own)) for own in dofs])
    values = np.concatenate([block.ravel() for block in blocks])
    return sp.csc_array(sp.coo_array((values, (rows, columns))).tocsc()[free][:, free])


def _forces(design: Design, grid: _Grid, shapes: Floats) -> Floats:
    """(n, channels) work of a volt's moments on the curvature of each mode, over the patches of each channel."""
    patches = design.patches
    moment = -patches.young * patches.d31 * (design.panel.thickness + patches.thickness) / (1 - patches.poisson)
    groups = channels(design)
    force = np.zeros((shapes.shape[1], len(groups)))
    for c, group in enumerate(groups):
        for element in group:
            local = shapes[grid.bending_dofs(element)]
            for point in grid.points:
                force[:, c] += point.weight * moment * (point.curvature[0] + point.curvature[1]) @ local
    return force


def _quartic(design: Design, grid: _Grid, shapes: Floats, membrane: sp.csc_array) -> Floats:
    """G: the energy of every pair's strain with every other's, less what the in-plane displacements relieve."""
    r, s = np.triu_indices(shapes.shape[1])
    energy = np.zeros((len(r), len(r)))
    pull = np.zeros((2 * grid.nodes, len(r)))
    for element in range(grid.nx * grid.ny):
        _, extension, _ = _section(design, element)
        local, dofs = shapes[grid.bending_dofs(element)], grid.inplane_dofs(element)
        for point in grid.points:
            w_x, w_y = point.w_x @ local, point.w_y @ local
            strain = np.array([w_x[r] * w_x[s], w_y[r] * w_y[s], w_x[r] * w_y[s] + w_y[r] * w_x[s]]) / 2
            stress = point.weight * extension @ strain
            energy += strain.T @ stress
            pull[dofs] += point.strain.T @ stress
    pull = pull[grid.free_inplane]
    factor = spla.splu(membrane)
    for pair in range(len(r)):
        energy[:, pair] -= pull.T @ factor.solve(pull[:, pair])
    return energy
