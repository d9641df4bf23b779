"""Owns what a design amounts to in numbers: the facts about its flutter, and about its run of the seed protocol."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.aerodynamics import Stream
from solver.design import Design
from solver.flutter import critical_pressure, critical_pressure_full, system_matrix
from solver.limitcycle import limit_cycle
from solver.modes import ModalModel
from solver.plant import Plant
from solver.regulator import Regulator
from solver.simulate import Loop, seed_protocol
from solver.trace import Trace

SWEEP = 41  # values of λ, from 0 to a quarter above the critical one, at which eigenvalues are listed
FULL_BASIS = 24  # modes that point the full-order search to where flutter lies


@dataclass(frozen=True)
class FlutterFacts:
    """Linear stability of a design's panel in its stream."""

    lambda_cr: float | None
    """λ_cr [-]: with every mode of the mesh for the patched basis, else in the family; None if there is no flutter."""
    flutter_frequency_hz: float | None
    """Frequency at λ_cr [Hz]."""
    lambda_cr_in_basis: float | None
    """λ_cr [-] in the modes of the design's reduction; what it lacks to `lambda_cr` is the price of the reduction."""
    modes: int
    """Number of modes in the basis."""
    frequencies_hz: list[float]
    """Natural frequencies in vacuo, patches on [Hz]."""
    dynamic_pressures: list[float]
    """λ at which the roots are listed [-]."""
    growth_rates: list[list[float]]
    """Real parts of the roots at each λ [1/s], one of each conjugate pair."""
    root_frequencies_hz: list[list[float]]
    """Imaginary parts of the same roots [Hz]."""


def flutter_facts(design: Design) -> FlutterFacts:
    """Modes, critical dynamic pressure and eigenvalues over λ of a design.

    Raises:
        DesignError: more modes are asked for than the mesh has.
    """
    model, stream = ModalModel.of(design), Stream.of(design)
    few = model.first(FULL_BASIS) if design.reduction.modes == "all" else model
    if design.reduction.basis == "family":
        found = in_basis = critical_pressure(model, stream)
    else:
        guide = few
        if few.size < FULL_BASIS:  # a poor basis points to the wrong place
            count = min(FULL_BASIS, model.plate.stiffness.shape[0])
            guide = ModalModel.of(design.with_reduction("patched", count), model.plate)
        found = critical_pressure_full(guide, stream)
        in_basis = found if design.reduction.modes == "all" else critical_pressure(model, stream)
    end = 1.25 * max(found[0] if found else 0.0, design.flow.dynamic_pressure)
    pressures = np.linspace(0.0, end, SWEEP)
    roots = [_roots(few, stream, value) for value in pressures]
    return FlutterFacts(
        lambda_cr=found[0] if found else None,
        flutter_frequency_hz=found[1] / (2 * np.pi) if found else None,
        lambda_cr_in_basis=in_basis[0] if in_basis else None,
        modes=model.size,
        frequencies_hz=(model.omega / (2 * np.pi)).tolist(),
        dynamic_pressures=pressures.tolist(),
        growth_rates=[r.real.tolist() for r in roots],
        root_frequencies_hz=[(r.imag / (2 * np.pi)).tolist() for r in roots],
    )


def _roots(model: ModalModel, stream: Stream, value: float) -> NDArray[np.complex128]:
    roots: NDArray[np.complex128] = np.linalg.eigvals(system_matrix(model, stream, value)).astype(np.complex128)
    upper = roots[np.imag(roots) >= 0]
    return upper[np.argsort(np.imag(upper))]


@dataclass(frozen=True)
class RunFacts:
    """A design's run of the seed protocol, and the limit cycle it starts from."""

    damping_time_s: float | None
    """Time from t_on until the panel stays quiet [s]; None if never within the run, or passive."""
    passive: bool
    """Whether there are patches and the patched λ_cr lies above λ: control is not what ends a flutter here."""
    flutters: bool
    """Whether the flat, uncontrolled panel is unstable at this λ."""
    diverged: bool
    """Whether the motion left all bounds and the run was cut off."""
    lco_amplitude_over_h: float | None
    """Peak of w at the 0.75 a point on the converged limit cycle, over h [-]."""
    lco_frequency_hz: float | None
    """Its frequency [Hz]."""
    lco_converged: bool
    """Whether the limit cycle's amplitude came to rest."""
    participation_percent: list[float]
    """Share of every mode of the run in the limit cycle [%], by max|q_r| scaled with the mode's peak."""
    mode_frequencies_hz: list[float]
    """Frequencies of the modes of the run [Hz]: the symmetric ones alone where nothing excites others."""
    peak_voltage_v: float
    """Largest voltage on any channel [V]."""
    saturated_share: float
    """Share of the time from t_on to damped with a channel at its limit [-]."""
    lambda_cr: float | None
    """λ_cr in the modes of the reduction, patches on [-]."""
    open_loop_growth_per_s: float
    """Growth rate of the flat panel without control, over all modes of the reduction [1/s]."""
    closed_loop_growth_per_s: float
    """Growth rate with the regulator, over all modes of the reduction [1/s].

    Positive where no channel reaches a fluttering mode, as a symmetric layout the antisymmetric ones; a run from a
    symmetric start does not meet them.
    """
    channels: list[list[int]]
    """Patched elements on each channel."""


def run_facts(design: Design) -> tuple[RunFacts, Trace]:
    """Run the seed protocol of a design and measure it.

    Raises:
        DesignError: the reduction does not serve a simulation.
        ControlError: no regulator exists.
    """
    whole = Plant.of(design)
    plant = whole.symmetric()
    loop = Loop.of(plant)
    trace = seed_protocol(loop)
    cycle = limit_cycle(loop)
    return (
        RunFacts(
            damping_time_s=trace.damping_time,
            passive=plant.passive,
            flutters=plant.flutters,
            diverged=not trace.complete,
            lco_amplitude_over_h=cycle.amplitude if cycle else None,
            lco_frequency_hz=cycle.frequency if cycle else None,
            lco_converged=bool(cycle and cycle.converged),
            participation_percent=cycle.participation.tolist() if cycle else [],
            mode_frequencies_hz=(plant.model.omega / (2 * np.pi)).tolist(),
            peak_voltage_v=trace.peak_voltage,
            saturated_share=trace.saturated_share,
            lambda_cr=whole.critical[0] if whole.critical else None,
            open_loop_growth_per_s=whole.growth.real,
            closed_loop_growth_per_s=Regulator.of(whole).growth.real,
            channels=[list(group) for group in plant.channels],
        ),
        trace,
    )
