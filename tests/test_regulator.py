"""The regulator: the gain of independent solvers, a stable loop, and what the patches' wiring is."""

from typing import Literal

import control
import msgspec
import numpy as np
import pytest
import scipy.linalg
from panels import Wiring, balance, plant, seed, whole

from solver import Control, ControlError, Design, Loop, Lqr, Plant, law_of, load_design, nfcg
from solver.design import Patches
from solver.mesh import Floats
from solver.piezo import channels
from solver.regulator import lqr_gain

WEIGHTINGS = ("energy", "identity", "diagonal")
Weighting = Literal["energy", "identity", "diagonal"]
BY_HAND = tuple(
    np.concatenate([np.random.default_rng(0).uniform(1e4, 1e7, 24), np.random.default_rng(1).uniform(0.1, 3.0, 24)])
)


def weighted(name: str, weighting: Weighting, wiring: Wiring = "connected") -> Plant:
    """The symmetric plant of a preset with a weighting; by hand, no two modes weigh the same."""
    by_hand = BY_HAND if weighting == "diagonal" else ()
    return plant(seed(name, channels=wiring, weighting=weighting, diagonal=by_hand))


def weights(of: Plant, numbers: list[int]) -> Floats:
    """(2n, 2n) Q in the state (q, q̇), as it is documented, for modes with these places in the design's basis."""
    n, by_hand = of.size, np.array(BY_HAND).reshape(2, 24)[:, numbers].ravel()
    parts = {"energy": np.concatenate([of.model.omega**2, np.ones(n)]), "identity": np.ones(2 * n), "diagonal": by_hand}
    return of.design.control.state_weight * np.diag(parts[of.design.control.weighting])


def even(name: str) -> list[int]:
    """Places of the symmetric modes in the basis of a preset, read off its shapes: w(x, y) = w(x, b - y)."""
    shapes = whole(seed(name)).model.sampled(1, 2)
    return [
        r
        for r in range(24)
        if np.abs(shapes[:, :, r] - shapes[:, ::-1, r]).max() < 1e-6 * np.abs(shapes[:, :, r]).max()
    ]


@pytest.mark.parametrize("name", ["seed-840", "seed-1200"])
@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("wiring", ["connected", "element"])
def test_gain_is_that_of_python_control_and_of_scipy(name: str, weighting: Weighting, wiring: Wiring) -> None:
    of = weighted(name, weighting, wiring)
    a, b = of.system_matrix, of.input_matrix
    q, r = weights(of, even(name)), of.design.control.effort_weight * np.eye(b.shape[1])
    gain, _, _ = control.lqr(a, b, q, r)
    cost = scipy.linalg.solve_continuous_are(a, b, q, r)
    ours = Lqr.of(of).gain
    # both solve the same equation without balancing, and ω² spans six decades: 1e-11 is measured
    np.testing.assert_allclose(ours, gain, atol=1e-8 * np.abs(gain).max())
    np.testing.assert_allclose(ours, np.linalg.solve(r, b.T @ cost), atol=1e-8 * np.abs(gain).max())


@pytest.mark.parametrize("name", ["seed-840", "seed-1200"])
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_closed_loop_has_the_stable_roots_of_the_hamiltonian(name: str, weighting: Weighting) -> None:
    """No Riccati equation at all: [A, -B R⁻¹ Bᵀ; -Q, -Aᵀ] has the optimal loop's roots and their mirror images."""
    of = weighted(name, weighting)
    a, b, q = of.system_matrix, of.input_matrix, weights(of, even(name))
    scale = balance(of)
    a, b, q = a * scale[:, None] / scale, b * scale[:, None], q / scale[:, None] / scale
    drive = b @ b.T / of.design.control.effort_weight
    size = np.sqrt(np.abs(q).max() / np.abs(drive).max())  # makes both corners alike, and changes no root
    roots = np.linalg.eigvals(np.block([[a, -drive * size], [-q / size, -a.T]]))
    closed = np.linalg.eigvals(of.system_matrix - of.input_matrix @ Lqr.of(of).gain)
    stable = np.sort_complex(roots[roots.real < 0])
    assert of.growth.real > 0
    assert closed.real.max() < 0
    # eigenvalues of matrices of some 1e5, whose pairs lie 1 apart or more
    np.testing.assert_allclose(np.sort_complex(closed), stable, atol=1e-4)
    assert Loop.of(of).growth.real == pytest.approx(closed.real.max(), rel=1e-6)  # the same matrix, taken in blocks


def test_weights_by_hand_go_with_their_modes() -> None:
    """With one channel, the plant in all its modes has the symmetric one's gains, and none on antisymmetric modes."""
    design = seed(weighting="diagonal", diagonal=BY_HAND)
    all_modes, some = whole(design), plant(design)
    gain = Lqr.of(all_modes).gain.reshape(1, 2, 24)
    kept = even("seed-840")
    assert 0 < len(kept) < 24
    np.testing.assert_allclose(
        gain[:, :, kept].reshape(1, -1), Lqr.of(some).gain, rtol=1e-7
    )  # of two Riccati solutions
    assert not np.delete(gain, kept, axis=2).any()
    # one mode's weight changed, and only a mode's that is there: an antisymmetric one's does nothing
    odd = next(r for r in range(24) if r not in kept)
    for place, matters in ((odd, False), (24 + odd, False), (kept[1], True), (24 + kept[1], True)):
        heavier = tuple(5 * w if k == place else w for k, w in enumerate(BY_HAND))
        other = Lqr.of(plant(seed(weighting="diagonal", diagonal=heavier))).gain
        assert bool(np.abs(other - Lqr.of(some).gain).max() > 1e-3 * np.abs(other).max()) == matters


