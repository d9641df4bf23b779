"""Root loci: branches without jumps that hold the right roots, and V-g damping that tells where flutter begins."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Design, Flow, ModalModel, RootLocus, critical_pressure, root_locus
from solver.aerodynamics import Stream
from solver.design import Basis, Load, MeshSize, Patches, Reduction
from solver.flutter import buckled, system_matrix

SIX = (20, 21, 26, 27, 32, 33)


def design(
    modes: int = 12,
    basis: Basis = "patched",
    load: Load | None = None,
    damping: float = 0.01,
    yaw: float = 0.0,
    elements: tuple[int, ...] = (),
) -> Design:
    return Design(
        flow=Flow(damping=damping, yaw_deg=yaw),
        load=load or Load(),
        patches=Patches(elements=elements),
        reduction=Reduction(basis, modes),
    )


BUCKLED = Load(preload_x=4.0, preload_y=4.0)
PANELS = [
    design(),
    design(24),
    design(4, "family"),
    design(2, "family"),
    design(elements=SIX),
    design(yaw=35.0),
    design(damping=0.3),
    design(load=BUCKLED),
    design(8, "aeroelastic"),
]


def locus(chosen: Design, points: int, end: float = 1.25) -> RootLocus:
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    found = critical_pressure(model, stream)
    assert found is not None
    return root_locus(model, stream, np.linspace(0, end * found[0], points))


@pytest.mark.parametrize("chosen", PANELS)
@pytest.mark.parametrize("points", [81, 201])
def test_branches_do_not_jump(chosen: Design, points: int) -> None:
    """Of no step is more than a few times the larger of its neighbours.

    Where two roots meet, they come and go as the square root of the distance. If one step holds the meeting in its
    middle, it is √(1/2 + 1/2) long and either neighbour √(3/2) - √(1/2): 1.93 of them, the most there is; damping and
    the ends of other branches make it less. A branch that took another's root would step by the distance of the two.
    """
    found = locus(chosen, points)
    steps = np.abs(np.diff(found.roots, axis=0))
    longest = np.maximum(steps[:-2], steps[2:])
    rounding = 1e-6 * np.abs(found.roots).max()  # a double root is known to the square root of rounding
    assert np.all(steps[1:-1] <= 2.0 * longest + rounding)


@pytest.mark.parametrize("chosen", PANELS)
def test_every_root_is_an_eigenvalue_and_every_pair_is_there(chosen: Design) -> None:
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    found = locus(chosen, 41)
    for pressure, roots in zip(found.dynamic_pressures, found.roots, strict=True):
        values = np.linalg.eigvals(system_matrix(model, stream, float(pressure)))
        scale = 1e-9 * np.abs(values).max()  # the same eigensolver on the same matrix
        assert len(roots) == model.size
        for value in values[values.imag > scale]:
            assert np.abs(roots - value).min() <= scale
        for root in roots:
            assert np.abs(values - root).min() <= scale
        assert np.all(roots.imag >= 0)
        assert abs(roots.real.max() - values.real.max()) <= scale  # what leads is never the half that is left out


@pytest.mark.parametrize("chosen", [panel for panel in PANELS if panel.load == Load()])
def test_damping_turns_positive_at_the_critical_pressure(chosen: Design) -> None:
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    critical = critical_pressure(model, stream)
    assert critical is not None
    shares = np.array([0.0, 0.3, 0.7, 0.9, 0.999, 0.99999, 1.00001, 1.001, 1.05])
    found = root_locus(model, stream, shares * critical[0])
    highest = found.damping.max(axis=1)
    assert found.damping[0] == pytest.approx(np.zeros(model.size), abs=1e-9)  # no flow, no damping: rounding
    assert np.all(highest[1:6] < 0)
    assert np.all(highest[6:] > 0)
    # the branch that crosses has the frequency of flutter there, to what a hundred-thousandth of λ changes
    crossing = int(np.argmax(found.damping[6]))
    assert found.roots[6, crossing].imag == pytest.approx(critical[1], rel=1e-4)


@pytest.mark.parametrize("pressure", [0.01, 1.0])
@pytest.mark.parametrize("damping", [0.01, 1.0])
def test_damping_of_one_oscillator(pressure: float, damping: float) -> None:
    """q̈ + c q̇ + ω² q = 0 has s = -ζω ± iω √(1 - ζ²) with ζ = c/2ω, so |s| = ω and g = 2 Re s/|s| = -2ζ = -c/ω."""
    chosen = design(2, "family", damping=damping)
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    found = root_locus(model, stream, np.array([0.0, pressure]))
    rates = stream.rate(pressure) * np.diag(model.bare_mass)
    # the slope couples the two by λ/600 of their stiffness, whose square is what it adds to either's
    np.testing.assert_allclose(found.damping[1], -rates / model.omega, rtol=1e-5)
    np.testing.assert_allclose(np.abs(found.roots[1]), model.omega, rtol=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 8), st.floats(0.0, 1.0), st.floats(10.0, 1500.0), st.integers(5, 60))
def test_as_many_branches_as_modes_whatever_the_points(modes: int, damping: float, end: float, points: int) -> None:
    chosen = design(8, damping=damping)
    model, stream = MODEL.first(modes), Stream.of(chosen)
    found = root_locus(model, stream, np.linspace(0, end, points))
    assert found.roots.shape == found.damping.shape == (points, modes)
    np.testing.assert_allclose(found.roots[0].imag, model.omega, rtol=1e-9)  # branches start in order of frequency
    assert np.all(np.abs(found.damping) <= 2)
    # the order of the branches does not touch what is in them
    for pressure, roots in zip(found.dynamic_pressures[::10], found.roots[::10], strict=True):
        values = np.linalg.eigvals(system_matrix(model, stream, float(pressure)))
        assert roots.real.max() == pytest.approx(values.real.max(), abs=1e-9 * np.abs(values).max())


MODEL = ModalModel.of(design(8))


def test_real_roots_of_a_buckled_panel() -> None:
    chosen = design(load=BUCKLED)
    model = ModalModel.of(chosen)
    assert buckled(model)
    found = locus(chosen, 201)
    still = found.roots[0]
    real = still[still.imag == 0]
    # at R = 4 mode (1,1), which gives way at 2, is the only one below its load: it grows at Ω √(R/2 - 1)
    assert len(real) == 1
    assert real[0].real == pytest.approx(model.omega[0], rel=1e-4)  # the mesh's buckling load
    # g is 2 of a root that grows without turning, and -2 of one that dies so
    assert found.damping[0].max() == 2.0
    # where the stream makes the pair turn, the branch goes on: from a real root to a complex one without a jump
    branch = int(np.argmax(found.damping[0]))
    assert found.roots[-1, branch].imag > 0
    assert np.all(np.diff(np.abs(found.roots[:, branch].imag) > 0).astype(int) >= 0)  # real once, never again


def test_a_root_at_rest_has_no_damping() -> None:
    assert RootLocus(np.zeros(1), np.zeros((1, 2), dtype=complex)).damping.tolist() == [[0.0, 0.0]]


def test_overdamped_roots_are_kept_real() -> None:
    """So heavy a damping that no mode turns: of either pair the slower root stays."""
    chosen = Design(mesh=MeshSize(8, 4), flow=Flow(damping=100.0), reduction=Reduction("family", 2))
    model, stream = ModalModel.of(chosen), Stream.of(chosen)
    found = root_locus(model, stream, np.array([200.0, 300.0]))
    values = np.linalg.eigvals(system_matrix(model, stream, 300.0))
    assert not values.imag.any()
    np.testing.assert_allclose(np.sort(found.roots[1].real), np.sort(values.real)[2:], rtol=1e-9)  # rounding
    assert not found.roots.imag.any()
