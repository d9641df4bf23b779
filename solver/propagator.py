"""Owns the coefficients of an exponential Runge-Kutta step: what the linear part of a closed loop does in a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from solver.mesh import Floats

# Steps, a power of 2, into which one is parted in which a voltage reaches its limit or leaves it: the force has kinks
PARTS = 8


@dataclass(frozen=True)
class Propagator:
    """Coefficients of Cox and Matthews' ETD4RK for ẋ = A x + B p(x), of a whole step [0] and one in `PARTS` [1].

    What is linear is then exact, however stiff: the step has to resolve the motion, not the highest mode. With
    E = exp(hA), H = exp(hA/2), K = h/2 φ1(hA/2) B and φ_k of hA, the step of Cox and Matthews, J. Comput. Phys. 176,
    2002, (26-29), is, from forces p0 at x, p1 at a, p2 at b and p3 at c,

        a = H x + K p0                          c = E x + (H - 1) K p0 + 2 K p2
        b = H x + K p1                          y = E x + F1 p0 + F2 (p1 + p2) + F3 p3

    with F1 = h (φ1 - 3φ2 + 4φ3) B, F2 = h (2φ2 - 4φ3) B and F3 = h (4φ3 - φ2) B. The four results lie side by side,
    (b, y, c, a), so that each of p0 … p3 adds to a range of them: one product each, whose matrix is kept transposed.
    """

    step: float
    """h of a whole step [s]."""
    coast: Floats
    """(2, S, 2S) of x on (b, y), and as well on (a, c) [-]."""
    first: Floats
    """(2, F, 3S) of p0 on (y, c, a) [s]."""
    second: Floats
    """(2, F, 2S) of p1 on (b, y) [s]."""
    third: Floats
    """(2, F, 2S) of p2 on (y, c) [s]."""
    last: Floats
    """(2, F, S) of p3 on y [s]."""

    @staticmethod
    def of(a: Floats, b: Floats, step: float) -> Propagator:
        """The coefficients for A (S, S) [1/s] and B (S, F), whose columns say where the forces act.

        The φ functions are blocks of the exponential of one larger matrix (Sidje, ACM Trans. Math. Softw. 24, 1998),
        formed for the shortest time and squared from there on.
        """
        size, forces = b.shape
        whole = np.zeros((size + 3 * forces, size + 3 * forces))
        whole[:size, :size] = a
        whole[:size, size : size + forces] = b
        whole[size:-forces, size + forces :] = np.eye(2 * forces)
        scale = np.diagonal(scipy.linalg.matrix_balance(whole, permute=False)[1])
        exponential = scipy.linalg.expm(whole * scale / scale[:, None] * (step / (2 * PARTS)))
        times = [exponential * scale[:, None] / scale]
        while len(times) < PARTS.bit_length() + 1:  # step / (2 PARTS), doubled up to the step
            times.append(times[-1] @ times[-1])
        pairs = [(times[-2], times[-1], step), (times[0], times[1], step / PARTS)]
        parts = zip(*(_coefficients(*pair, size, forces) for pair in pairs), strict=True)
        return Propagator(step, *(np.stack(part) for part in parts))


def _coefficients(half: Floats, full: Floats, step: float, size: int, forces: int) -> tuple[Floats, ...]:
    """The transposed matrices of a step from the exponentials of the larger matrix over h/2 and h."""
    one, two, three = (full[:size, size + k * forces : size + (k + 1) * forces] / step**k for k in range(3))
    f1, f2, f3 = one - 3 * two + 4 * three, 2 * two - 4 * three, 4 * three - two
    e, h, k = full[:size, :size], half[:size, :size], half[:size, size : size + forces]
    stacked = ([h, e], [f1, h @ k - k, k], [k, f2], [f2, 2 * k], [f3])
    return tuple(np.ascontiguousarray(np.vstack(parts).T) for parts in stacked)
