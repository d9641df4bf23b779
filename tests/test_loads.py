"""Preload, heat, free edges and edges in their plane: identities, closed forms and numbers from the literature."""

import msgspec
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from solver import Design, Flow, MeshSize, ModalModel, Panel, Patches, critical_pressure_full
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.design import Load, Ply, Reduction
from solver.flutter import buckled
from solver.laminate import flexural_rigidity
from solver.mesh import Floats
from solver.piezo import element_forces
from solver.vonkarman import membrane_force, membrane_tangent

SKEW = (Ply("graphite-epoxy", 30, 0.0003), Ply("glass-epoxy", -50, 0.0002), Ply("graphite-epoxy", 90, 0.0003))


def design(
    panel: Panel | None = None,
    load: Load | None = None,
    mesh: tuple[int, int] = (8, 8),
    modes: int = 12,
    damping: float = 0.0,
    yaw: float = 0.0,
    elements: tuple[int, ...] = (),
) -> Design:
    return Design(
        panel=panel or Panel(),
        mesh=MeshSize(*mesh),
        flow=Flow(damping=damping, yaw_deg=yaw),
        load=load or Load(),
        patches=Patches(elements=elements),
        reduction=Reduction("patched", modes),
    )


def critical(chosen: Design) -> float:
    found = critical_pressure_full(ModalModel.of(chosen), Stream.of(chosen))
    assert found is not None
    return found[0]


def buckling_factor(chosen: Design) -> float:
    """The smallest factor on a design's loads at which the flat panel is indifferent."""
    plate = PlateMatrices.of(chosen)
    assert plate.geometric is not None
    # K_N may have either sign, K has not: so K stands on the right, and the factor is -1 over the lowest eigenvalue
    return float(-1 / scipy.linalg.eigh(plate.geometric.toarray(), plate.condensed_stiffness(), eigvals_only=True)[0])


# λ_cr depends on κ_m = π⁴ ((m² + (a/b)²)² - R_x m²) of the half-waves but for what all have in common: on a square
# R_x = 2 leaves m⁴, as a panel of infinite width has, and R_x = 1.5 leaves m⁴ + m²/2, as one of a/b = 0.5 has.
@pytest.mark.parametrize(
    ("preload", "exact", "tol"),
    # the tolerances are those of the references, which several codes agree on
    [(0.0, 512.649, 2e-4), (1.5, 384.175, 3e-4), (2.0, 343.356, 2e-4)],
)
def test_preload_is_a_wider_panel(preload: float, exact: float, tol: float) -> None:
    assert critical(design(load=Load(preload_x=preload), mesh=(24, 6), modes=24)) == pytest.approx(exact, rel=tol)


def test_preload_across_the_flow_changes_no_undamped_critical_pressure() -> None:
    # it lowers every κ of a half-wave across by the same π² R_y; so it does on a mesh, to the error of sin(πy/b) there
    values = [critical(design(load=Load(preload_y=value), mesh=(12, 6))) for value in (-4.0, 0.0, 1.5)]
    np.testing.assert_allclose(values, values[1], rtol=1e-5)


def test_tension_raises_the_critical_pressure() -> None:
    values = [critical(design(load=Load(preload_x=-value), damping=0.01)) for value in (-1.5, 0.0, 2.0, 6.0, 20.0)]
    assert np.all(np.diff(values) > 0)


