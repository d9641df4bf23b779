"""Owns what a design amounts to in numbers: the facts about its flutter, and about its run of the seed protocol."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solver.aerodynamics import Stream
from solver.buckling import buckling_factor
from solver.controlfacts import control_warnings
from solver.cycles import limit_cycles
from solver.design import Design
from solver.equilibrium import critical_pressure_deflected, static_states
from solver.estimate import ErrorEstimate, estimate_error
from solver.flutter import SCAN_END, buckled, critical_pressure, critical_pressure_full
from solver.fullrun import full_limit_cycle, full_seed_protocol, refuse_memory
from solver.mesh import Floats
from solver.modes import ModalModel
from solver.outcome import outcome_of
from solver.plant import Plant
from solver.rootlocus import root_locus
from solver.shooting import Orbit
from solver.simulate import Loop, seed_protocol
from solver.trace import Trace

SWEEP = 81  # values of λ, from 0 to a quarter above the critical one, at which eigenvalues are listed
FAR = 0.02  # relative difference of λ_cr in the basis from that of all modes beyond which the basis is warned about
FEW = 24  # modes whose roots are followed, where all modes are asked for


@dataclass(frozen=True)
class StateFacts:
    """A static state of the panel in its stream."""

    deflection_over_h: float
    """w at the 0.75 a point over h [-]."""
    largest_over_h: float
    """Largest |w| over h [-]."""
    stable: bool
    """Whether the panel stays there."""
    growth_per_s: float
    """Growth rate of small motions about it [1/s]."""


@dataclass(frozen=True)
class FlutterFacts:
    """Linear stability of a design's panel in its stream."""

    lambda_cr: float | None
    """λ_cr [-]: with every mode of the mesh, or within a family of modes; None if there is no flutter."""
    flutter_frequency_hz: float | None
    """Frequency at λ_cr [Hz]."""
    lambda_cr_in_basis: float | None
    """λ_cr [-] in the modes of the design's reduction; what it lacks to `lambda_cr` is the price of the reduction."""
    pressure_cr_pa: float | None
    """λ_cr D11/(2a³) = q/β at λ_cr [Pa], which depends on no reference laminate."""
    dynamic_pressure: float
    """The design's own λ [-], as given or from its Mach number and altitude."""
    aerodynamic_damping: float
    """Its C_a [-]."""
    modes: int
    """Number of modes in the basis."""
    frequencies_hz: list[float]
    """Natural frequencies of the flat panel in vacuo, under preload and heat, patches on [Hz]; 0 if it buckles so."""
    buckling_factor: float | None
    """Factor on preload and heat together at which the panel buckles in still air [-]; None where nothing presses."""
    buckled: bool
    """Whether it is buckled in still air."""
    rests_up_to: float | None
    """λ up to which a buckled panel rests in its deflection [-]; None if it is flat in still air."""
    then: str | None
    """What follows: flutter about the deflection, flat again, or motion with no rest near."""
    static_states: list[StateFacts]
    """Where a panel under preload or heat can rest at the design's λ."""
    dynamic_pressures: list[float]
    """(m) λ at which the roots are listed [-]."""
    growth_rates: list[list[float]]
    """(m, n) real parts of the roots [1/s], one of each conjugate pair, each column a branch followed over λ."""
    root_frequencies_hz: list[list[float]]
    """(m, n) imaginary parts of the same roots [Hz]."""
    damping_g: list[list[float]]
    """(m, n) g = 2 Re s/|s| of the V-g diagram [-]: flutter begins where one turns positive."""
    warnings: list[str]
    """What to mind about the theory here."""


