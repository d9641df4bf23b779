"""A plate of scikit-fem's elements, forms and assembly, fed with the numbers of a Design, beside which ours is tested.

It uses Bogner-Fox-Schmit elements for w and bilinear ones for u and v, as ours does, and shares nothing else: it
rotates stiffnesses as fourth-order tensors, integrates through the thickness by Gauss points, ties and holds edges by a
matrix, condenses with a pseudo-inverse (which needs no pins against rigid motion) and finds λ_cr on all eigenvalues of
dense matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.optimize
from skfem import Basis, BilinearForm, ElementQuad1, ElementQuadBFS, ElementVector, LinearForm, MeshQuad

from solver import Design
from solver.mesh import Floats, Ints

# E1, E2, ν12, G12 [Pa], ρ [kg/m³], α1, α2 [1/K] of the library's materials by their published sources, typed in again
CONSTANTS = {
    "graphite-epoxy": (181e9, 10.3e9, 0.28, 7.17e9, 1600.0, 0.02e-6, 22.5e-6),
    "glass-epoxy": (38.6e9, 8.27e9, 0.26, 4.14e9, 1800.0, 8.6e-6, 22.1e-6),
    "aluminium": (68.95e9, 68.95e9, 0.3, 68.95e9 / 2.6, 2700.0, 22.5e-6, 22.5e-6),
}
VOIGT = ((0, 0), (1, 1), (0, 1))


@dataclass(frozen=True)
class Section:
    """Mass, A, B, D, N_T and M_T of a stack, integrated numerically through its thickness."""

    mass: float
    A: Floats
    B: Floats
    D: Floats
    force: Floats
    moment: Floats


def turned_stiffness(constants: tuple[float, ...], degrees: float) -> tuple[Floats, Floats]:
    """Plane-stress stiffness (3, 3) and free strain (3,) a kelvin in the panel's axes, by rotation of tensors."""
    e1, e2, nu, g, _, alpha1, alpha2 = constants
    compliance = np.array([[1 / e1, -nu / e1, 0], [-nu / e1, 1 / e2, 0], [0, 0, 1 / g]])
    own = np.linalg.inv(compliance)
    tensor = np.zeros((2, 2, 2, 2))
    for p, (i, j) in enumerate(VOIGT):
        for q, (k, m) in enumerate(VOIGT):
            for a, b in {(i, j), (j, i)}:
                for c, d in {(k, m), (m, k)}:
                    tensor[a, b, c, d] = own[p, q]
    angle = np.radians(degrees)
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])  # columns: fibre, across
    turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", axes, axes, axes, axes, tensor)
    free = axes @ np.diag([alpha1, alpha2]) @ axes.T
    stiffness = np.array([[turned[ij + km] for km in VOIGT] for ij in VOIGT])
    return stiffness, np.array([free[0, 0], free[1, 1], 2 * free[0, 1]])


def section(layers: list[tuple[tuple[float, ...], float, float, float]]) -> Section:
    """Resultants of layers (constants, angle, bottom, top)."""
    points, weights = np.polynomial.legendre.leggauss(3)
    mass, A, B, D, force, moment = 0.0, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for constants, angle, bottom, top in layers:
        stiffness, free = turned_stiffness(constants, angle)
        for s, weight in zip(points, weights, strict=True):
            z, dz = (bottom + top) / 2 + s * (top - bottom) / 2, weight * (top - bottom) / 2
            mass += constants[4] * dz
            A, B, D = A + stiffness * dz, B + stiffness * z * dz, D + stiffness * z**2 * dz
            force, moment = force + stiffness @ free * dz, moment + stiffness @ free * z * dz
    return Section(mass, A, B, D, force, moment)


