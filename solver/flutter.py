"""Owns linear stability in the stream: eigenvalues over dynamic pressure and the critical value λ_cr."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from solver.aerodynamics import Stream
from solver.bases import lowest_modes
from solver.blocks import blocks_of
from solver.mesh import Floats, Ints
from solver.modes import ModalModel

SCAN_STEP = 40.0  # λ between trial points: narrower windows of instability than this are not looked for
SCAN_END = 20_000.0
RESOLUTION = 1e-9  # relative accuracy of λ_cr as a root; how well the basis resolves it is another matter
JUST_ABOVE = 1 + 1e-6  # where the pair that has met stands out from the rest, to read its frequency
WINDOWS = 10  # parts of a small λ_cr below which instability that ends again is looked for
GUIDE = 40  # modes at least that point the full-order search to where flutter lies
CLEARANCE = 2e-3  # of λ_cr: so far below it nothing else must grow
SHIFTS = 5  # places on the frequency axis at which that is looked at, NEAREST roots each
SMALL = 24  # unknowns up to which all eigenvalues are sought at once
NEAREST = 4  # eigenvalues sought about the flutter frequency; two of them meet
GROWTH_NOISE = 1e-6  # of ω1: an undamped pair about to meet is known to √ε only, so less than this is no growth


def stiffness_in_stream(model: ModalModel, stream: Stream, dynamic_pressure: float) -> Floats:
    """(n, n) modal stiffness with the flow's: Ω² + Φᵀ K_N Φ + λ D11/a³ (A_x cosΛ + A_y sinΛ) [1/s²]."""
    return np.diag(model.omega**2) + model.geometric + dynamic_pressure * _flow(model, stream)


def _flow(model: ModalModel, stream: Stream) -> Floats:
    """(n, n) modal stiffness of the flow at λ = 1 [1/s²]."""
    return stream.slope_unit * (stream.cosine * model.slope_x + (stream.sine * model.slope_y if stream.sine else 0.0))


def system_matrix(model: ModalModel, stream: Stream, dynamic_pressure: float) -> Floats:
    """(2n, 2n) state matrix A of the flat panel for X = (q, q̇), the seed's (3.4)."""
    damping = stream.rate(dynamic_pressure) * model.bare_mass
    return _first_order(stiffness_in_stream(model, stream, dynamic_pressure), damping)


def _first_order(stiffness: Floats, damping: Floats) -> Floats:
    n = len(stiffness)
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, n:] = np.eye(n)
    matrix[n:, :n], matrix[n:, n:] = -stiffness, -damping
    return matrix


def leading_eigenvalue(matrix: Floats, slowest: float = -1.0) -> complex:
    """The eigenvalue of largest real part, taken with a non-negative imaginary part [1/s].

    With `slowest` [rad/s], only those that turn faster than it count (-∞ if there are none); by default all do. Blocks
    that do not touch each other, as symmetric and antisymmetric modes, are taken apart: less work.
    """
    values = np.concatenate([np.linalg.eigvals(matrix[np.ix_(block, block)]) for block in blocks_of(matrix != 0)])
    return leading_of(values, slowest)


def leading_of(values: NDArray[np.inexact], slowest: float = -1.0) -> complex:
    """The one of largest real part among eigenvalues, as `leading_eigenvalue` gives it."""
    values = values[np.abs(values.imag) > slowest]
    if not len(values):
        return complex(-np.inf, 0.0)
    value = values[np.argmax(values.real)]
    return complex(value.real, abs(value.imag))


def critical_pressure(model: ModalModel, stream: Stream) -> tuple[float, float] | None:
    """Smallest λ at which the flat panel loses stability, in the given modes.

    A panel that preload or heat has buckled is not stable in still air either: there, the smallest λ at which it begins
    to oscillate about the flat state with growing amplitude.

    Returns:
        λ_cr [-] and the flutter frequency there [rad/s] (0 for divergence); None if stable up to λ = 20 000.
    """
    found = None
    # modes that do not touch each other, as symmetric and antisymmetric ones, flutter each at their own λ
    for modes in blocks_of((stiffness_in_stream(model, stream, 1.0) != 0) | (model.bare_mass != 0)):
        found = _critical_of(model, stream, modes, found[0] if found else SCAN_END) or found
    return found