def test_weighting_by_hand_can_be_each_of_the_others() -> None:
    frequencies = whole(seed()).model.omega
    energy = (*(frequencies**2), *np.ones(24))
    cases: tuple[tuple[tuple[float, ...], Weighting], ...] = ((energy, "energy"), ((1.0,) * 48, "identity"))
    for diagonal, weighting in cases:
        by_hand = Lqr.of(plant(seed(weighting="diagonal", diagonal=diagonal))).gain
        np.testing.assert_allclose(by_hand, Lqr.of(weighted("seed-840", weighting)).gain, rtol=1e-9)


def test_without_patches_or_control_nothing_is_driven() -> None:
    bare = law_of(plant(load_design("seed-bare")))
    assert bare.gain.shape[0] == 0
    off = seed(kind="off", delay=1e-3, sensor_noise=1e-9)
    loop = Loop.of(plant(off))
    assert not loop.law.gain.any()
    assert loop.law.instant  # nothing is delayed where nothing is asked for
    assert loop.growth == plant(off).growth
    assert loop.growth.real > 0


@pytest.mark.parametrize("kind", ["lqr", "lqg", "rate"])
def test_patches_without_force_drive_nothing(kind: str) -> None:
    design = seed(kind=kind)
    dead = msgspec.structs.replace(design, patches=msgspec.structs.replace(design.patches, d31=0.0))
    of = plant(dead)
    loop = Loop.of(of)
    assert not loop.law.direct(of.force).any()
    assert not loop.law.memory
    assert loop.growth.real == pytest.approx(of.growth.real, rel=1e-9)


def test_a_regulator_that_cannot_be_is_refused_in_one_line() -> None:
    """A layout that has all but no hold of the growing motion, at a price at which control is all but forbidden."""
    design = seed("seed-840", 840.0, state_weight=1e-5, effort_weight=10.0)
    weak = msgspec.structs.replace(design, patches=msgspec.structs.replace(design.patches, d31=-1e-18))
    with pytest.raises(ControlError, match=r"no regulator exists at λ = 840") as caught:
        Loop.of(plant(weak))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("pressure", [840.0, 1200.0])
def test_nfcg_is_symmetric_and_points_to_the_leading_third(pressure: float) -> None:
    design = load_design("seed-bare").with_dynamic_pressure(pressure)
    norms = nfcg(design).reshape(design.mesh.nx, design.mesh.ny)
    # rounding in a Riccati equation of 48 states with 144 inputs
    np.testing.assert_allclose(norms, norms[:, ::-1], rtol=1e-6)
    assert np.all(norms > 0)
    i, _ = np.unravel_index(np.argmax(norms), norms.shape)
    assert i < design.mesh.nx // 3


@pytest.mark.parametrize(
    ("kind", "elements", "groups"),
    [
        ("connected", (20, 21, 26, 27, 32, 33), [(20, 21, 26, 27, 32, 33)]),
        ("connected", (0, 7), [(0,), (7,)]),  # diagonal neighbours share a corner, not an edge
        ("connected", (5, 6), [(5,), (6,)]),  # next in number, but at opposite ends of two rows
        ("connected", (0, 6, 7, 20), [(0, 6, 7), (20,)]),
        ("element", (27, 20, 21), [(20,), (21,), (27,)]),
        ("single", (0, 7, 143), [(0, 7, 143)]),
        ("single", (), []),
        ("connected", (), []),
    ],
)
def test_channels(kind: Wiring, elements: tuple[int, ...], groups: list[tuple[int, ...]]) -> None:
    assert channels(Design(patches=Patches(elements=elements, channels=kind))) == groups


def test_channel_forces_are_sums_of_element_forces() -> None:
    together, single = plant(seed()), plant(seed(channels="element"))
    # symmetric modes alone: antisymmetric ones are made exactly unreachable for the set, not for its elements
    np.testing.assert_allclose(single.force.sum(axis=1), together.force[:, 0], atol=1e-9 * np.abs(together.force).max())


def test_state_space_is_the_plant() -> None:
    of = plant(load_design("seed-1200"))
    system = of.state_space()
    assert system.ninputs == system.noutputs == len(of.channels)
    one, other = (np.sort_complex(values) for values in (system.poles(), np.linalg.eigvals(of.system_matrix)))
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())  # the same matrix: rounding
    # sensing is the reciprocal of driving: charge on a channel is its force a volt, mode by mode
    np.testing.assert_array_equal(np.asarray(system.C)[:, : of.size], of.force.T)


def test_gain_of_several_inputs_at_once_is_not_that_of_each() -> None:
    """NFCG's regulator has all elements at work together: a row is not what an element alone would ask for."""
    bare = plant(load_design("seed-bare"))
    forces = np.random.default_rng(0).standard_normal((bare.size, 3)) * 0.01
    together = lqr_gain(bare, forces)
    a, b = bare.system_matrix, np.vstack([np.zeros_like(forces), forces])
    gain, _, _ = control.lqr(a, b, 1e6 * np.diag(balance(bare) ** 2), Control().effort_weight * np.eye(3))
    np.testing.assert_allclose(together, gain, atol=1e-8 * np.abs(gain).max())
    assert np.abs(lqr_gain(bare, forces[:, :1])[0] - together[0]).max() > 0.1 * np.abs(together).max()
