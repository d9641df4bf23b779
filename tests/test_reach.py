"""What the patches reach: growing motions by name, and why a controller leaves one of them."""

import dataclasses

import msgspec
import numpy as np
import pytest
from panels import eigen, plant, seed, whole

from solver import Design, Loop, load_design, seed_protocol
from solver.controlfacts import control_warnings
from solver.piezo import element_forces
from solver.reach import growing_roots, out_of_reach, reached, refusal


def test_the_symmetric_layout_does_not_reach_the_antisymmetric_flutter() -> None:
    """At λ = 1200 on one channel: the seed's ten patches damp the symmetric flutter, and 53.8 /s goes on."""
    of = whole(load_design("seed-1200"))
    symmetric, antisymmetric = growing_roots(of)
    assert (symmetric.parity, antisymmetric.parity) == (1, -1)
    assert symmetric.growth == pytest.approx(of.growth.real, rel=1e-9)
    assert antisymmetric.growth == pytest.approx(53.8, abs=0.1)
    assert antisymmetric.frequency / (2 * np.pi) == pytest.approx(256.7, abs=0.1)
    assert symmetric.authority > 1  # ten patches together against the best one
    assert antisymmetric.authority < 1e-9
    (line,) = out_of_reach(of)
    assert "+53.8 /s, 256.7 Hz, antisymmetric about y = b/2, modes 4 and 3" in line
    assert "patches.channels = element" in line
    assert "\n" not in line
    assert warnings_of(of.design) == [line]
    # it is so: the closed loop grows by just that, and without it is stable
    assert Loop.of(of).growth.real == pytest.approx(antisymmetric.growth, rel=1e-6)
    assert Loop.of(plant(of.design)).growth.real < 0


def test_named_modes_are_of_their_parity_and_of_the_designs_basis() -> None:
    of = whole(load_design("seed-1200"))
    for root in growing_roots(of):
        assert all(of.model.parity[number - 1] == root.parity for number in root.modes)
    alone = plant(of.design)  # numbers of modes stay those of the design
    assert growing_roots(alone)[0].modes == growing_roots(of)[0].modes


def test_patches_on_channels_of_their_own_reach_everything() -> None:
    of = whole(seed("seed-1200", channels="element"))
    assert [root.parity for root in growing_roots(of)] == [1, -1]
    assert all(root.authority > 0.5 for root in growing_roots(of))
    assert out_of_reach(of) == []
    assert Loop.of(of).growth.real < 0


def test_patches_on_one_side_reach_everything() -> None:
    of = whole(load_design("seed-1200").with_elements((14, 20, 26, 32, 38)))
    assert out_of_reach(of) == []
    assert Loop.of(of).growth.real < 0


def test_without_a_patch_everything_is_out_of_reach() -> None:
    of = whole(load_design("seed-bare").with_dynamic_pressure(1200.0))
    lines = out_of_reach(of)
    assert len(lines) == len(growing_roots(of)) == 2
    assert all("there is no patch" in line for line in lines)
    assert ", antisymmetric about" in lines[1]


@pytest.mark.parametrize("name", ["seed-840", "seed-bare"])
def test_below_flutter_nothing_grows(name: str) -> None:
    of = whole(seed(name, 500.0))
    assert growing_roots(of) == []
    assert out_of_reach(of) == []


def test_a_panel_that_is_not_symmetric_has_neither_parity() -> None:
    of = whole(load_design("seed-bare").with_elements((20, 26)).with_dynamic_pressure(1200.0))
    assert {root.parity for root in growing_roots(of)} == {0}


def test_reached_modes_are_those_that_move() -> None:
    """By the exponential: an impulse on the channels moves these modes, and no others at all."""
    of = whole(load_design("seed-840"))
    modes = reached(of, of.force)
    assert (modes == (of.model.parity == 1)).all()
    moved = np.zeros(2 * of.size, dtype=bool)
    power = of.input_matrix
    for _ in range(6):  # B, AB, …: few suffice, for the flow couples neighbours at once
        moved |= power.any(axis=1)
        power = of.system_matrix @ power
        power /= np.abs(power).max()
    np.testing.assert_array_equal(moved[: of.size] | moved[of.size :], modes)
    assert reached(of, np.ones((of.size, 1))).all()
    assert not reached(of, 0 * of.force).any()


def test_refusal_names_what_is_least_in_hold() -> None:
    of = whole(seed("seed-1200", channels="element"))
    line = refusal(of)
    weakest = min(growing_roots(of), key=lambda root: root.authority)
    assert str(weakest) in line
    assert "λ = 1200" in line
    assert "\n" not in line


def test_the_authority_over_a_root_is_how_far_feedback_moves_it() -> None:
    """By finite differences: with ψ, φ the left and right eigenvectors, ds/dε of A - ε b k is -(ψᴴb)(kφ)/(ψᴴφ).

    For one and the same k on one element or another, roots move as authorities.
    """
    of = whole(load_design("seed-bare"))
    forces = element_forces(of.model, of.design)
    values, right = eigen(of.system_matrix)
    leading = int(np.argmax(values.real))
    k = np.random.default_rng(0).standard_normal((1, 2 * of.size))
    small = 1e-2 / np.abs(k @ right[:, leading])[0]
    shifts, authorities = [], []
    for element in (20, 100, 3):
        force = forces[:, [element]]
        moved = np.linalg.eigvals(of.system_matrix - small * np.vstack([0 * force, force]) @ k)
        shifts.append(np.abs(moved - values[leading]).min())
        (root,) = growing_roots(dataclasses.replace(of, force=force, channels=[(element,)]))
        authorities.append(root.authority)
    # the shift's own square is left out: 1e-3 of it at most
    np.testing.assert_allclose(np.array(shifts) / shifts[0], np.array(authorities) / authorities[0], rtol=1e-2)
    assert authorities[0] > 3 * authorities[1]
    assert max(authorities) <= 1


def warnings_of(design: Design) -> list[str]:
    return control_warnings(whole(design), seed_protocol(Loop.of(plant(design))))


def test_a_controller_that_leaves_nothing_has_no_warning() -> None:
    assert warnings_of(load_design("seed-840")) == []
    assert warnings_of(seed(sensor_noise=1e-9)) == [
        "control.sensor_noise is not used: lqr reads the state itself; take lqg or rate"
    ]
    for kind in ("lqg", "rate"):
        assert not any("not used" in line for line in warnings_of(seed(modes=8, kind=kind, sensor_noise=1e-9)))


@pytest.mark.parametrize("control_on", [0.0, 0.05])
def test_a_controller_that_is_too_weak_does_not_feed_the_flutter(control_on: float) -> None:
    """At 1 V it does next to nothing, and what has grown by the end grew by itself."""
    design = seed(modes=8, voltage_limit=1.0)
    run = msgspec.structs.replace(design.run, control_on=control_on, duration=0.4)
    assert not any("feeds" in line for line in warnings_of(msgspec.structs.replace(design, run=run)))
