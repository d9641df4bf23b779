"""The plate beside an independent one, `twin.Twin`, on the same mesh: they must agree to rounding."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from twin import Twin

from solver import Design, Flow, MeshSize, ModalModel, Panel, Patches, critical_pressure_full
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.design import Load, Ply, Reduction
from solver.vonkarman import membrane_force, membrane_tangent

FREQUENCY = 1e-7  # relative: Lanczos and dense eigensolvers on matrices whose condition is about 1e6
PRESSURE = 2e-6  # relative: λ_cr is where growth passes 1e-6 ω1, to 1e-9 on our side and 1e-7 on the twin's


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