# R = N a²/(π² D) of a square. Simple supports: closed forms. The rest: S. P. Timoshenko and J. M. Gere, Theory of
# Elastic Stability, 2nd ed. (1961), chapter 9, and for CCCC the converged 10.07 and 5.30; three digits are printed.
# Eight elements a side are high by (π m/8)⁴/720: 3e-5 for m = 1, 5e-4 for m = 2.
@pytest.mark.parametrize(
    ("edges", "compression", "exact", "tol"),
    [
        ("ssss", (1, 0), 4.0, 1e-4),
        ("ssss", (0, 1), 4.0, 1e-4),
        ("ssss", (1, 1), 2.0, 1e-4),
        ("ssss", (1, -1), 25 / 3, 1e-3),  # (m,n) = (2,1): (4 + 1)²/(4 - 1)
        ("sscc", (1, 0), 7.69, 2e-3),
        ("ccss", (1, 0), 6.74, 2e-3),
        ("cccc", (1, 0), 10.07, 2e-3),
        ("cccc", (1, 1), 5.30, 2e-3),
    ],
)
def test_buckling_loads(edges: str, compression: tuple[float, float], exact: float, tol: float) -> None:
    chosen = design(Panel(edges=edges), Load(*map(float, compression)))
    assert buckling_factor(chosen) == pytest.approx(exact, rel=tol)


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.3])
@pytest.mark.parametrize("edges", ["sssf", "sscf"])
def test_buckling_with_a_free_edge(edges: str, poisson: float) -> None:
    """Exact (Timoshenko and Gere, article 9.4): w = Y(y) sin px, p = π/a, by the zero of a determinant.

    Y consists of cosh ry, sinh ry, cos sy and sin sy with r² = p √(N/D) + p² and s² = p √(N/D) - p². At the free edge
    the moment Y,yy - ν p² Y and the force Y,yyy - (2 - ν) p² Y,y are zero.
    """
    p = np.pi  # a = b = 1

    def determinant(load: float) -> float:
        r, s = p * np.sqrt(np.sqrt(load) + 1), p * np.sqrt(np.sqrt(load) - 1)
        ch, sh, c, sn = np.cosh(r), np.sinh(r), np.cos(s), np.sin(s)
        moment_r, moment_s = r**2 - poisson * p**2, -(s**2) - poisson * p**2
        force_r, force_s = r**3 - (2 - poisson) * p**2 * r, -(s**3) - (2 - poisson) * p**2 * s
        if edges[2] == "s":  # A sinh ry + B sin sy
            matrix = [[moment_r * sh, moment_s * sn], [force_r * ch, force_s * c]]
        else:  # A (cosh ry - cos sy) + B (s sinh ry - r sin sy)
            matrix = [
                [moment_r * ch - moment_s * c, s * moment_r * sh - r * moment_s * sn],
                [force_r * sh + force_s * sn, s * force_r * ch - r * force_s * c],
            ]
        return float(np.linalg.det(matrix))

    trial = np.linspace(1.001, 4, 300)
    values = np.array([determinant(load) for load in trial])
    k = np.flatnonzero(values[1:] * values[:-1] < 0)[0]
    exact = scipy.optimize.brentq(determinant, float(trial[k]), float(trial[k + 1]))
    if poisson == 0.25:  # the book's table, three digits of which the last is not certain
        assert exact == pytest.approx({"sssf": 1.44, "sscf": 1.70}[edges], abs=0.01)
    chosen = design(Panel(edges=edges, poisson=poisson), Load(1.0))
    assert buckling_factor(chosen) == pytest.approx(exact, rel=1e-4)  # mesh, as above


def heated(rise: float = 1.0, centre: float = 0.0, inplane: str = "iiii", elements: tuple[int, ...] = ()) -> Design:
    return design(Panel(inplane=inplane), Load(temperature=rise, temperature_centre=centre), elements=elements)


def buckling_temperature(panel: Panel) -> float:
    """ΔT_cr = 2π²D(1 - ν)/(a² E h α) of a square, immovable and simply supported [K]: E α ΔT h/(1 - ν) = 2π²D/a²."""
    stretch = panel.young * panel.thickness * panel.expansion / (1 - panel.poisson)
    return 2 * np.pi**2 * flexural_rigidity(panel) / (panel.length**2 * stretch)


