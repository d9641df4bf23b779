"""Owns root loci: roots followed over dynamic pressure, as in the V-g diagram, and poles over the loop's gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.aerodynamics import Stream
from solver.flutter import system_matrix
from solver.law import Law, closed_loop
from solver.mesh import Floats
from solver.modes import ModalModel
from solver.plant import Plant

Complexes = NDArray[np.complexfloating]


@dataclass(frozen=True)
class RootLocus:
    """The roots of the flat panel, one of each conjugate pair, along branches that are continuous in λ."""

    dynamic_pressures: Floats
    """(m,) λ [-]."""
    roots: Complexes
    """(m, n) growth rate [1/s] + i·frequency [rad/s] of branch k at each λ, by their frequencies at the first."""

    @property
    def damping(self) -> Floats:
        """(m, n) g = 2 Re s / |s| of the V-g diagram [-]: flutter begins where one turns positive."""
        size = np.abs(self.roots)
        return 2 * self.roots.real / np.where(size > 0, size, 1.0)


def root_locus(model: ModalModel, stream: Stream, dynamic_pressures: Floats) -> RootLocus:
    """Follow the roots over increasing λ.

    From each λ to the next, roots are matched so that they lie nearest to where their branches point.

    Args:
        model: the structure in its modes.
        stream: the flow; its own λ is not used.
        dynamic_pressures: (m,) λ in ascending order.
    """
    import scipy.optimize  # here, because it is slow to import

    rows: list[Complexes] = []
    for value in dynamic_pressures:
        roots = _upper(np.linalg.eigvals(system_matrix(model, stream, float(value))).astype(complex))
        if rows:
            pointed = 2 * rows[-1] - rows[-2] if len(rows) > 1 else rows[-1]
            _, order = scipy.optimize.linear_sum_assignment(np.abs(pointed[:, None] - roots))
            roots = roots[order]
        rows.append(roots)
    return RootLocus(np.asarray(dynamic_pressures, dtype=float), np.array(rows))


def gain_locus(plant: Plant, law: Law, factors: Floats) -> Complexes:
    """Poles about the flat panel as the loop is closed: with a law that asks for so many times as much.

    Args:
        plant: the panel in its stream.
        law: the control law.
        factors: (m,) from 0, the open loop, to 1, the closed one [-].

    Returns:
        (m, k) poles [1/s], in no order; k is 2n and the states of controller and delay line.
    """
    return np.array([np.linalg.eigvals(closed_loop(plant, law.scaled(float(f)))) for f in factors], dtype=complex)


def _upper(roots: Complexes) -> Complexes:
    """One root of each conjugate pair, by frequency; of real ones, which come in pairs too, the larger half."""
    count = len(roots) // 2
    turning = roots[roots.imag > 0]
    real = np.sort(roots[roots.imag == 0].real)[::-1][: count - len(turning)]
    upper = np.concatenate([real.astype(complex), turning])
    return upper[np.lexsort((upper.real, upper.imag))]
