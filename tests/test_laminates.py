"""Laminates: A, B, D and thermal resultants by textbook, frequencies by Navier's closed forms, what turning does."""

import msgspec
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, DesignError, Flow, MeshSize, ModalModel, Panel, Patches, critical_pressure_full
from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.design import Load, Ply, Reduction
from solver.laminate import Laminate, Layer, areal_mass, flexural_rigidity, strain_rotation
from solver.materials import material
from solver.mesh import Floats
from solver.vonkarman import membrane_force, membrane_tangent

GRAPHITE = "graphite-epoxy"
ANGLE = st.floats(-180, 180)
ROUNDING = 1e-12


def stack(*angles: float, material: str = GRAPHITE, thickness: float = 0.00025) -> tuple[Ply, ...]:
    return tuple(Ply(material, angle, thickness) for angle in angles)


def design(
    plies: tuple[Ply, ...],
    mesh: tuple[int, int] = (8, 8),
    modes: int = 6,
    inplane: str = "iiii",
    edges: str = "ssss",
    yaw: float = 0.0,
    elements: tuple[int, ...] = (),
    size: tuple[float, float] = (0.3048, 0.3048),
    load: Load | None = None,
) -> Design:
    return Design(
        panel=Panel(*size, sum(ply.thickness for ply in plies), edges=edges, inplane=inplane, plies=plies),
        mesh=MeshSize(*mesh),
        flow=Flow(damping=0.01, yaw_deg=yaw),
        patches=Patches(elements=elements),
        load=load or Load(),
        reduction=Reduction("patched", modes),
    )


def critical(chosen: Design) -> float:
    found = critical_pressure_full(ModalModel.of(chosen), Stream.of(chosen))
    assert found is not None
    return found[0]


def resultants(*plies: Ply, size: float = 1.0) -> Laminate:
    return Laminate.of(design(plies, (2, 2), size=(size, size)))


def skin(plies: tuple[Ply, ...]) -> tuple[Floats, Floats, Floats]:
    laminate = resultants(*plies)
    return laminate.extension[0], laminate.coupling[0], laminate.bending[0]


def test_kaw_example() -> None:
    # A. K. Kaw, Mechanics of Composite Materials, 2nd ed. (2006), example 4.2: [0/30/-45], T300/5208, plies of 5 mm.
    # Kaw's z runs from the first ply to the last, as ours. The book prints four digits and cuts through rounding ones.
    A, B, D = skin(stack(0, 30, -45, thickness=0.005))
    printed = [
        [[1.739e9, 3.884e8, 5.663e7], [3.884e8, 4.533e8, -1.141e8], [5.663e7, -1.141e8, 4.525e8]],
        [[-3.129e6, 9.855e5, -1.072e6], [9.855e5, 1.158e6, -1.072e6], [-1.072e6, -1.072e6, 9.855e5]],
        [[3.343e4, 6.461e3, -5.240e3], [6.461e3, 9.320e3, -5.596e3], [-5.240e3, -5.596e3, 7.663e3]],
    ]
    for ours, book in zip((A, B, D), printed, strict=True):
        np.testing.assert_allclose(ours, book, rtol=1e-3)


