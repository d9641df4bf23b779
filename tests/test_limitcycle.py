"""The limit cycle, and what no result may depend on: the size of the panel, the basis that points the way, rounding."""

import msgspec
import pytest

from solver import Design, Loop, Plant, flutter_facts, limit_cycle, load_design, run_facts
from solver.laminate import reference_frequency

FOUR = load_design("seed-bare").with_reduction("family", 4)


def sized(length: float, thickness: float) -> Design:
    """The seed's square panel, larger or smaller."""
    panel = msgspec.structs.replace(FOUR.panel, length=length, width=length, thickness=thickness)
    return msgspec.structs.replace(FOUR, panel=panel)


@pytest.mark.parametrize(("length", "thickness"), [(1.0, 0.00417), (3.0, 0.002), (5.0, 0.0208), (0.03, 0.002)])
def test_the_cycle_scales_with_the_panel(length: float, thickness: float) -> None:
    """At given λ and C_a the equations hold no length but h and no time but 1/ω0."""
    seed, other = (limit_cycle(Loop.of(Plant.of(design))) for design in (FOUR, sized(length, thickness)))
    assert seed is not None
    assert other is not None
    assert seed.converged
    assert other.converged
    # the same computation in other units: what differs is rounding, carried along a slow approach to rest
    assert other.amplitude == pytest.approx(seed.amplitude, rel=1e-4)
    scale = reference_frequency(sized(length, thickness).panel) / reference_frequency(FOUR.panel)
    assert other.frequency == pytest.approx(seed.frequency * scale, rel=1e-4)


def test_an_undamped_panel_below_flutter_does_not_flutter_by_rounding() -> None:
    design = load_design("seed-bare").with_dynamic_pressure(400.0)
    design = msgspec.structs.replace(design, flow=msgspec.structs.replace(design.flow, damping=0.0))
    facts, _ = run_facts(design)
    assert not facts.flutters
    assert facts.lco_amplitude_over_h is None


@pytest.mark.parametrize("modes", [2, 4])
def test_a_poor_basis_does_not_hide_the_full_answer(modes: int) -> None:
    facts = flutter_facts(load_design("seed-bare").with_reduction("patched", modes))
    assert facts.lambda_cr == pytest.approx(514.91, rel=2e-4)  # as with the default basis
    assert facts.lambda_cr_in_basis is not None
    assert facts.lambda_cr_in_basis < 400


@pytest.mark.parametrize("side", [1e-3, 1e3])
def test_the_full_answer_holds_for_any_size(side: float) -> None:
    panel = msgspec.structs.replace(FOUR.panel, length=side, width=side, thickness=side / 240)
    design = msgspec.structs.replace(load_design("seed-bare"), panel=panel)
    assert flutter_facts(design).lambda_cr == pytest.approx(514.9065, rel=1e-6)  # Arnoldi's tolerance, and to spare
