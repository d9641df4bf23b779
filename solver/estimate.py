"""Owns the error estimate of a reduced result: how far λ_cr, limit cycle and damping time may be from converged."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from solver.aerodynamics import Stream
from solver.design import MAX_ELEMENTS, MOST_MODES, Basis, Design, MeshSize, Reduction
from solver.flutter import critical_pressure, critical_pressure_full
from solver.limitcycle import LimitCycle, limit_cycle
from solver.modes import ModalModel
from solver.outcome import outcome_of
from solver.plant import Plant
from solver.simulate import Loop, seed_protocol

RICHER = 1.5  # times as many modes, without which a comparison says nothing
# A mesh twice as fine shows three quarters of an error of second order, as the membrane's; bending converges faster.
SECOND_ORDER = 4.0 / 3.0
RICH = 24  # modes at least of the basis that a family is held against: it lacks what no more of its kind would bring


@dataclass(frozen=True)
class Estimate:
    """One figure of a reduced result, and how far it may be off."""

    value: float
    """The figure [its own unit]."""
    basis_error: float | None
    """What more modes would change it by [same unit]; None where a richer basis has no such figure."""
    mesh_error: float | None
    """What a finer mesh would change it by [same unit]; None likewise, or where a finer mesh would be too large."""


@dataclass(frozen=True)
class ErrorEstimate:
    """How sure a reduced result is."""

    modes: int
    """Modes of the design's reduction."""
    richer_modes: int
    """Modes of the basis that it is held against."""
    finer_mesh: tuple[int, int] | None
    """Elements along and across of the mesh that it is held against; None if that would be too large."""
    lambda_cr: Estimate | None
    """λ_cr in the basis [-], against every mode of the mesh; None if there is no flutter in the basis."""
    lco_amplitude_over_h: Estimate | None
    """Peak of w at the 0.75 a point on the limit cycle, over h [-]; None if there is none."""
    damping_time_s: Estimate | None
    """Damping time of the seed protocol [s]; None if there is none."""
    damps_in_richer: bool | None
    """Whether the controller damps the richer panel too; if not, it excites what its modes do not see (spillover)."""


def estimate_error(design: Design) -> ErrorEstimate:
    """Hold a design's figures against a richer basis on the same mesh, and against a mesh twice as fine.

    λ_cr is known with every mode of the mesh, and so its error. The limit cycle and the damping time are computed again
    with twice as many modes (for a family: with the lowest modes of the panel). The change shows half of an error that
    falls as 1/n, as that of the kinks which patches press into the curvature, and is taken twice. The controller stays
    the design's own, and drives the richer panel by what it sees of it through its own modes. A damping time ends where
    |w| exceeds its limit for the last time, and a peak that just touches the limit moves that by half a period: so much
    is added.

    Raises:
        DesignError: the reduction does not serve a simulation.
        ControlError: the design's controller does not exist.
    """
    plant = Plant.of(design).symmetric()
    loop = Loop.of(plant)
    outcome, damping_time = outcome_of(loop), seed_protocol(loop).damping_time
    cycle = outcome.cycle if outcome.orbit else None

    basis, modes = _richer(design.reduction, plant.model)
    rich = Plant.of(design.with_reduction(basis, modes)).symmetric()
    rich_loop = Loop.of(rich, loop.law.filtered(plant, rich))
    start = rich.model.project(plant.model, cycle.state.reshape(2, -1)).ravel() if cycle else None
    rich_cycle = limit_cycle(rich_loop, start) if cycle else None
    rich_time = seed_protocol(rich_loop).damping_time if damping_time is not None else None

    finer, fine_cycle, fine_time = _finer(design), None, None
    if finer is not None:
        fine_loop = Loop.of(Plant.of(finer).symmetric())
        fine_cycle = limit_cycle(fine_loop) if cycle else None
        fine_time = seed_protocol(fine_loop).damping_time if damping_time is not None else None
    left = _left(int(design.reduction.modes), modes) if basis == design.reduction.basis else 2.0
    return ErrorEstimate(
        modes=int(design.reduction.modes),
        richer_modes=modes,
        finer_mesh=(finer.mesh.nx, finer.mesh.ny) if finer else None,
        lambda_cr=_lambda_cr(design, finer),
        lco_amplitude_over_h=_estimate(_amplitude(cycle), _amplitude(rich_cycle), _amplitude(fine_cycle), left),
        damping_time_s=_estimate(damping_time, rich_time, fine_time, left, plant.period / 2),
        damps_in_richer=None if damping_time is None else rich_time is not None,
    )


def _amplitude(cycle: LimitCycle | None) -> float | None:
    return cycle.amplitude if cycle else None


def _estimate(
    own: float | None, rich: float | None, fine: float | None, left: float | None, jump: float = 0.0
) -> Estimate | None:
    """An estimate, `left` being the error that is left over the change that the richer basis makes."""
    if own is None:
        return None
    return Estimate(
        value=own,
        basis_error=None if rich is None or left is None else left * abs(rich - own) + jump,
        mesh_error=None if fine is None else SECOND_ORDER * abs(fine - own),
    )


def _left(modes: int, richer: int) -> float | None:
    """Error of a basis over the change that a richer one makes, if it falls as 1/n; None if that is hardly richer."""
    return richer / (richer - modes) if richer >= RICHER * modes else None


def _lambda_cr(design: Design, finer: Design | None) -> Estimate | None:
    own = critical_pressure(ModalModel.of(design), Stream.of(design))
    if own is None:
        return None
    full, fine = _full(design), _full(finer) if finer else None
    return Estimate(
        value=own[0],
        basis_error=None if full is None else abs(full - own[0]),
        mesh_error=None if full is None or fine is None else SECOND_ORDER * abs(fine - full),
    )


def _full(design: Design) -> float | None:
    """λ_cr with every mode of the mesh."""
    found = critical_pressure_full(ModalModel.of(design), Stream.of(design))
    return found[0] if found else None


def _richer(reduction: Reduction, model: ModalModel) -> tuple[Basis, int]:
    """Basis and modes to hold a reduction against, within what there is."""
    available = model.plate.stiffness.shape[0]
    most = min(MOST_MODES, available)
    if reduction.basis == "aeroelastic":
        return "aeroelastic", min(2 * int(reduction.modes), most, available // 2)
    modes = min(2 * int(reduction.modes), most)
    return "patched", max(modes, min(RICH, most))


def _finer(design: Design) -> Design | None:
    """The design on a mesh of twice as many elements either way, its patches where they were; None if too large."""
    nx, ny = design.mesh.nx, design.mesh.ny
    if 4 * nx * ny > MAX_ELEMENTS:
        return None
    i, j = np.divmod(np.array(design.patches.elements, dtype=int), ny)
    quarters = [(2 * i + p) * 2 * ny + 2 * j + q for p in (0, 1) for q in (0, 1)]
    patches = msgspec.structs.replace(design.patches, elements=tuple(np.concatenate(quarters).tolist()))
    return msgspec.structs.replace(design, mesh=MeshSize(2 * nx, 2 * ny), patches=patches)