@pytest.mark.parametrize("inplane", ["iiii", "nnnn"])
def test_uniform_heat_is_a_biaxial_preload(inplane: str) -> None:
    critical_rise = buckling_temperature(Panel())
    rise = 0.4 * critical_rise
    hot = PlateMatrices.of(heated(rise, inplane=inplane)).geometric
    pressed = PlateMatrices.of(design(load=Load(2 * 0.4, 2 * 0.4))).geometric
    assert hot is not None
    assert pressed is not None
    # the same matrix, but for rounding of the in-plane solution, which is zero
    np.testing.assert_allclose(hot.toarray(), pressed.toarray(), atol=1e-11 * np.abs(pressed.toarray()).max())
    assert buckling_factor(heated(critical_rise, inplane=inplane)) == pytest.approx(1.0, rel=2e-4)  # mesh, as above


def test_heat_lowers_the_critical_pressure_as_its_preload_does() -> None:
    rise = 0.4 * buckling_temperature(Panel())
    assert critical(heated(rise)) == pytest.approx(critical(design(load=Load(0.8, 0.8))), rel=1e-8)  # rounding
    assert critical(heated(rise)) < critical(heated(0.0)) < critical(heated(-rise))


def test_a_panel_buckles_at_its_critical_temperature() -> None:
    rise = buckling_temperature(Panel())
    # twelve modes of this mesh have the first to 1e-4
    assert [buckled(ModalModel.of(heated(factor * rise))) for factor in (0.999, 1.001)] == [False, True]


def test_heat_between_two_walls_is_a_uniaxial_preload() -> None:
    panel = Panel(inplane="nnff")
    force = panel.young * panel.expansion * panel.thickness  # N_x = -E α h a kelvin, N_y = 0
    preload = force * panel.length**2 / (np.pi**2 * flexural_rigidity(panel))
    hot = PlateMatrices.of(heated(inplane="nnff")).prestress
    pressed = PlateMatrices.of(design(panel, Load(preload_x=preload))).prestress
    assert hot is not None
    assert pressed is not None
    np.testing.assert_allclose(hot, pressed, atol=1e-10 * force)  # rounding of the in-plane solution


@pytest.mark.parametrize("inplane", ["ffff", "ssss", "nsns", "nfsf", "fnns", "snff", "ffsn"])
def test_a_panel_that_can_expand_has_no_stress(inplane: str) -> None:
    plate = PlateMatrices.of(heated(inplane=inplane))
    assert plate.prestress is not None
    held_back = np.abs(plate.laminate.thermal_force).max()
    assert np.abs(plate.prestress).max() < 1e-10 * held_back  # rounding of the in-plane solution


@pytest.mark.parametrize("plies", [(), SKEW])
@pytest.mark.parametrize("elements", [(), (9, 10, 17, 18, 45)])
@pytest.mark.parametrize("inplane", ["ffff", "ssss", "nsns"])
def test_stresses_of_heat_balance(inplane: str, elements: tuple[int, ...], plies: tuple[Ply, ...]) -> None:
    """No cut across the panel transmits a normal force where edges bear no mean force and nothing along themselves.

    In the weak form of the mesh, ∫ N_x over a column of elements stands for the cut through it, because the
    displacement that is a ramp over the column and constant on either side belongs to the bilinear functions. So does
    ∫ N_xy, but the normal tractions on straight edges may leave some of that.
    """
    thickness = sum(ply.thickness for ply in plies) or 0.00127
    panel = Panel(inplane=inplane, plies=plies, thickness=thickness)
    plate = PlateMatrices.of(design(panel, Load(temperature=2.0, temperature_centre=5.0), elements=elements))
    assert plate.prestress is not None
    resultant = np.einsum("g,ega->ea", plate.space.weights, plate.prestress).reshape(8, 8, 3)
    column = panel.length * panel.width / 8
    size = np.abs(plate.prestress).max() * column
    # the parabola of 5 K stresses even a free panel: by more than a hundredth of what 1 K does to one that is held
    assert size > 1e-2 * np.abs(plate.laminate.thermal_force).max() * column
    cuts = [resultant.sum(axis=1)[:, 0], resultant.sum(axis=0)[:, 1]]
    if inplane == "ffff":
        cuts += [resultant.sum(axis=1)[:, 2], resultant.sum(axis=0)[:, 2]]
    np.testing.assert_allclose(cuts, 0, atol=1e-9 * size)  # rounding


