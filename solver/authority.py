"""Owns authority maps: what each element of the panel is worth as actuator, sensor, or mere mass and stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.linalg

from solver.design import Design
from solver.errors import ControlError
from solver.flutter import GROWTH_NOISE
from solver.mesh import Floats
from solver.observer import kalman_gain
from solver.passive import patch_growth
from solver.piezo import element_forces
from solver.plant import Plant
from solver.regulator import Balanced, lqr_gain, regulator_solution

Criterion = Literal["nfcg", "nkfeg", "controllability", "h2", "growth"]
JUST_ABOVE = 1.001  # λ_cr, where the motion that begins to grow stands out
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)


@dataclass(frozen=True)
class AuthorityMap:
    """One number for every element."""

    criterion: Criterion
    """What it is."""
    title: str
    """The same in words."""
    unit: str
    """Unit of the values."""
    better: Literal["larger", "smaller"]
    """Which values speak for a patch."""
    values: Floats
    """(elements,) the values [their unit]; NaN where there is none."""
    note: str
    """What an element without a value means, if there are any."""

    @property
    def best(self) -> list[int]:
        """Elements that have a value, the best first."""
        sign = -1.0 if self.better == "larger" else 1.0
        scale = float(np.nanmax(np.abs(self.values), initial=0.0)) or 1.0
        order = np.argsort(
            sign * np.round(self.values / scale, 9), kind="stable"
        )  # twins in a mirror differ by rounding
        return [int(e) for e in order if np.isfinite(self.values[e])]


def authority(design: Design, criterion: Criterion = "nfcg") -> AuthorityMap:
    """The map of one criterion at the design's λ.

    nfcg, nkfeg, controllability and h2 are of the panel without patches, so that mass and stiffness of a patch do not
    enter; growth is of the panel as it is patched, and of one patch more.

    Raises:
        DesignError: the reduction keeps all modes.
        ControlError: the gain of nfcg or nkfeg does not exist.
    """
    match criterion:
        case "nfcg":
            return AuthorityMap(criterion, "NFCG, gain norm", "V/(m·√kg)", "larger", nfcg(design), "")
        case "nkfeg":
            return AuthorityMap(criterion, "NKFEG, estimator gain norm", "√kg·m/(C·s²)", "larger", nkfeg(design), "")
        case "controllability":
            title = "force on the growing motion"
            return AuthorityMap(criterion, title, "N/(V·√kg)", "larger", controllability(design), "")
        case "h2":
            values = closed_loop_cost(design)
            return AuthorityMap(
                criterion, "closed-loop H2 cost", "V²·kg/(N²·s)", "smaller", values, "cannot stabilise alone"
            )
        case "growth":
            return AuthorityMap(
                criterion, "growth by one more patch", "1/s", "smaller", patch_growth(design), "patched"
            )


def nfcg(design: Design) -> Floats:
    """(elements,) norm of each element's row of the feedback gain (the seed's 4.1).

    Every element is its own actuator on the bare panel: the patches' own mass and stiffness are left out. The state is
    X = (q, q̇) in mass-normalised modes as in the seed, so that the gains on q [V/(m·√kg)] outweigh those on q̇.
    """
    bare, forces = _bare(design)
    return np.linalg.norm(lqr_gain(bare, forces), axis=1)


def nkfeg(design: Design) -> Floats:
    """(elements,) norm of each element's column of the Kalman filter's gain (Abdel-Motagaly, 2001, ch. 5).

    Every element is its own sensor on the bare panel. Gains on the rates [√kg·m/(C·s²)] outweigh those on q.
    """
    bare, forces = _bare(design)
    return np.linalg.norm(kalman_gain(bare, forces), axis=0)


def controllability(design: Design) -> Floats:
    """(elements,) |ψᴴ b| of a volt on each element, over all growing motions of the bare panel [N/(V·√kg)].

    ψ are left eigenvectors of the panel in its stream (Hamdan and Nayfeh, J. Guidance 12, 1989), of unit norm in the
    balanced state, in which the squared norm is twice the energy. Where several motions grow, the root of the sum of
    squares; where none does, the one that is the first to, just above λ_cr; with no λ_cr the first mode.
    """
    bare, forces = _bare(design)
    if not bare.flutters and bare.critical is not None:
        bare = bare.at_pressure(JUST_ABOVE * bare.critical[0])
    part = Balanced.of(bare, forces)
    if not part.modes.any():
        return np.zeros(forces.shape[1])
    values, left = scipy.linalg.eig(part.system.T)
    growing = values.real > GROWTH_NOISE
    if not growing.any():
        growing = np.abs(values.imag) == np.abs(values.imag).min()
    left = left[:, growing & (values.imag >= 0)]
    return np.linalg.norm(left.conj().T @ (part.inputs * part.rate), axis=0)


def closed_loop_cost(design: Design) -> Floats:
    """(elements,) cost ∫ XᵀQX + R V² dt of the regulator on each element alone, per energy of a blow [V²·kg/(N²·s)].

    The squared H2 norm from modal forces, impulses or white noise of unit intensity, to the regulator's own measure:
    the trace of Riccati's P over the rates (Kwakernaak and Sivan, 1972, 3.4). NaN where an element alone holds no
    regulator. On a panel and stream symmetric about y = b/2 one half is computed.
    """
    bare, forces = _bare(design)
    mesh = bare.model.plate.space.mesh
    alike = bool(bare.model.plate.mirrored and not bare.stream.sine)
    costs = np.full(mesh.elements, np.nan)
    for e in range(mesh.elements):
        (twin,) = mesh.mirror_image((e,)) if alike else (e,)
        if twin < e:
            costs[e] = costs[twin]
            continue
        try:
            costs[e] = regulator_cost(bare, forces[:, [e]])
        except ControlError:
            continue
    return costs


def regulator_cost(plant: Plant, force: Floats) -> float:
    """Cost of `closed_loop_cost` for the regulator on inputs of modal forces (n, inputs) [V²·kg/(N²·s)].

    Raises:
        ControlError: no regulator exists.
    """
    part = Balanced.of(plant, force)
    cost, _ = regulator_solution(plant, part)
    k = len(part.omega)
    # P of the time ω1 t is ω1 times that of t
    return plant.design.control.state_weight * float(np.trace(cost[k:, k:])) / part.rate


def _bare(design: Design) -> tuple[Plant, Floats]:
    """The panel without patches, and the modal forces (n, elements) of a volt on each element."""
    bare = Plant.of(design.with_elements(()))
    return bare, element_forces(bare.model, design)
