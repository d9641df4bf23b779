"""Owns linear stability in the stream: eigenvalues over dynamic pressure and the critical value λ_cr."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.optimize
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from solver.aerodynamics import Stream
from solver.mesh import Floats
from solver.modes import ModalModel

SCAN_STEP = 40.0  # λ between trial points: narrower windows of instability than this are not looked for
SCAN_END = 20_000.0
RESOLUTION = 1e-9  # relative accuracy of λ_cr as a root; how well the basis resolves it is another matter
JUST_ABOVE = 1 + 1e-6  # where the pair that has met stands out from the rest, to read its frequency
NEAREST = 4  # eigenvalues sought about the flutter frequency; two of them meet
GROWTH_NOISE = 1e-6  # of ω1: an undamped pair about to meet is known to √ε only, so less than this is no growth


def stiffness_in_stream(model: ModalModel, stream: Stream, dynamic_pressure: float) -> Floats:
    """(n, n) modal stiffness with the flow's: Ω² + λ D11/a³ (A_x cosΛ + A_y sinΛ) [1/s²]."""
    slope = stream.cosine * model.slope_x + (stream.sine * model.slope_y if stream.sine else 0.0)
    return np.diag(model.omega**2) + dynamic_pressure * stream.slope_unit * slope


def system_matrix(model: ModalModel, stream: Stream, dynamic_pressure: float) -> Floats:
    """(2n, 2n) state matrix A of the flat panel for X = (q, q̇), the seed's (3.4)."""
    n = model.size
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, n:] = np.eye(n)
    matrix[n:, :n] = -stiffness_in_stream(model, stream, dynamic_pressure)
    matrix[n:, n:] = -stream.rate(dynamic_pressure) * model.bare_mass
    return matrix


def leading_eigenvalue(matrix: Floats) -> complex:
    """The eigenvalue of largest real part, taken with a non-negative imaginary part [1/s].

    Blocks that do not touch each other, as symmetric and antisymmetric modes, are taken apart: less work.
    """
    count, label = connected_components(sp.csr_array(matrix != 0), directed=False)
    blocks = (np.flatnonzero(label == k) for k in range(count))
    values = np.concatenate([np.linalg.eigvals(matrix[np.ix_(b, b)]) for b in blocks])
    value = values[np.argmax(values.real)]
    return complex(value.real, abs(value.imag))


def critical_pressure(model: ModalModel, stream: Stream) -> tuple[float, float] | None:
    """Smallest λ at which the flat panel loses stability, in the given modes.

    Returns:
        λ_cr [-] and the flutter frequency there [rad/s] (0 for divergence); None if stable up to λ = 20 000.
    """
    noise = GROWTH_NOISE * model.omega[0]
    found = _first_root(
        lambda value: leading_eigenvalue(system_matrix(model, stream, value)).real - noise, 0.0, SCAN_STEP, SCAN_END
    )
    if found is None:
        return None
    return found, leading_eigenvalue(system_matrix(model, stream, found * JUST_ABOVE)).imag


def critical_pressure_full(model: ModalModel, stream: Stream) -> tuple[float, float] | None:
    """As `critical_pressure`, with every mode that the mesh has, by shift-and-invert about the model's own answer.

    The model points to where flutter lies; the root is then found on the sparse matrices with no reduction at all.
    """
    estimate = critical_pressure(model, stream)
    if estimate is None:
        return None
    plate, space = model.plate, model.plate.space
    slope = stream.slope_unit * (stream.cosine * space.slope_x + stream.sine * space.slope_y)
    leading = _leading_damped if stream.damping > 0 else _leading_undamped

    def rate(value: float) -> complex:
        pencil = (plate.stiffness + value * slope, stream.rate(value) * space.bare_mass, plate.mass)
        return leading(*pencil, estimate[1] or float(model.omega[0]))

    noise = GROWTH_NOISE * model.omega[0]

    def growth(value: float) -> float:
        return rate(value).real - noise

    near = 0.8 * estimate[0]
    start = near if growth(near) <= 0 else 0.0
    found = _first_root(growth, start, 0.05 * estimate[0], 4 * estimate[0])
    return None if found is None else (found, abs(rate(found * JUST_ABOVE).imag))


def _leading_damped(stiffness: sp.csr_array, damping: sp.csr_array, mass: sp.csr_array, frequency: float) -> complex:
    """Fastest growing of the eigenvalues s nearest to iω of (s² M + s C + K) x = 0, by Arnoldi on its companion."""
    # time in units of 1/ω, so that displacements and rates weigh alike whatever the panel's size
    stiffness, damping = sp.csr_array(stiffness / frequency**2), sp.csr_array(damping / frequency)
    n, shift = mass.shape[0], 1j
    factor = spla.splu((stiffness + shift * damping + shift**2 * mass).tocsc())

    def inverse(state: NDArray[np.complex128]) -> NDArray[np.complex128]:
        x, v = state[:n], state[n:]
        displacement = factor.solve(np.asarray(-(mass @ (v + shift * x)) - damping @ x))
        return np.concatenate([displacement, x + shift * displacement]).astype(np.complex128)

    operator = spla.LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=np.complex128)
    values = shift + 1 / spla.eigs(operator, NEAREST, v0=_start(2 * n).astype(complex), return_eigenvectors=False)
    return complex(values[np.argmax(values.real)]) * frequency


def _leading_undamped(stiffness: sp.csr_array, _: sp.csr_array, mass: sp.csr_array, frequency: float) -> complex:
    """As `_leading_damped` without damping, from the eigenvalues -s² of (K, M), half the size and better behaved."""
    factor = spla.splu((stiffness - frequency**2 * mass).tocsc())
    operator = spla.LinearOperator(mass.shape, matvec=lambda x: factor.solve(np.asarray(mass @ x)), dtype=np.float64)
    values = frequency**2 + 1 / spla.eigs(operator, NEAREST, v0=_start(mass.shape[0]), return_eigenvectors=False)
    roots: NDArray[np.complex128] = np.sqrt(-values.astype(np.complex128))
    return complex(roots[np.argmax(np.abs(roots.real))])


def _start(size: int) -> Floats:
    """A fixed start for Arnoldi, blind to no symmetry: runs repeat to the last digit."""
    return np.random.default_rng(0).standard_normal(size)


def _first_root(growth: Callable[[float], float], start: float, step: float, end: float) -> float | None:
    """Smallest λ in [start, end] at which the growth rate turns positive, by scan and Brent's method."""
    low = start
    while low < end:
        high = min(low + step, end)
        if growth(high) > 0:
            return float(scipy.optimize.brentq(growth, low, high, xtol=RESOLUTION * high, rtol=RESOLUTION))
        low = high
    return None
