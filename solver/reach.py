"""Owns what the patches can reach: the growing motions of the panel, and why a controller leaves one of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.linalg

from solver.bases import Complexes
from solver.blocks import blocks_of
from solver.flutter import GROWTH_NOISE
from solver.mesh import Bools, Floats
from solver.piezo import element_forces
from solver.plant import Plant

NOTHING = 1e-9  # of what the best single element does to a root: rounding
NAMED = 2  # modes that a root is named by


@dataclass(frozen=True)
class GrowingRoot:
    """A growing motion of the flat, uncontrolled panel."""

    growth: float
    """Growth rate [1/s]."""
    frequency: float
    """Frequency [rad/s]; 0 for divergence."""
    parity: Literal[-1, 0, 1]
    """1 if it is symmetric about y = b/2, -1 if antisymmetric, 0 if neither."""
    modes: tuple[int, ...]
    """The modes it mostly consists of, counted from 1 in the design's basis."""
    authority: float
    """What a volt on the channels does to it, over what one on the best single element would [-]."""

    def __str__(self) -> str:
        """Name it in words."""
        kind = {1: ", symmetric about y = b/2", -1: ", antisymmetric about y = b/2", 0: ""}[self.parity]
        modes = " and ".join(str(mode) for mode in self.modes)
        return (
            f"the motion growing at {self.growth:+.1f} /s, {self.frequency / (2 * np.pi):.1f} Hz{kind}, modes {modes}"
        )


def growing_roots(plant: Plant) -> list[GrowingRoot]:
    """Growing motions of the flat panel without control, the fastest first; one of each conjugate pair.

    The authority over a root is |ψᴴB| with its left eigenvector ψ (Hamdan and Nayfeh, J. Guidance 12, 1989).
    """
    n = plant.size
    values, left, right = _eigen(plant.system_matrix)
    found = np.flatnonzero((values.real > GROWTH_NOISE * plant.model.omega[0]) & (values.imag >= 0))
    best = element_forces(plant.model, plant.design)
    parity = plant.model.parity
    numbers = np.arange(n) if plant.model.numbers is None else plant.model.numbers
    roots = []
    for k in found[np.argsort(-values[found].real)]:
        share = np.abs(right[:n, k]) * plant.model.peak
        alike = {int(p) for p in parity[share > 1e-6 * share.max()]}
        top = np.abs(left[n:, k].conj() @ best).max()
        own = np.linalg.norm(left[n:, k].conj() @ plant.force)
        roots.append(
            GrowingRoot(
                growth=float(values[k].real),
                frequency=float(values[k].imag),
                parity=1 if alike == {1} else -1 if alike == {-1} else 0,
                modes=tuple(int(numbers[m]) + 1 for m in np.argsort(-share)[:NAMED]),
                authority=float(own / top) if top > 0 else 0.0,
            )
        )
    return roots


def _eigen(matrix: Floats) -> tuple[Complexes, Complexes, Complexes]:
    """Eigenvalues, left and right eigenvectors."""
    found: Any = scipy.linalg.eig(matrix, left=True, right=True)  # typed as if it gave two
    return found


def reached(plant: Plant, force: Floats) -> Bools:
    """(n,) modes that inputs (n, inputs) move, themselves or through other modes; the rest keep their growth rate.

    A layout symmetric about y = b/2 on one channel cannot touch the antisymmetric modes, and must not be kept from
    controlling the symmetric ones because of them.
    """
    coupled = (plant.stiffness != 0) | (plant.damping != 0)
    found = np.any(force != 0, axis=1)
    for block in blocks_of(coupled):
        found[block] = found[block].any()
    return found


def out_of_reach(plant: Plant) -> list[str]:
    """What grows and the patches cannot reach at all, a line each that says what to do."""
    roots = growing_roots(plant)
    if roots and not plant.channels:
        return [f"there is no patch, and nothing drives {root}; patch elements of the leading third" for root in roots]
    return [f"the patches cannot reach {root}: {_remedy(root)}" for root in roots if root.authority <= NOTHING]


def _remedy(root: GrowingRoot) -> str:
    if root.parity == -1:
        return "patch one side of y = b/2 alone, or set patches.channels = element"
    return "patch other elements"


def refusal(plant: Plant) -> str:
    """Why no regulator exists, naming the growing motion that the patches have least hold of."""
    roots = sorted(growing_roots(plant), key=lambda root: root.authority)
    what = f" for {roots[0]}: they have {100 * roots[0].authority:.2g} % of the best element's hold" if roots else ""
    pressure = f"λ = {plant.stream.dynamic_pressure:g}"
    return (
        f"the patches cannot hold the flutter: no regulator exists at {pressure}{what}; patch other elements (the "
        "leading third is best) or lower λ"
    )
