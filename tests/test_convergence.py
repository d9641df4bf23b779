"""Convergence rates: halving the elements must cut the errors as theory says, not only make them small.

With shape functions complete to degree p = 3 and energy in second derivatives (m = 2), eigenvalues converge as
h^(2(p + 1 - m)) = h⁴, and so does λ_cr, where two of them meet.
"""

import numpy as np
import pytest
import scipy.optimize

from solver import Design, Flow, MeshSize, ModalModel, Panel, critical_pressure
from solver.aerodynamics import Stream
from solver.design import Reduction
from solver.laminate import reference_frequency

SIZES = (6, 8, 12, 16, 24)
SLOPE = 3.8  # theory has 4; coarse meshes are not quite there yet
ROUNDING = 1e-9  # errors below this would measure the eigensolver, not the mesh


def slope(errors: list[float]) -> float:
    """Exponent p of error = c h^p, by least squares on logarithms."""
    assert min(errors) > ROUNDING
    return float(np.polyfit(-np.log(SIZES), np.log(errors), 1)[0])


def design(n: int, basis: str, modes: int, panel: Panel | None = None) -> Design:
    reduction = Reduction("family" if basis == "family" else "patched", modes)
    return Design(panel=panel or Panel(), mesh=MeshSize(n, n), flow=Flow(damping=0.0), reduction=reduction)


def test_frequencies_of_a_simply_supported_plate() -> None:
    panel = Panel(width=0.25)  # no two of the first modes have one frequency
    m, n = (index.ravel() for index in np.meshgrid(np.arange(1, 6), np.arange(1, 6)))
    exact = np.sort((np.pi**2 * (m**2 + (n * panel.length / panel.width) ** 2) * reference_frequency(panel)) ** 2)[:6]
    values = [ModalModel.of(design(size, "patched", 6, panel)).omega ** 2 for size in SIZES]
    errors = np.array(values) / exact - 1  # (sizes, modes)
    assert np.all(errors > 0)  # conforming elements bound frequencies from above
    for mode in range(6):
        assert slope(list(errors[:, mode])) >= SLOPE


def galerkin(modes: int) -> float:
    """λ_cr of the square simply supported panel with sine functions (m,1), undamped, from the meeting of two roots.

    κ_m = π⁴ (m² + 1)², and ∫ sin(mπx) d/dx sin(nπx) dx = 2mn/(m² - n²) for odd m + n, over the norm ∫ sin² dx = 1/2.
    """
    m = np.arange(1, modes + 1)
    odd = (m[:, None] + m) % 2 == 1
    gap = np.where(odd, m[:, None] ** 2 - m**2, 1)
    coupling = np.where(odd, 4.0 * m[:, None] * m / gap, 0.0)
    stiffness = np.diag(np.pi**4 * (m**2 + 1.0) ** 2)

    def apart(value: float) -> float:
        roots = np.linalg.eigvals(stiffness + value * coupling)
        first, second = roots[np.argsort(roots.real)[:2]]
        return float(((first - second) ** 2).real)  # positive while the two are real, negative once they have met

    return scipy.optimize.root_scalar(apart, bracket=(300.0, 600.0), xtol=1e-11).root


def test_two_modes_of_the_galerkin_solution_are_the_exact_ones() -> None:
    assert galerkin(2) == pytest.approx(63 * np.pi**4 / 16, rel=1e-12)  # the root's own accuracy


def test_critical_pressure() -> None:
    exact = galerkin(4)
    errors = []
    for size in SIZES:
        chosen = design(size, "family", 4)
        found = critical_pressure(ModalModel.of(chosen), Stream.of(chosen))
        assert found is not None
        errors.append(abs(found[0] / exact - 1))
    assert slope(errors) >= SLOPE