class Twin:
    """The plate of a design by scikit-fem, dense."""

    def __init__(self, design: Design, order: int = 9) -> None:
        panel, size = design.panel, design.mesh
        self.design = design
        grid = MeshQuad.init_tensor(
            np.linspace(0, panel.length, size.nx + 1), np.linspace(0, panel.width, size.ny + 1)
        ).with_boundaries(
            {
                "0": lambda x: np.isclose(x[0], 0),
                "1": lambda x: np.isclose(x[0], panel.length),
                "2": lambda x: np.isclose(x[1], 0),
                "3": lambda x: np.isclose(x[1], panel.width),
            }
        )
        self.w = Basis(grid, ElementQuadBFS(), intorder=order)
        self.u = self.w.with_element(ElementVector(ElementQuad1()))
        self.bare, self.patched = section(self._skin()), section(self._skin() + self._pair())
        x, y = grid.p[:, grid.t].mean(axis=1)
        ids = (x / panel.length * size.nx).astype(int) * size.ny + (y / panel.width * size.ny).astype(int)
        self.on = np.isin(ids, design.patches.elements)
        self.free = self._free()
        self.ties = self._ties()

    def _skin(self) -> list[tuple[tuple[float, ...], float, float, float]]:
        panel = self.design.panel
        if not panel.plies:
            e, nu = panel.young, panel.poisson
            constants = (e, e, nu, e / (2 * (1 + nu)), panel.density, panel.expansion, panel.expansion)
            return [(constants, 0.0, -panel.thickness / 2, panel.thickness / 2)]
        layers, z = [], -sum(ply.thickness for ply in panel.plies) / 2
        for ply in panel.plies:
            layers.append((CONSTANTS[ply.material], ply.angle_deg, z, z + ply.thickness))
            z += ply.thickness
        return layers

    def _pair(self) -> list[tuple[tuple[float, ...], float, float, float]]:
        patch, half = self.design.patches, self.design.panel.thickness / 2
        e, nu = patch.young, patch.poisson
        constants = (e, e, nu, e / (2 * (1 + nu)), patch.density, patch.expansion, patch.expansion)
        return [(constants, 0.0, -half - patch.thickness, -half), (constants, 0.0, half, half + patch.thickness)]

    def by_element(self, name: str) -> Floats:
        """A property of the section, (..., elements, 1)."""
        one, two = np.asarray(getattr(self.bare, name)), np.asarray(getattr(self.patched, name))
        return np.where(self.on, two[..., None], one[..., None])[..., None]

    def _free(self) -> Ints:
        held = []
        for side, edge in enumerate(self.design.panel.edges):
            along, across = ("u_y", "u_x") if side < 2 else ("u_x", "u_y")
            names = {"f": [], "s": ["u", along], "c": ["u", along, across, "u_xy"]}[edge]
            if names:
                held.append(self.w.get_dofs(str(side)).all(names))
        return np.setdiff1d(np.arange(self.w.N), np.concatenate(held))

    def _ties(self) -> Floats:
        """(all in-plane dofs, unknowns): what is held has no column, a straight edge has one."""
        panel = self.design.panel
        leader = np.arange(self.u.N)
        for side in range(4):
            kind = "f" if panel.edges[side] == "f" else panel.inplane[side]
            dofs = self.u.get_dofs(str(side))
            normal = dofs.all([f"u^{side // 2 + 1}"])
            if kind == "i":
                leader[dofs.all()] = -1
            elif kind == "n":
                leader[normal] = -1
            elif kind == "s":
                leader[normal] = normal[0]
        matrix = np.zeros((self.u.N, self.u.N))
        kept = leader >= 0
        matrix[np.flatnonzero(kept), leader[kept]] = 1
        return matrix[:, matrix.any(axis=0)]

    @cached_property
    def K(self) -> Floats:
        D = self.by_element("D")
        return self._bending(BilinearForm(lambda w, v, _: np.einsum("ab...,a...,b...", D, curvature(v), curvature(w))))

    @cached_property
    def M(self) -> Floats:
        mass = self.by_element("mass")
        return self._bending(BilinearForm(lambda w, v, _: mass * w * v))

    @cached_property
    def area(self) -> Floats:
        return self._bending(BilinearForm(lambda w, v, _: w * v))

    @cached_property
    def flow(self) -> Floats:
        """∫ v (w,x cosΛ + w,y sinΛ) dA."""
        yaw = np.radians(self.design.flow.yaw_deg)
        return self._bending(BilinearForm(lambda w, v, _: v * (w.grad[0] * np.cos(yaw) + w.grad[1] * np.sin(yaw))))

    @cached_property
    def Km(self) -> Floats:
        A = self.by_element("A")
        form = BilinearForm(lambda u, v, _: np.einsum("ab...,a...,b...", A, strain(v), strain(u)))
        return self.ties.T @ form.assemble(self.u).toarray() @ self.ties

    @cached_property
    def Kmb(self) -> Floats:
        B = self.by_element("B")
        form = BilinearForm(lambda w, v, _: np.einsum("ab...,a...,b...", B, strain(v), curvature(w)))
        return self.ties.T @ form.assemble(self.w, self.u).toarray()[:, self.free]

    @cached_property
    def condensed(self) -> Floats:
        return self.K - self.Kmb.T @ np.linalg.pinv(self.Km, rcond=1e-12, hermitian=True) @ self.Kmb

    @property
    def rise(self) -> Floats:
        """(elements, points) temperature over the state free of stress [K]."""
        panel, load = self.design.panel, self.design.load
        x, y = np.asarray(self.w.global_coordinates()) / np.array([panel.length, panel.width])[:, None, None]
        return load.temperature + load.temperature_centre * 16 * x * (1 - x) * y * (1 - y)

    @property
    def preload(self) -> Floats:
        """(3, 1, 1) uniform stress resultant [N/m]."""
        load, unit = self.design.load, np.pi**2 * self.rigidity / self.design.panel.length**2
        return -unit * np.array([load.preload_x, load.preload_y, 0.0])[:, None, None]

    @cached_property
    def prestress(self) -> tuple[Floats, Floats]:
        """N (3, elements, points) before deflection, and the static force of heat on w."""
        force, moment = self.by_element("force") * self.rise, self.by_element("moment") * self.rise
        push = LinearForm(lambda v, _: np.einsum("a...,a...", force, strain(v))).assemble(self.u)
        u = self.ties @ np.linalg.pinv(self.Km, rcond=1e-12, hermitian=True) @ self.ties.T @ push
        stretched = strain(self.u.interpolate(u))
        N = np.einsum("ab...,b...->a...", self.by_element("A"), stretched) - force
        N += self.preload
        bend = moment - np.einsum("ba...,b...->a...", self.by_element("B"), stretched)
        return N, LinearForm(lambda v, _: np.einsum("a...,a...", bend, curvature(v))).assemble(self.w)[self.free]

    @cached_property
    def KN(self) -> Floats:
        nx, ny, nxy = self.prestress[0]

        def work(w, v, _):  # noqa: ANN001, ANN202 - scikit-fem's fields
            along, across = nx * w.grad[0] + nxy * w.grad[1], nxy * w.grad[0] + ny * w.grad[1]
            return along * v.grad[0] + across * v.grad[1]

        return self._bending(BilinearForm(work))

    @property
    def rigidity(self) -> float:
        """D11 with all plies at 0°."""
        return section([(constants, 0.0, low, high) for constants, _, low, high in self._skin()]).D[0, 0]

    def _bending(self, form: BilinearForm) -> Floats:
        return form.assemble(self.w).toarray()[np.ix_(self.free, self.free)]

    def frequencies(self, count: int) -> Floats:
        """Lowest natural frequencies [rad/s]."""
        return np.sqrt(scipy.linalg.eigh(self.condensed, self.M, eigvals_only=True)[:count])

    def critical(self) -> float:
        """λ_cr by a scan and Brent's method on all eigenvalues, damped as C_a says."""
        panel = self.design.panel
        unit = self.rigidity / panel.length**3
        root = np.linalg.inv(np.linalg.cholesky(self.M))
        stiffness = root @ (self.condensed + self.KN) @ root.T
        slope = unit * root @ self.flow @ root.T
        rate = np.sqrt(self.rigidity * self.bare.mass) / panel.length**2  # ω0 ρ h
        drag = rate * root @ self.area @ root.T
        n, first = len(stiffness), self.frequencies(1)[0]

        def growth(pressure: float) -> float:
            if self.design.flow.damping == 0:
                roots = np.linalg.eigvals(stiffness + pressure * slope)
                # two that meet leave the axis as a root does, far faster than rounding moves a simple eigenvalue
                return float(np.abs(roots.imag).max() / roots.real.min()) - 1e-6 if roots.real.min() > 0 else 1.0
            damper = np.sqrt(pressure * self.design.flow.damping) * drag
            companion = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness - pressure * slope, -damper]])
            # at zero itself a weakly damped root crosses so slowly that our threshold would show
            return float(np.linalg.eigvals(companion).real.max() / first) - 1e-6

        low, step = 0.0, 80.0  # windows of instability narrower than this are not looked for
        while growth(low + step) <= 0:
            low += step
            assert low < 20_000
        return scipy.optimize.brentq(growth, low, low + step, rtol=1e-7)

    def deflected(self, pressure: float) -> Floats:
        """(all dofs of w,) under a uniform pressure [Pa], preload and heat, by Newton on both together.

        Heat acts through N and M themselves, not through a first stage of stresses before deflection.
        """
        A, B, D = (self.by_element(name) for name in "ABD")
        force, moment = self.by_element("force") * self.rise, self.by_element("moment") * self.rise
        w, u = np.zeros(self.w.N), np.zeros(self.u.N)
        for _ in range(60):
            now, within = self.w.interpolate(w), self.u.interpolate(u)
            stretched = strain(within) + slopes(now, now) / 2
            N = times(A, stretched) + times(B, curvature(now)) - force
            M = times(B, stretched) + times(D, curvature(now)) - moment
            along = N + self.preload
            f_w = LinearForm(lambda v, _: dot(along, slopes(now, v)) + dot(M, curvature(v)) - pressure * v)  # noqa: B023
            f_u = LinearForm(lambda v, _: dot(N, strain(v)))  # noqa: B023
            residual = np.concatenate([f_w.assemble(self.w)[self.free], self.ties.T @ f_u.assemble(self.u)])

            def ww(d, v, _):  # noqa: ANN001, ANN202
                membrane = times(A, slopes(now, d)) + times(B, curvature(d))  # noqa: B023
                bend = times(B, slopes(now, d)) + times(D, curvature(d))  # noqa: B023
                return dot(membrane, slopes(now, v)) + dot(along, slopes(d, v)) + dot(bend, curvature(v))  # noqa: B023

            def uw(d, v, _):  # noqa: ANN001, ANN202
                return dot(times(A, slopes(now, d)) + times(B, curvature(d)), strain(v))  # noqa: B023

            mixed = self.ties.T @ BilinearForm(uw).assemble(self.w, self.u).toarray()[:, self.free]
            tangent = np.block([[self._bending(BilinearForm(ww)), mixed.T], [mixed, self.Km]])
            # rigid motion in the plane is left to the least squares; rows weigh alike once scaled
            scale = 1 / np.sqrt(np.abs(np.diag(tangent)))
            step = -scale * np.linalg.lstsq(scale[:, None] * tangent * scale, scale * residual, rcond=1e-13)[0]
            w[self.free] += step[: len(self.free)]
            u += self.ties @ step[len(self.free) :]
            if np.abs(step[: len(self.free)]).max() <= 1e-10 * np.abs(w).max():
                return w
        raise AssertionError("Newton did not converge")


def times(matrix: Floats, vector: Floats) -> Floats:
    return np.einsum("ab...,b...->a...", matrix, vector)


def dot(one: Floats, other: Floats) -> Floats:
    return np.einsum("a...,a...", one, other)


def slopes(w, v) -> Floats:  # noqa: ANN001
    """(w,x v,x, w,y v,y, w,x v,y + w,y v,x): twice the von Kármán strain where w is v."""
    return np.array([w.grad[0] * v.grad[0], w.grad[1] * v.grad[1], w.grad[0] * v.grad[1] + w.grad[1] * v.grad[0]])


def curvature(w) -> Floats:  # noqa: ANN001 - a field of scikit-fem
    return -np.array([w.hess[0, 0], w.hess[1, 1], 2 * w.hess[0, 1]])


def strain(u) -> Floats:  # noqa: ANN001
    return np.array([u.grad[0, 0], u.grad[1, 1], u.grad[0, 1] + u.grad[1, 0]])