def _critical_of(model: ModalModel, stream: Stream, modes: Ints, end: float) -> tuple[float, float] | None:
    """As `critical_pressure`, of some modes that no others touch, at a λ up to an end."""
    noise = GROWTH_NOISE * model.omega[0]
    slowest = noise if buckled(model) else -1.0
    own = np.ix_(modes, modes)
    still, unit, mass = stiffness_in_stream(model, stream, 0.0)[own], _flow(model, stream)[own], model.bare_mass[own]

    def leading(value: float) -> complex:
        return leading_of(np.linalg.eigvals(_first_order(still + value * unit, stream.rate(value) * mass)), slowest)

    @cache
    def growth(value: float) -> float:
        return leading(value).real - noise

    found = _first_root(growth, 0.0, min(SCAN_STEP, end / WINDOWS), end)
    if found is not None and found < SCAN_STEP * WINDOWS:  # a small λ_cr may have smaller windows below it
        found = _first_root(growth, 0.0, found / WINDOWS, found) or found
    return None if found is None else (found, leading(found * JUST_ABOVE).imag)


def buckled(model: ModalModel) -> bool:
    """Whether preload or heat buckles the flat panel with no flow: its stiffness is not positive definite."""
    if model.plate.geometric is None:
        return False
    return bool(np.linalg.eigvalsh(np.diag(model.omega**2) + model.geometric)[0] <= 0)


def critical_pressure_full(model: ModalModel, stream: Stream) -> tuple[float, float] | None:
    """As `critical_pressure`, with every mode that the mesh has, by shift-and-invert on the sparse matrices.

    At least `GUIDE` modes point to where flutter lies; the root is then found with no reduction at all. Below it the
    eigenvalues near the guide's other roots are looked at as well, and if some root grows there already, its own λ_cr
    is sought.
    """
    guide = model if model.size >= GUIDE else _guide(model)
    estimate = critical_pressure(guide, stream)
    if estimate is None:
        return None
    pencil = _Pencil(guide, stream)
    found = pencil.critical(0.8 * estimate[0], estimate[0], estimate[1] or float(guide.omega[0]))
    while found is not None:
        below = (1 - CLEARANCE) * found[0]
        growing = next((f for f in _frequencies(guide, stream, below) if pencil.growth(below, f) > 0), None)
        earlier = pencil.critical(0.0, below, growing) if growing is not None else None
        if earlier is None or earlier[0] >= below:
            return found
        found = earlier
    return None