def flutter_facts(design: Design) -> FlutterFacts:
    """Modes, critical dynamic pressure, static states and eigenvalues over λ of a design.

    Raises:
        DesignError: more modes are asked for than the mesh has.
    """
    model, stream = ModalModel.of(design), Stream.of(design)
    few = model.first(FEW) if design.reduction.modes == "all" else model
    if design.reduction.basis != "family":
        found = critical_pressure_full(few, stream)  # looks for a richer guide itself
        in_basis = found if design.reduction.modes == "all" else critical_pressure(model, stream)
    else:
        found = in_basis = critical_pressure(model, stream)
    end = 1.25 * max(found[0] if found else 0.0, stream.dynamic_pressure) or SCAN_END
    pressures = np.linspace(0.0, end, SWEEP)
    if found:  # where two roots meet they turn sharply
        pressures = np.union1d(pressures, found[0] * np.array([0.98, 0.99, 0.995, 1.0, 1.005, 1.01, 1.02]))
    locus = root_locus(few, stream, pressures)
    states: list[StateFacts] = []
    rest = None
    if model.plate.prestress is not None:
        plant = Plant.of(design.with_reduction("patched", few.size), few).symmetric()
        states = [StateFacts(s.deflection, s.largest, s.stable, s.growth.real) for s in static_states(plant)]
        rest = critical_pressure_deflected(plant)
    return FlutterFacts(
        lambda_cr=found[0] if found else None,
        flutter_frequency_hz=found[1] / (2 * np.pi) if found else None,
        lambda_cr_in_basis=in_basis[0] if in_basis else None,
        pressure_cr_pa=found[0] * stream.slope_unit / 2 if found else None,
        dynamic_pressure=stream.dynamic_pressure,
        aerodynamic_damping=stream.damping,
        modes=model.size,
        frequencies_hz=_frequencies(model).tolist(),
        buckling_factor=buckling_factor(model.plate),
        buckled=buckled(model),
        rests_up_to=rest.dynamic_pressure if rest else None,
        then=rest.kind if rest else None,
        static_states=states,
        dynamic_pressures=locus.dynamic_pressures.tolist(),
        growth_rates=locus.roots.real.tolist(),
        root_frequencies_hz=(locus.roots.imag / (2 * np.pi)).tolist(),
        damping_g=locus.damping.tolist(),
        warnings=[*stream.notes, *_basis_notes(found, in_basis)],
    )


def _basis_notes(full: tuple[float, float] | None, in_basis: tuple[float, float] | None) -> list[str]:
    if full is None or in_basis is None or abs(in_basis[0] / full[0] - 1) <= FAR:
        return []
    return [f"λ_cr in the basis, {in_basis[0]:.4g}, is far from that of all modes, {full[0]:.4g}; take more modes"]


def _frequencies(model: ModalModel) -> Floats:
    """(n,) natural frequencies of the flat panel [Hz]; 0 for a direction in which it buckles."""
    if model.plate.geometric is None:
        return model.omega / (2 * np.pi)
    squares = np.linalg.eigvalsh(np.diag(model.omega**2) + model.geometric)
    return np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)


@dataclass(frozen=True)
class CycleFacts:
    """A limit cycle as a periodic orbit, found by shooting."""

    amplitude_over_h: float
    """Peak of |w| at the 0.75 a point over h [-]."""
    half_range_over_h: float
    """Half of what w ranges over there, over h [-]: less than the amplitude if up and down are not alike."""
    frequency_hz: float
    """Frequency [Hz]."""
    symmetric: bool
    """Whether w half a period later is -w; a cycle that is not has a twin, its mirror image."""
    floquet_modulus: list[float]
    """(2n) moduli of the Floquet multipliers in decreasing order [-]; one, the trivial one, is 1."""
    floquet_angle_deg: list[float]
    """(2n) their angles [degrees]."""


@dataclass(frozen=True)
class FullOrderFacts:
    """A design's run with no modal reduction, under the control law of the reduced model."""

    damping_time_s: float | None
    """Damping time [s]; None if never within the run, or passive."""
    lco_amplitude_over_h: float | None
    """Peak of |w| at the 0.75 a point on the limit cycle, over h [-]."""
    lco_frequency_hz: float | None
    """Its frequency [Hz]."""
    peak_voltage_v: float
    """Largest voltage on any channel [V]."""


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
    """Whether the motion is a stable periodic orbit; if not, the figures are those of its last window."""
    lco_floquet: float | None
    """Largest modulus of its Floquet multipliers but the trivial one [-]; None if it is no periodic orbit."""
    cycles: list[CycleFacts]
    """Every stable limit cycle that was found, where that was asked for."""
    participation_percent: list[float]
    """Share of every mode of the run in the limit cycle [%], by max|q_r| scaled with the mode's peak."""
    mode_frequencies_hz: list[float]
    """Frequencies of the modes of the run [Hz]: the symmetric ones alone where nothing excites others."""
    end_amplitude_over_h: float
    """Largest |w| in the last four flutter periods of the run, over h [-]."""
    peak_voltage_v: float
    """Largest voltage on any channel [V]."""
    saturated_share: float
    """Share of the time from t_on to damped with a channel at its limit [-]."""
    motion: str | None
    """What the uncontrolled panel settles into: flat, buckled, deflected, limit cycle, periodic, … or chaotic."""
    snap_through: bool
    """Whether, buckled in still air, it goes over from side to side again and again."""
    motion_amplitude_over_h: float | None
    """Its peak of |w| at the 0.75 a point over h [-]."""
    lyapunov_per_s: float | None
    """Largest Lyapunov exponent of that motion [1/s]: positive where it is chaotic."""
    dynamic_pressure: float
    """The design's λ [-], as given or from its Mach number and altitude."""
    lambda_cr: float | None
    """λ_cr in the modes of the reduction, patches on [-]."""
    open_loop_growth_per_s: float
    """Growth rate of the flat panel without control, over all modes of the reduction [1/s]."""
    closed_loop_growth_per_s: float
    """Growth rate with the controller, over all modes of the reduction [1/s].

    Positive where no channel reaches a fluttering mode, as a symmetric layout the antisymmetric ones; a run from a
    symmetric start does not meet them.
    """
    channels: list[list[int]]
    """Patched elements on each channel."""
    warnings: list[str]
    """What to mind about the theory here."""
    estimate: ErrorEstimate | None
    """How sure the figures are, where that was asked for."""
    full_order: FullOrderFacts | None
    """The same figures of the full-order model, where they were asked for."""


