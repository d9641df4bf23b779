"""Owns the control law: what any controller amounts to, laid out alike for integration and for eigenvalues."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from solver.design import Control
from solver.mesh import Floats
from solver.plant import Plant

RANK = 1e-11  # of the largest singular value of a gain, below which it is rounding
NODES = 12  # of the delay line in eigenvalues, beside one for each radian of the highest mode in half a delay


@dataclass(frozen=True, eq=False)  # arrays do not compare; a law is the same as itself, and a key by that
class Law:
    """U = -(G X + Γ_Q y + Γ_I ẏ + H z), ż = A z + L y + E V, and V = U(t - τ) within ± the limit.

    y = Fᵀq are the charges of the c channels' own patches and ẏ their currents, X = (q, q̇) the plant's state, z the
    controller's own of m numbers. What stands here belongs to no plant but for the length of X.
    """

    gain: Floats
    """(c, 2n) G on the plant's state [V per unit of q, V·s per unit of q̇]."""
    on_charge: Floats
    """(c, c) Γ_Q [V/C]."""
    on_current: Floats
    """(c, c) Γ_I [V/A]."""
    reading: Floats
    """(c, m) H [V per unit of z]."""
    own: Floats
    """(m, m) A [1/s]."""
    sensed: Floats
    """(m, c) L [units of z per C·s]."""
    driven: Floats
    """(m, c) E [units of z per V·s]."""
    limit: float
    """Largest voltage [V]."""
    delay: float = 0.0
    """τ from what is asked for to what is given [s]."""
    noise: float = 0.0
    """One-sided amplitude density of white noise on every y, or on every ẏ where that is used [C/√Hz, A/√Hz]."""
    seed: int = 0
    """Seed of the noise [-]."""

    @staticmethod
    def static(control: Control, gain: Floats) -> Law:
        """V = -G X, with the drive of a control."""
        c = len(gain)
        none = np.zeros((c, c))
        return Law(
            gain=gain,
            on_charge=none,
            on_current=none,
            reading=np.zeros((c, 0)),
            own=np.zeros((0, 0)),
            sensed=np.zeros((0, c)),
            driven=np.zeros((0, c)),
            limit=control.voltage_limit,
            delay=control.delay,
            noise=control.sensor_noise,
            seed=control.noise_seed,
        )

    @staticmethod
    def idle(plant: Plant) -> Law:
        """A law that asks for nothing."""
        law = Law.static(plant.design.control, np.zeros((len(plant.channels), 2 * plant.size)))
        return dataclasses.replace(law, delay=0.0, noise=0.0)

    @property
    def memory(self) -> int:
        """Number m of the controller's own states."""
        return len(self.own)

    @property
    def asks(self) -> bool:
        """Whether it ever asks for a voltage."""
        return bool(self.gain.any() or self.on_charge.any() or self.on_current.any() or self.reading.any())

    @property
    def instant(self) -> bool:
        """Whether it is no more than a gain on the present state: without own state, delay and noise."""
        return not (self.memory or self.delay or self.hears_noise)

    @property
    def hears_noise(self) -> bool:
        """Whether there is noise, and a signal for it to be on."""
        return bool(self.noise and (self.sensed.any() or self.on_charge.any() or self.on_current.any()))

    def scaled(self, factor: float) -> Law:
        """The same law asking for so many times as much, as along a root locus; what it listens to stays."""
        return dataclasses.replace(
            self,
            gain=factor * self.gain,
            on_charge=factor * self.on_charge,
            on_current=factor * self.on_current,
            reading=factor * self.reading,
        )

    def direct(self, force: Floats) -> Floats:
        """(c, 2n) the gain on X of a plant with modal forces (n, c) a volt, what its sensors bring taken in."""
        return self.gain + self.direct_on_sensors(force)

    def direct_on_sensors(self, force: Floats) -> Floats:
        """(c, 2n) what of that the sensors bring: the gains on charge and current."""
        return np.hstack([self.on_charge @ force.T, self.on_current @ force.T])

    def filtered(self, own: Plant, richer: Plant) -> Law:
        """The same law at work on a richer plant on the same mesh, whose state it sees through its own modes alone.

        With q = Φᵀ M w of its own modes, G becomes G Φᵀ M Φ_richer for amplitudes and rates alike; charges are those
        of the richer plant. What a controller does to motion outside of its modes is spillover (Balas, IEEE Trans.
        Autom. Control 23, 1978).

        Args:
            own: the plant that it was made for.
            richer: the plant that it is to drive, with the same channels.
        """
        share = own.model.project(richer.model, np.eye(richer.size)).T
        gain = np.hstack([self.gain[:, : own.size] @ share, self.gain[:, own.size :] @ share])
        return dataclasses.replace(self, gain=gain)