def _guide(model: ModalModel) -> ModalModel:
    count = min(GUIDE, model.plate.stiffness.shape[0] // 2)
    return ModalModel(model.plate, *lowest_modes(model.plate, count)) if count > model.size else model


def _frequencies(model: ModalModel, stream: Stream, value: float) -> list[float]:
    """Frequencies among the model's lowest roots at λ, one to every few that one shift finds [rad/s]."""
    roots = np.linalg.eigvals(system_matrix(model, stream, value))
    turning = np.sort(np.abs(roots.imag[roots.imag > 0]))[: NEAREST * SHIFTS]
    return [float(f) for f in turning[NEAREST // 2 :: NEAREST]]


class _Pencil:
    """The full-order eigenvalue problem (s² M + s C + K) x = 0 over λ."""

    def __init__(self, model: ModalModel, stream: Stream) -> None:
        plate, space = model.plate, model.plate.space
        self.stream = stream
        self.slope = plate.widened(stream.slope_unit * (stream.cosine * space.slope_x + stream.sine * space.slope_y))
        self.damping = plate.widened(space.bare_mass)
        self.stiffness, self.mass = plate.linear(loaded=True)
        self.noise = GROWTH_NOISE * float(model.omega[0])
        self.slowest = self.noise if buckled(model) else -1.0

    def leading(self, value: float, frequency: float) -> complex:
        """Fastest growing of the roots nearest to a frequency [rad/s] at λ [1/s]."""
        solve = _leading_damped if self.stream.damping > 0 else _leading_undamped
        stiffness = sp.csr_array(self.stiffness + value * self.slope)
        if self.mass.shape[0] <= SMALL:  # too few for Arnoldi
            return self._dense(stiffness.toarray(), self.stream.rate(value) * self.damping.toarray())
        return solve(stiffness, self.stream.rate(value) * self.damping, self.mass, frequency, self.slowest)

    def _dense(self, stiffness: Floats, damping: Floats) -> complex:
        n = len(stiffness)
        zero, one = np.zeros((n, n)), np.eye(n)
        left = np.block([[zero, one], [-stiffness, -damping]])
        right = np.block([[one, zero], [zero, self.mass.toarray()]])
        values = scipy.linalg.eigvals(left, right)
        values = values[np.isfinite(values) & (np.abs(values.imag) > self.slowest)]
        return complex(values[np.argmax(values.real)]) if len(values) else complex(-np.inf, 0.0)

    def growth(self, value: float, frequency: float) -> float:
        """Its growth beyond rounding [1/s]."""
        return self.leading(value, frequency).real - self.noise

    def critical(self, start: float, estimate: float, frequency: float) -> tuple[float, float] | None:
        """λ_cr from a start on, or from 0 if it grows there already, and the frequency there [rad/s]."""

        def growth(value: float) -> float:
            return self.growth(value, frequency)

        low = start if growth(start) <= 0 else 0.0
        found = _first_root(growth, low, 0.05 * estimate, 4 * estimate)
        return None if found is None else (found, abs(self.leading(found * JUST_ABOVE, frequency).imag))


def _leading_damped(
    stiffness: sp.csr_array, damping: sp.csr_array, mass: sp.csr_array, frequency: float, slowest: float
) -> complex:
    """Fastest growing of the eigenvalues s nearest to iω of (s² M + s C + K) x = 0, by Arnoldi on its companion."""
    import scipy.sparse.linalg as spla  # here, because it is slow to import

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
    values = values[np.abs(values.imag) > slowest / frequency]
    return complex(values[np.argmax(values.real)]) * frequency if len(values) else complex(-np.inf, 0.0)


def _leading_undamped(
    stiffness: sp.csr_array, _: sp.csr_array, mass: sp.csr_array, frequency: float, slowest: float
) -> complex:
    """As `_leading_damped` without damping, from the eigenvalues -s² of (K, M), half the size and better behaved."""
    import scipy.sparse.linalg as spla  # here, because it is slow to import

    factor = spla.splu((stiffness - frequency**2 * mass).tocsc())
    operator = spla.LinearOperator(mass.shape, matvec=lambda x: factor.solve(np.asarray(mass @ x)), dtype=np.float64)
    values = frequency**2 + 1 / spla.eigs(operator, NEAREST, v0=_start(mass.shape[0]), return_eigenvectors=False)
    roots: NDArray[np.complex128] = np.sqrt(-values.astype(np.complex128))
    roots = roots[np.abs(roots.imag) > slowest]
    return complex(roots[np.argmax(np.abs(roots.real))]) if len(roots) else complex(-np.inf, 0.0)


def _start(size: int) -> Floats:
    """A fixed start for Arnoldi, blind to no symmetry: runs repeat to the last digit."""
    return np.random.default_rng(0).standard_normal(size)


def _first_root(growth: Callable[[float], float], start: float, step: float, end: float) -> float | None:
    """Smallest λ in [start, end] at which the growth rate turns positive, by scan and Brent's method."""
    import scipy.optimize  # here, because it is slow to import

    low = start
    while low < end:
        high = min(low + step, end)
        if growth(high) > 0:
            return float(scipy.optimize.brentq(growth, low, high, xtol=RESOLUTION * high, rtol=RESOLUTION))
        low = high
    return None