@pytest.mark.parametrize("damping", [0.0, 0.05])
@pytest.mark.parametrize(
    ("plies", "elements"), [((), ()), ((), (0, 1, 9, 10, 20)), (SKEW, (0, 1, 9, 10, 20))], ids=["bare", "PZT", "plies"]
)
def test_reversed_flow(plies: tuple[Ply, ...], elements: tuple[int, ...], damping: float) -> None:
    """Where w is zero on every edge, ∫ v w,x is antisymmetric, so that K + λA and its transpose K - λA flutter alike.

    A panel clamped in front has the λ_cr of one clamped behind, and any panel that of the flow turned by 180°.
    """
    thickness = sum(ply.thickness for ply in plies) or 0.00127
    front, behind = (Panel(edges=edges, plies=plies, thickness=thickness) for edges in ("csss", "scss"))
    one = critical(design(front, mesh=(8, 6), modes=24, damping=damping, elements=elements))
    turned = critical(design(front, mesh=(8, 6), modes=24, damping=damping, elements=elements, yaw=180.0))
    assert turned == pytest.approx(one, rel=1e-6)  # rounding about the threshold of growth
    if not plies and not elements:
        other = critical(design(behind, mesh=(8, 6), modes=24, damping=damping))
        assert other == pytest.approx(one, rel=1e-6)


def test_a_free_edge_knows_upstream_from_downstream() -> None:
    # the flow's work on the free edge is ½ w²: the antisymmetry of the last test is gone
    one, other = (critical(design(Panel(edges=edges), damping=0.05)) for edges in ("cfss", "fcss"))
    assert abs(one / other - 1) > 0.1