def run_facts(
    design: Design, estimate: bool = False, cycles: bool = False, full_order: bool = False
) -> tuple[RunFacts, Trace]:
    """Run the seed protocol of a design and measure it.

    Args:
        design: the design.
        estimate: whether to estimate the error of its figures too, which takes several times as long.
        cycles: whether to look for every limit cycle that coexists, from several starts.
        full_order: whether to integrate the full-order model as well, which takes a minute or so.

    Raises:
        DesignError: the reduction does not serve a simulation.
        ControlError: the design's controller does not exist.
    """
    whole = Plant.of(design)
    plant = whole.symmetric()
    loop = Loop.of(plant)
    if full_order:
        refuse_memory(loop)
    trace = seed_protocol(loop)
    outcome = outcome_of(loop)
    motion, orbit, cycle = outcome.motion, outcome.orbit, outcome.cycle
    return (
        RunFacts(
            damping_time_s=trace.damping_time,
            passive=plant.passive,
            flutters=plant.flutters,
            diverged=not trace.complete,
            lco_amplitude_over_h=cycle.amplitude if cycle else None,
            lco_frequency_hz=cycle.frequency if cycle else None,
            lco_converged=bool(cycle and cycle.converged),
            lco_floquet=float(np.abs(orbit.others[0])) if orbit else None,
            cycles=[_cycle_facts(orbit) for orbit in limit_cycles(plant)] if cycles else [],
            participation_percent=cycle.participation.tolist() if cycle else [],
            mode_frequencies_hz=(plant.model.omega / (2 * np.pi)).tolist(),
            end_amplitude_over_h=trace.end_amplitude,
            peak_voltage_v=trace.peak_voltage,
            saturated_share=trace.saturated_share,
            motion=motion.kind if motion else None,
            snap_through=bool(motion and motion.snap_through),
            motion_amplitude_over_h=motion.amplitude_over_h if motion else None,
            lyapunov_per_s=motion.lyapunov_per_s if motion else None,
            dynamic_pressure=plant.stream.dynamic_pressure,
            lambda_cr=whole.critical[0] if whole.critical else None,
            open_loop_growth_per_s=whole.growth.real,
            closed_loop_growth_per_s=Loop.of(whole).growth.real,
            channels=[list(group) for group in plant.channels],
            warnings=[*plant.stream.notes, *control_warnings(whole, trace)],
            estimate=estimate_error(design) if estimate else None,
            full_order=_full_order(loop) if full_order else None,
        ),
        trace,
    )


def _cycle_facts(orbit: Orbit) -> CycleFacts:
    return CycleFacts(
        amplitude_over_h=orbit.amplitude,
        half_range_over_h=orbit.half_range,
        frequency_hz=orbit.frequency,
        symmetric=orbit.symmetric,
        floquet_modulus=np.abs(orbit.multipliers).tolist(),
        floquet_angle_deg=np.degrees(np.angle(orbit.multipliers)).tolist(),
    )


def _full_order(loop: Loop) -> FullOrderFacts:
    trace, cycle = full_seed_protocol(loop), full_limit_cycle(loop)
    return FullOrderFacts(
        damping_time_s=trace.damping_time,
        lco_amplitude_over_h=cycle.amplitude if cycle else None,
        lco_frequency_hz=cycle.frequency if cycle else None,
        peak_voltage_v=trace.peak_voltage,
    )