def test_kaw_thermal_example() -> None:
    # Kaw's example 4.5: [0/90], plies of 5 mm, cooled by 75 K
    laminate = resultants(*stack(0, 90, thickness=0.005))
    np.testing.assert_allclose(-75 * laminate.thermal_force[0], [-1.131e5, -1.131e5, 0], rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(-75 * laminate.thermal_moment[0], [-1.538e2, 1.538e2, 0], rtol=1e-3, atol=1e-9)


@given(ANGLE)
def test_turning_there_and_back_restores(angle: float) -> None:
    layer = Layer(material(GRAPHITE), np.radians(angle), 0.0, 1.0)
    turn = strain_rotation(np.radians(-angle))
    own = material(GRAPHITE)
    np.testing.assert_allclose(turn.T @ layer.stiffness @ turn, own.stiffness, atol=ROUNDING * own.young_1)
    # a free strain of the layer alone makes no stress in it: Q̄ ᾱ is Q α, turned
    stress = layer.stiffness @ layer.expansion
    expected = own.stiffness @ [own.expansion_1, own.expansion_2, 0]
    assert stress[0] + stress[1] == pytest.approx(expected[0] + expected[1], rel=ROUNDING)
    assert turn.T @ stress == pytest.approx(expected, abs=1e-10 * abs(expected).max())


@given(ANGLE)
def test_invariants(angle: float) -> None:
    # Tsai and Pagano's (Jones 2.93): Q̄11 + Q̄22 + 2 Q̄12 and Q̄66 - Q̄12 are the same at any angle
    own, turned = (Layer(material(GRAPHITE), np.radians(a), 0.0, 1.0).stiffness for a in (0.0, angle))
    for form in ([[1, 1, 0], [1, 1, 0], [0, 0, 0]], [[0, -1, 0], [0, 0, 0], [0, 0, 1]]):
        assert np.sum(turned * form) == pytest.approx(np.sum(own * form), abs=ROUNDING * own[0, 0])
    # U1..U5 themselves: Q̄11 = U1 + U2 cos 2θ + U3 cos 4θ, Q̄16 = (U2 sin 2θ)/2 + U3 sin 4θ (Jones 2.85, 2.92)
    u1 = (3 * own[0, 0] + 3 * own[1, 1] + 2 * own[0, 1] + 4 * own[2, 2]) / 8
    u2, u3 = (own[0, 0] - own[1, 1]) / 2, (own[0, 0] + own[1, 1] - 2 * own[0, 1] - 4 * own[2, 2]) / 8
    t = np.radians(angle)
    bounds = {"abs": ROUNDING * own[0, 0]}
    assert turned[0, 0] == pytest.approx(u1 + u2 * np.cos(2 * t) + u3 * np.cos(4 * t), **bounds)
    assert turned[0, 2] == pytest.approx(u2 / 2 * np.sin(2 * t) + u3 * np.sin(4 * t), **bounds)


@given(st.lists(ANGLE, min_size=1, max_size=5))
def test_symmetric_layups_do_not_couple(angles: list[float]) -> None:
    laminate = resultants(*stack(*angles, *angles[::-1]))
    assert laminate.symmetric
    assert PlateMatrices.of(design(stack(*angles, *angles[::-1]), (2, 2))).coupling is None


@given(st.lists(ANGLE, min_size=2, max_size=5), st.lists(st.sampled_from([GRAPHITE, "glass-epoxy"]), min_size=5))
def test_turning_a_layup_over(angles: list[float], materials: list[str]) -> None:
    """Plies in the opposite order: B and M_T change their sign, all else stays."""
    plies = tuple(Ply(name, angle, 0.0002) for angle, name in zip(angles, materials, strict=False))
    one, other = resultants(*plies), resultants(*plies[::-1])
    for field, sign in (
        ("extension", 1),
        ("bending", 1),
        ("thermal_force", 1),
        ("coupling", -1),
        ("thermal_moment", -1),
    ):
        value = getattr(one, field)
        scale = {"coupling": "extension", "thermal_moment": "thermal_force"}.get(field, field)
        height = 0.0002 * len(plies) if scale != field else 1.0  # of terms that cancel
        atol = ROUNDING * height * np.abs(getattr(one, scale)).max()
        np.testing.assert_allclose(getattr(other, field), sign * value, atol=atol)


@pytest.mark.parametrize(
    ("angles", "mirrored"),
    [
        ((0, 90), True),
        ((90, 0, 0), True),
        ((0, 30, 0), False),
        ((45, -45), False),  # A16 = D16 = 0, but twist pulls: B16 is not
        ((45, -45, -45, 45), False),  # D16
        ((45, -45, 45, -45, -45, 45, -45, 45), False),
        ((-360, 180, 90, -90), True),
    ],
)
def test_only_layups_alike_in_both_spanwise_directions_are_mirrored(angles: tuple[float, ...], mirrored: bool) -> None:
    assert resultants(*stack(*angles)).mirrored is mirrored
    assert PlateMatrices.of(design(stack(*angles), (4, 4))).mirrored is mirrored


def test_patches_add_their_layers_to_a_laminate() -> None:
    chosen = design(stack(0, 30, -45), (2, 2), elements=(1, 2))
    laminate, patch, h = Laminate.of(chosen), chosen.patches, chosen.panel.thickness
    plane = patch.young / (1 - patch.poisson**2) * np.array([[1, 0.3, 0], [0.3, 1, 0], [0, 0, 0.35]])
    hp = patch.thickness
    second = 2 * (hp**3 / 12 + hp * ((h + hp) / 2) ** 2)  # Steiner
    expected = {"extension": 2 * hp * plane, "coupling": 0 * plane, "bending": second * plane, "mass": 2 * hp * 7593}
    for field, more in expected.items():
        value = getattr(laminate, field)
        np.testing.assert_allclose(value[1] - value[0], more, atol=1e-12 * np.abs(value[1]).max())
        np.testing.assert_array_equal(value[[3, 2]], value[[0, 1]])


def test_a_laminate_of_one_isotropic_material_is_the_plain_panel() -> None:
    plain = Design(mesh=MeshSize(12, 6), patches=Patches(elements=(14, 15, 27)), load=Load(0.5, 0.0, 0.2, 0.1))
    h = plain.panel.thickness  # of the library's aluminium
    plies = (Ply("aluminium", 0, 0.2 * h), Ply("aluminium", 33, 0.5 * h), Ply("aluminium", -71, 0.3 * h))
    layered = msgspec.structs.replace(plain, panel=Panel(plies=plies))
    for value in (areal_mass, flexural_rigidity):
        assert value(layered.panel) == pytest.approx(value(plain.panel), rel=ROUNDING)
    one, other = ModalModel.of(plain), ModalModel.of(layered)
    assert other.plate.coupling is None  # B of rounding is none
    # the eigensolver then sees the same matrices but for rounding
    np.testing.assert_allclose(other.omega, one.omega, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(other.geometric), np.linalg.eigvalsh(one.geometric), rtol=1e-8)
    found = [critical_pressure_full(model, Stream.of(plain)) for model in (one, other)]
    assert found[0] == pytest.approx(found[1], rel=1e-7)


def test_specially_orthotropic_frequencies() -> None:
    # Jones, Mechanics of Composite Materials, 2nd ed. (1999), eq. 5.8x (Navier, edges simply supported):
    # ω² ρh = π⁴ (D11 (m/a)⁴ + 2 (D12 + 2 D66)(m/a)²(n/b)² + D22 (n/b)⁴)
    plies, (a, b) = stack(0, 90, 90, 0), (0.4, 0.3)
    _, _, D = skin(plies)
    m, n = (k.ravel() for k in np.meshgrid(np.arange(1, 6), np.arange(1, 6)))
    x, y = (m / a) ** 2, (n / b) ** 2
    square = np.pi**4 * (D[0, 0] * x**2 + 2 * (D[0, 1] + 2 * D[2, 2]) * x * y + D[1, 1] * y**2) / (4 * 0.00025 * 1600)
    exact = np.sort(np.sqrt(square))[:6]
    omega = ModalModel.of(design(plies, (12, 12), size=(a, b))).omega
    # the half-waves of the six are at most three in twelve elements: ω² is high by (π m/12)⁴/720, 5e-4 for m = 3
    assert np.all(omega >= exact * (1 - 1e-9))
    np.testing.assert_allclose(omega, exact, rtol=3e-4)


def angle_ply(plies: tuple[Ply, ...], a: float, b: float, count: int) -> Floats:
    """Lowest frequencies of an antisymmetric angle-ply plate on hinges free along the edge (Jones's S3, section 5.5.3).

    u = U sin px cos qy, v = V cos px sin qy, w = W sin px sin qy with p = mπ/a, q = nπ/b meet all edge conditions:
    along x = 0, u = 0 and N_xy = A66 (u,y + v,x) - B16 w,xx = 0, M_x = B16 (u,y + v,x) - D11 w,xx = 0.
    """
    A, B, D = skin(plies)
    mass = sum(ply.thickness * material(ply.material).density for ply in plies)
    found = []
    for m in range(1, 8):
        for n in range(1, 8):
            p, q = m * np.pi / a, n * np.pi / b
            membrane = np.array(
                [
                    [A[0, 0] * p**2 + A[2, 2] * q**2, (A[0, 1] + A[2, 2]) * p * q],
                    [(A[0, 1] + A[2, 2]) * p * q, A[1, 1] * q**2 + A[2, 2] * p**2],
                ]
            )
            tie = -np.array([3 * B[0, 2] * p**2 * q + B[1, 2] * q**3, B[0, 2] * p**3 + 3 * B[1, 2] * p * q**2])
            bend = D[0, 0] * p**4 + 2 * (D[0, 1] + 2 * D[2, 2]) * p**2 * q**2 + D[1, 1] * q**4
            found.append(np.sqrt((bend - tie @ np.linalg.solve(membrane, tie)) / mass))
    return np.sort(found)[:count]


@pytest.mark.parametrize("angles", [(45, -45), (30, -30, 30, -30)])
def test_antisymmetric_angle_ply_frequencies(angles: tuple[float, ...]) -> None:
    plies, (a, b) = stack(*angles), (0.3, 0.2)
    exact = angle_ply(plies, a, b, 4)
    coarse, fine = (ModalModel.of(design(plies, (n, n), 4, "nnnn", size=(a, b))).omega / exact - 1 for n in (10, 20))
    # u and v are bilinear: the error falls with h², and what two meshes extrapolate to is a power better
    ratio = coarse / fine
    assert np.all((ratio > 3.6) & (ratio < 4.5)), ratio
    np.testing.assert_allclose((4 * fine - coarse) / 3, 0, atol=5e-5)


def test_coupling_softens() -> None:
    # condensed, -K_mbᵀ K_m⁻¹ K_mb is negative: below the frequency of D alone, by far for two plies (Jones fig. 5-31)
    plate = PlateMatrices.of(design(stack(45, -45), inplane="nnnn"))
    alone = scipy.linalg.eigh(plate.stiffness.toarray(), plate.mass.toarray(), eigvals_only=True)[0]
    coupled = scipy.linalg.eigh(plate.condensed_stiffness(), plate.mass.toarray(), eigvals_only=True)[0]
    assert coupled < 0.5 * alone
    assert np.sqrt(coupled) == pytest.approx(ModalModel.of(design(stack(45, -45), inplane="nnnn")).omega[0], rel=1e-8)


@pytest.mark.parametrize(
    ("angles", "inplane", "edges", "n"),
    [((0,) * 8, "iiii", "ssss", 12), ((0, 30, -45), "iiii", "csfs", 8), ((0, 0, 90), "nfsf", "ssss", 8)],
)
def test_turning_layup_edges_and_flow_together(angles: tuple[float, ...], inplane: str, edges: str, n: int) -> None:
    """By 90°: plies and flow from x to y; the edges x = 0, a go to y = 0, b, and y = 0, b to x = a, 0."""

    def turn(letters: str) -> str:
        x0, xa, y0, yb = letters
        return yb + y0 + x0 + xa

    one = critical(design(stack(*angles), (n, n), 8, inplane, edges))
    other = critical(design(stack(*(t + 90 for t in angles)), (n, n), 8, turn(inplane), turn(edges), 90.0))
    assert other == pytest.approx(one, rel=1e-7)  # the same equations in another order: rounding, through a double root


@settings(deadline=None, max_examples=8)
@given(st.lists(st.floats(-90, 90), min_size=1, max_size=3), st.floats(-60, 60))
def test_mirroring_layup_and_flow_together(angles: list[float], yaw: float) -> None:
    one, other = (
        critical(design(stack(*(s * t for t in angles)), (6, 4), 8, "nfii", "cfsc"[:2] + edges, s * yaw))
        for s, edges in ((1, "sc"), (-1, "cs"))
    )
    assert other == pytest.approx(one, rel=1e-6)  # rounding; growth of 1e-6 ω1 is the threshold on both sides


def static(model: ModalModel, force: Floats) -> Floats:
    """Amplitudes under a modal force, large deflection: Newton from the flat state."""
    q = np.zeros(model.size)
    for _ in range(80):
        residual = model.omega**2 * q + membrane_force(model.membrane, q) - force
        step = np.linalg.solve(np.diag(model.omega**2) + membrane_tangent(model.membrane, q), residual)
        q -= step
        if np.abs(model.shapes @ step).max() <= 1e-11 * np.abs(model.shapes @ q).max():
            return q
    raise AssertionError("Newton did not converge")


def uniform(model: ModalModel) -> Floats:
    """Modal force of a unit pressure."""
    space = model.plate.space
    local = space.expand(model.shapes)[space.mesh.bending_dofs]
    return np.einsum("g,gi,ein->n", space.weights, space.shape(0, 0), local)


def test_turning_over_turns_the_deflection() -> None:
    """[0/90] under p deflects as [90/0] under -p does to the other side, and unlike itself under -p."""
    models = [ModalModel.of(design(stack(*angles), (6, 6), 12)) for angles in ((0, 90), (90, 0))]
    centre = []
    for model, pressure in ((models[0], 3e3), (models[1], -3e3), (models[0], -3e3)):
        q = static(model, pressure * uniform(model))
        centre.append(model.at(0.1, 0.12) @ q)
    assert centre[1] == pytest.approx(-centre[0], rel=1e-8)  # rounding, and Newton's 1e-11
    # on a square [0/90] turned by 90° is its own other face: at the centre of one p and -p do the same
    assert abs(centre[2] + centre[0]) > 1e-3 * abs(centre[0])


def test_heat_bends_a_cross_ply_strip_as_timoshenko_says() -> None:
    """S. Timoshenko's bimetal (1925) as a laminate: free of all but one clamped edge, one takes the curvature
    (D - B A⁻¹ B)⁻¹ (M_T - B A⁻¹ N_T) ΔT.

    That is what makes its stresses self-balanced (Jones 4.79 with N = M = 0); in a cantilever it holds but for the
    clamp's neighbourhood, which keeps the cross curvature down. Small deflections, linear equations.
    """
    a, b, rise = 0.3, 0.02, 1e-3
    plies = stack(0, 90)
    chosen = design(plies, (24, 4), 8, "ffff", "cfff", size=(a, b), load=Load(temperature=rise))
    plate = PlateMatrices.of(chosen)
    w = np.linalg.solve(plate.condensed_stiffness(), plate.load)
    laminate = Laminate.of(chosen)
    A, B, D = laminate.extension[0], laminate.coupling[0], laminate.bending[0]
    soft = B @ np.linalg.inv(A)
    curvature = np.linalg.solve(D - soft @ B, (laminate.thermal_moment[0] - soft @ laminate.thermal_force[0]) * rise)
    nodal = plate.space.expand(w).reshape(25, 5, 4)
    # κ_x = -w,xx from the slopes at the middle and near the tip, at y = b/2: the clamp is eight widths away. The
    # membrane's bilinear strain is constant across an element where B A⁻¹ B wants w,xx: no error for a constant one
    found = -(nodal[20, 2, 1] - nodal[12, 2, 1]) / (8 * a / 24)
    assert found == pytest.approx(curvature[0], rel=1e-3)
    assert plate.prestress is not None
    # free edges: u follows, and no resultant is left but where w is held from following
    assert np.abs(plate.prestress).max() < 1e-8 * np.abs(laminate.thermal_force[0]).max() * rise


def test_plies_that_do_not_add_up_are_refused() -> None:
    with pytest.raises(DesignError, match=r"panel.thickness.*0.0005 m thick together"):
        Panel(plies=stack(0, 90))