@pytest.mark.parametrize("edges", ["ssss", "cfsc"])
def test_turning_edges_loads_patches_and_flow_together(edges: str) -> None:
    """Mirror about the diagonal x = y: preloads swap, element (i, j) goes to (j, i), flow at Λ to 90° - Λ."""
    elements, n = (1, 2, 9, 10, 20, 43), 8
    panel, load = Panel(edges=edges, inplane="nsns"), Load(0.6, -0.8, 0.4, 0.5)
    swapped = msgspec.structs.replace(panel, edges=edges[2:] + edges[:2], inplane="nsns")
    flipped = Load(load.preload_y, load.preload_x, load.temperature, load.temperature_centre)
    images = tuple(e % n * n + e // n for e in elements)
    one = critical(design(panel, load, damping=0.02, yaw=25.0, elements=elements))
    other = critical(design(swapped, flipped, damping=0.02, yaw=65.0, elements=images))
    assert other == pytest.approx(one, rel=1e-6)  # the same equations in another order


def static(model: ModalModel, force: Floats, start: Floats) -> Floats:
    """Amplitudes of Ω² q + f(q) = force, by Newton."""
    q = start
    for _ in range(60):
        residual = model.omega**2 * q + membrane_force(model.membrane, q) - force
        step = np.linalg.solve(np.diag(model.omega**2) + membrane_tangent(model.membrane, q), residual)
        q = q - step
        if np.abs(step).max() <= 1e-9 * np.abs(q).max():
            return q
    raise AssertionError("Newton did not converge")


def test_pressure_on_straight_edges() -> None:
    # S. Levy, Bending of rectangular plates with large deflections, NACA TR 737 (1942): uniform pressure p a⁴/(E h⁴)
    # and w/h at the centre, ν² = 0.1, edges that stay straight and bear no mean force; printed to three digits, with
    # 25 modes (eight that uniform pressure drives) and the membrane's mesh error 0.2 %
    levy = {12.1: 0.486, 29.4: 0.962, 56.9: 1.424, 99.4: 1.870, 161.0: 2.307, 247.0: 2.742}
    panel = Panel(poisson=0.1**0.5, inplane="ssss")
    model = ModalModel.of(design(panel, mesh=(24, 24), modes=25)).symmetric()
    space = model.plate.space
    local = space.expand(model.shapes)[space.mesh.bending_dofs]
    push = np.einsum("g,gi,ein->n", space.weights, space.shape(0, 0), local)
    push *= panel.young * panel.thickness**4 / panel.length**4
    q = np.zeros(model.size)
    for pressure, exact in levy.items():
        q = static(model, pressure * push, q)
        deflection = float(model.at(panel.length / 2, panel.width / 2) @ q) / panel.thickness
        assert deflection == pytest.approx(exact, rel=1e-2), pressure


@pytest.mark.parametrize(("inplane", "mean"), [("nnnn", 1.0), ("ssss", 0.0)])
@pytest.mark.parametrize("poisson", [0.3, 0.0])
def test_hardening_of_the_first_mode(inplane: str, mean: float, poisson: float) -> None:
    """α of (1,1) in q̈ + ω² (q + α q³/h²) = 0, W the amplitude of w = W sin px sin py on a square, p = π/a.

    Airy's function E h W²/32 (cos 2px + cos 2py) has no shear at the edges and no mean force; its energy
    E h W⁴ p⁴ a²/128 beside the linear D p⁴ a² W²/2 gives α = 12 (1 - ν²)/32. Walls that hold the normal add the mean
    strain p² W²/8 both ways, of energy E h a² p⁴ W⁴/(64 (1 - ν)): α = 3 (1 + ν)/4. For ν = 0.3 the sum is 1.31625.
    """
    exact = 12 * (1 - poisson**2) / 32 + mean * 3 * (1 + poisson) / 4
    found = []
    for n in (12, 24):
        chosen = design(Panel(inplane=inplane, poisson=poisson), mesh=(n, n), modes=2)
        model = ModalModel.of(chosen.with_reduction("family", 2)).first(1)
        height = chosen.panel.thickness / model.peak[0]
        found.append(2 * model.membrane.quartic[0, 0] * height**2 / model.omega[0] ** 2)
    if mean:
        assert found[1] == pytest.approx(exact, rel=5e-3)  # bilinear membranes of 24 elements: 0.2 %
    # that falls with h²; the next power of 2π/12 is left once it is extrapolated
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(exact, rel=1e-3)


def test_bimorph_cantilever() -> None:
    # PVDF bimorph of Hwang and Park (AIAA J. 31, 1993) and many after them: 100 × 5 × 1 mm, E = 2 GPa, ν = 0,
    # e31 = 0.046 C/m²; 1 V across both layers, half of it on each: tip 3.45e-7 m. Between them lies a skin of 1 µm,
    # which raises the lever by 0.2 % and the stiffness by 0.6 %.
    mesh = (10, 2)
    chosen = Design(
        panel=Panel(0.1, 0.005, 1e-6, "cfff", young=2e9, poisson=0.0, density=1780.0),
        mesh=MeshSize(*mesh),
        patches=Patches(
            elements=tuple(range(20)), thickness=0.0005, young=2e9, poisson=0.0, density=1780.0, d31=0.046 / 2e9
        ),
        reduction=Reduction(modes="all"),
    )
    model = ModalModel.of(chosen)
    q = 0.5 * element_forces(model, chosen).sum(axis=1) / model.omega**2
    assert abs(model.at(0.1, 0.0025) @ q) == pytest.approx(3.45e-7, rel=1e-2)
    # a constant moment bends it as (x/L)²; that it would bend across as well is held back at the clamp alone
    assert model.at(0.05, 0.001) @ q == pytest.approx(0.25 * (model.at(0.1, 0.0025) @ q), rel=1e-3)