def extended(plant: Plant, law: Law) -> tuple[Floats, Floats, Floats]:
    """The flat panel and its controller as one linear system over (X, z).

    Returns:
        A (2n + m, 2n + m), B (2n + m, c) of d/dt (X, z) = A (X, z) + B V, and K (c, 2n + m) of U = -K (X, z).
    """
    n, m = plant.size, law.memory
    a = np.zeros((2 * n + m, 2 * n + m))
    a[: 2 * n, : 2 * n] = plant.system_matrix
    a[2 * n :, :n] = law.sensed @ plant.force.T
    a[2 * n :, 2 * n :] = law.own
    return a, np.vstack([plant.input_matrix, law.driven]), np.hstack([law.direct(plant.force), law.reading])


def closed_loop(plant: Plant, law: Law) -> Floats:
    """System matrix of the flat panel under a law that never saturates [1/s].

    A delay is a line along which U travels, ∂U/∂t = ∂U/∂θ on -τ ≤ θ ≤ 0, collocated at Chebyshev's points: its nodes
    follow (X, z) in the state. The rightmost eigenvalues converge exponentially (Breda, Maset and Vermiglio, SIAM J.
    Sci. Comput. 27, 2005).
    """
    a, b, k = extended(plant, law)
    if not law.delay or not len(k):
        return a - b @ k
    # fewer signals than channels may travel: U = -K (X, z) = -spread R (X, z), of the rank of K
    left, sizes, right = np.linalg.svd(k, full_matrices=False)
    kept = sizes > RANK * max(sizes[0], 1e-300)
    b, k = b @ (left[:, kept] * sizes[kept]), right[kept]
    size, c = len(a), len(k)
    nodes = line_nodes(plant, law)
    slope = _chebyshev_slope(nodes) * (2 / law.delay)
    line = np.kron(slope[1:, 1:], np.eye(c))
    whole = np.zeros((size + nodes * c, size + nodes * c))
    whole[:size, :size] = a
    whole[:size, size + (nodes - 1) * c :] = b
    whole[size:, :size] = -np.kron(slope[1:, :1], k)
    whole[size:, size:] = line
    return whole


def line_nodes(plant: Plant, law: Law) -> int:
    """How many nodes resolve every mode's signal along the delay line of a channel; 0 without a delay."""
    return NODES + math.ceil(plant.model.band[1] * law.delay / 2) if law.delay else 0


def _chebyshev_slope(nodes: int) -> Floats:
    """(nodes + 1, nodes + 1) derivative of a polynomial from its values at cos(kπ/nodes) (Trefethen, 2000, ch. 6)."""
    x = np.cos(np.pi * np.arange(nodes + 1) / nodes)
    weight = np.where((np.arange(nodes + 1) % nodes) == 0, 2.0, 1.0) * (-1.0) ** np.arange(nodes + 1)
    matrix = np.outer(weight, 1 / weight) / (x[:, None] - x + np.eye(nodes + 1))
    return matrix - np.diag(matrix.sum(axis=1))
