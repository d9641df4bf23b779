"""The plate beside an independent one: scikit-fem's elements, forms and assembly, fed with the numbers of the Design.

Both use Bogner-Fox-Schmit elements for w and bilinear ones for u and v on the same mesh, so that they must agree to
rounding; nothing else is shared. The twin rotates stiffnesses as fourth-order tensors, integrates through the thickness
by Gauss points, ties and holds edges by a matrix, condenses with a pseudo-inverse (which needs no pins against rigid
motion) and finds λ_cr on all eigenvalues of dense matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, ElementQuad1, ElementQuadBFS, ElementVector, LinearForm, MeshQuad

from solver import Design, Flow, MeshSize, ModalModel, Panel, Patches, critical_pressure_full
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.design import Load, Ply, Reduction
from solver.mesh import Floats, Ints
from solver.vonkarman import membrane_force, membrane_tangent

# E1, E2, ν12, G12 [Pa], ρ [kg/m³], α1, α2 [1/K] of the library's materials by their published sources, typed in again
CONSTANTS = {
    "graphite-epoxy": (181e9, 10.3e9, 0.28, 7.17e9, 1600.0, 0.02e-6, 22.5e-6),
    "glass-epoxy": (38.6e9, 8.27e9, 0.26, 4.14e9, 1800.0, 8.6e-6, 22.1e-6),
    "aluminium": (68.95e9, 68.95e9, 0.3, 68.95e9 / 2.6, 2700.0, 22.5e-6, 22.5e-6),
}
VOIGT = ((0, 0), (1, 1), (0, 1))

FREQUENCY = 1e-7  # relative: Lanczos and dense eigensolvers on matrices whose condition is about 1e6
PRESSURE = 2e-6  # relative: λ_cr is where growth passes 1e-6 ω1, to 1e-9 on our side and 1e-7 on the twin's


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


def stack(material: str, *angles: float) -> tuple[Ply, ...]:
    return tuple(Ply(material, angle, 0.00025) for angle in angles)


def design(
    edges: str = "ssss",
    inplane: str = "iiii",
    plies: tuple[Ply, ...] = (),
    load: Load | None = None,
    elements: tuple[int, ...] = (),
    damping: float = 0.0,
    yaw: float = 0.0,
    width: float = 0.3048,
    mesh: tuple[int, int] = (5, 4),
    modes: int = 8,
) -> Design:
    thickness = sum(ply.thickness for ply in plies) or 0.00127
    return Design(
        panel=Panel(edges=edges, inplane=inplane, plies=plies, thickness=thickness, width=width),
        mesh=MeshSize(*mesh),
        flow=Flow(damping=damping, yaw_deg=yaw),
        load=load or Load(),
        patches=Patches(elements=elements),
        reduction=Reduction("patched", modes),
    )


PATCHES = (5, 6, 9, 10, 17)  # of a 5 × 4 mesh, with no symmetry
CROSS, ANGLE, SKEW = (stack("graphite-epoxy", *angles) for angles in ((0, 0, 90, 90), (45, -45), (0, 30, -45)))
HYBRID = (Ply("graphite-epoxy", 20, 0.0003), Ply("glass-epoxy", -40, 0.0002), Ply("aluminium", 0, 0.0004))
HEAT = Load(temperature=0.3, temperature_centre=0.4)  # below buckling, which a uniform 1 K gives the seed's panel

CASES = {
    "ssss": design(),
    "ssss damped": design(damping=0.01),
    "cccc": design("cccc", mesh=(4, 6)),
    "scsc": design("scsc"),
    "R_x = 2": design(load=Load(preload_x=2.0)),
    "R_x, R_y, damped and yawed": design(load=Load(preload_x=1.0, preload_y=-0.7), damping=0.02, yaw=20.0),
    "cantilever": design("cfff"),
    "two supported edges that meet": design("sffs"),
    "csfs, yawed and damped": design("csfs", damping=0.05, yaw=30.0, width=0.2),
    "patches": design(elements=PATCHES, damping=0.01),
    "symmetric lay-up": design(plies=stack("graphite-epoxy", 0, 45, 90, 90, 45, 0)),
    "[0/90]": design(plies=CROSS),
    "[0/90], free and normal edges": design(plies=CROSS, inplane="nffi"),
    "[45/-45], normal edges": design(plies=ANGLE, inplane="nnnn"),
    "[0/30/-45], free in its plane, patches": design(plies=SKEW, inplane="ffff", elements=PATCHES, damping=0.01),
    "[0/30/-45], straight edges, patches": design(plies=SKEW, inplane="ssss", elements=PATCHES, damping=0.01),
    "[0/30/-45] cantilever, patches": design("cfff", plies=SKEW, elements=PATCHES, damping=0.01),
    "heat": design(load=HEAT),
    "heat, patches": design(load=HEAT, elements=PATCHES, damping=0.01),
    "heat, patches, straight and free edges": design(
        load=Load(temperature=3.0, temperature_centre=3.0), inplane="snsf", elements=PATCHES, damping=0.01
    ),
    "heat, preload, patches, [0/30/-45]": design(
        plies=SKEW, inplane="nsfs", load=Load(0.0, -1.0, 0.5, 1.0), elements=PATCHES, damping=0.01
    ),
    "heat, three materials, free edges": design("cfsf", "ffff", HYBRID, Load(temperature=0.5, temperature_centre=0.5)),
}


@pytest.mark.parametrize("case", CASES)
def test_frequencies_and_critical_pressure(case: str) -> None:
    chosen = CASES[case]
    twin, model = Twin(chosen), ModalModel.of(chosen)
    np.testing.assert_allclose(model.omega, twin.frequencies(8), rtol=FREQUENCY)
    found = critical_pressure_full(model, Stream.of(chosen))
    assert found is not None
    assert found[0] == pytest.approx(twin.critical(), rel=PRESSURE)


def test_cantilever_has_the_frequencies_of_leissa() -> None:
    # A. W. Leissa, Vibration of Plates, NASA SP-160 (1969), ω a² √(ρh/D) of a square cantilever, ν = 0.3, by a Ritz
    # method of beam functions that stays up to 0.7 % above the converged 3.471, 8.507, 21.28, 27.20 and 30.96
    chosen = design("cfff", mesh=(8, 8), modes=5)
    unit = np.sqrt(68.95e9 * 0.00127**3 / 12 / 0.91 / (2700 * 0.00127)) / 0.3048**2
    found = ModalModel.of(chosen).omega / unit
    np.testing.assert_allclose(found, [3.492, 8.525, 21.43, 27.33, 31.11], rtol=8e-3)
    # those five by a finer mesh; eight elements a side are above them by less than 1e-3
    np.testing.assert_allclose(found, [3.471, 8.507, 21.285, 27.20, 30.955], rtol=1e-3)


@pytest.mark.parametrize(
    ("elements", "inplane", "plies"),
    [((), "iiii", ()), (PATCHES, "iiii", ()), (PATCHES, "snsf", ()), (PATCHES, "ffff", SKEW), ((), "nsnn", HYBRID)],
)
def test_buckling_temperature(elements: tuple[int, ...], inplane: str, plies: tuple[Ply, ...]) -> None:
    # the smallest factor of the heat at which K + factor K_N is singular, u and v condensed out on both sides
    chosen = design(load=HEAT, elements=elements, inplane=inplane, plies=plies)
    twin, plate = Twin(chosen), PlateMatrices.of(chosen)
    assert plate.geometric is not None
    factors = [
        -1 / scipy.linalg.eigh(geometric, stiffness, eigvals_only=True)[0]
        for geometric, stiffness in (
            (plate.geometric.toarray(), plate.condensed_stiffness()),
            (twin.KN, twin.condensed),
        )
    ]
    assert factors[0] > 0
    # a quadratic temperature times slopes squared is of degree 8 in x, and our four points a side exact to 7: 5e-6 here
    assert factors[0] == pytest.approx(factors[1], rel=1e-5)


def letters(alphabet: str) -> st.SearchStrategy[str]:
    return st.text(alphabet, min_size=4, max_size=4)


@st.composite
def panels(draw: st.DrawFn) -> Design:
    edges = draw(letters("scf").filter(lambda e: "c" in e or e.count("s") >= 2))
    inplane = draw(letters("insf"))
    held = ["f" if edge == "f" else kind for edge, kind in zip(edges, inplane, strict=True)]
    if "s" in held:  # straight edges meet no immovable ones
        inplane = inplane.replace("i", "n")
    angles = st.lists(st.floats(-90, 90), min_size=1, max_size=3)
    plies = draw(st.one_of(st.just(()), angles.map(lambda a: stack("graphite-epoxy", *a))))
    return design(
        edges,
        inplane,
        plies,
        Load(*(draw(st.floats(-1, 1)) for _ in range(3)), temperature_centre=draw(st.floats(-1, 1))),
        tuple(draw(st.lists(st.integers(0, 11), max_size=5))),
        width=draw(st.floats(0.1, 0.6)),
        yaw=draw(st.floats(-180, 180)),
        mesh=(4, 3),
    )


@settings(deadline=None, max_examples=15)
@given(panels())
def test_matrices_of_any_panel(chosen: Design) -> None:
    """Eigenvalues and a compliance, which do not depend on how dofs are numbered."""
    twin, plate = Twin(chosen, order=7), PlateMatrices.of(chosen)  # order 7: four points a side, as ours
    stiffness, mass = plate.condensed_stiffness(), plate.mass.toarray()
    ours, other = scipy.linalg.eigh(stiffness, mass)[0], scipy.linalg.eigh(twin.condensed, twin.M)[0]
    # rounding: of the largest for the small ones of a soft panel
    np.testing.assert_allclose(ours, other, rtol=1e-8, atol=1e-11 * other[-1])
    if plate.geometric is not None:
        ours, other = (scipy.linalg.eigvalsh(k, m) for k, m in ((plate.geometric.toarray(), mass), (twin.KN, twin.M)))
        # a panel that is free to expand has stresses of rounding alone, of E α ΔT h
        size = np.abs(other).max() + 1e-6 * np.abs(scipy.linalg.eigh(twin.condensed, twin.M)[0]).max()
        np.testing.assert_allclose(ours, other, atol=1e-8 * size)
        work = [f @ np.linalg.solve(k, f) for f, k in ((plate.load, stiffness), (twin.prestress[1], twin.condensed))]
        # the deflection of heat itself, squared; without a coupling there is none, and 1e-30 J is none
        assert work[0] == pytest.approx(work[1], rel=1e-6, abs=1e-20)


@pytest.mark.parametrize(
    ("plies", "inplane", "edges", "load", "elements"),
    [
        ((), "nnii", "scss", HEAT, (1, 6, 10)),
        (CROSS, "iiii", "ssss", Load(), ()),
        (SKEW, "snsf", "cssc", Load(1.0, -0.5, 3.0, 4.0), (1, 6, 10)),
        (HYBRID, "nsnn", "ssss", Load(temperature=5.0, temperature_centre=10.0), ()),
    ],
)
def test_large_deflection_under_pressure_and_heat(
    plies: tuple[Ply, ...], inplane: str, edges: str, load: Load, elements: tuple[int, ...]
) -> None:
    # every mode of a small mesh, so that the reduced equations are the whole discrete problem, only condensed
    chosen = design(edges, inplane, plies, load, elements, mesh=(4, 3), modes=2)
    plate = PlateMatrices.of(chosen)
    model = ModalModel.of(chosen.with_reduction("patched", plate.stiffness.shape[0]), plate)
    twin = Twin(chosen, order=7)  # four points a side, as ours, or quadrature would differ by 1e-3 on such a mesh
    space = plate.space
    local = space.expand(model.shapes)[space.mesh.bending_dofs]
    push = np.einsum("g,gi,ein->n", space.weights, space.shape(0, 0), local)
    pressure = 2e3  # of a size that bends the panel by its thickness or more
    force = push * pressure + model.load
    q = np.zeros(model.size)
    for _ in range(60):
        residual = model.omega**2 * q + model.geometric @ q + membrane_force(model.membrane, q) - force
        step = np.linalg.solve(
            np.diag(model.omega**2) + model.geometric + membrane_tangent(model.membrane, q), residual
        )
        q -= step
        if np.abs(model.shapes @ step).max() <= 1e-10 * np.abs(model.shapes @ q).max():
            break
    x, y = 0.4 * chosen.panel.length, 0.3 * chosen.panel.width
    deflection = float(model.at(x, y) @ q)
    assert deflection > 0.5 * chosen.panel.thickness  # or it would not be large
    # both Newtons stop at 1e-10 of w; the rest is rounding of sums over all pairs of modes
    w = twin.deflected(pressure)
    assert deflection == pytest.approx((twin.w.probes(np.array([[x], [y]])) @ w)[0], rel=1e-7)
